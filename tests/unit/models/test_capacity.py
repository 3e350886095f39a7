"""What devices can feed in and take, MVA: lines and dead islands are bounded by it."""

from __future__ import annotations

from resilience.models.microgrid import Microgrid
from resilience.testing import small_case


def test_capacities_by_hand() -> None:
    """An inverter's rating counts where it is more than the limits, and where it is known."""
    case = small_case(
        load=[{"p_max_mw": 0.8, "shed_cost_per_mwh": 5.0}],
        ess=[
            {"p_min_mw": -0.2, "p_max_mw": 0.3, "e_mwh": 2.5},
            {"p_min_mw": -0.4, "p_max_mw": 0.7, "e_mwh": 1.5, "s_mva": 0.6},
        ],
        pv=[{"p_max_mw": 1.3}, {"p_max_mw": 0.9, "s_mva": 1.6}],
        generator=[
            {"p_max_mw": 0.35, "cost_per_mwh": 7.0, "q_min_mvar": -0.15, "q_max_mvar": 0.25}
        ],
        grid=[
            {"import_max_mw": 5.0, "export_max_mw": 3.0, "q_max_mvar": 1.25}
            | {"import_cost_per_mwh": 2.0}
        ],
    )
    fleets = Microgrid.build(case, "lindistflow").fleets
    capacity = {kind: tuple(x.tolist() for x in f.capacity()) for kind, f in fleets.items()}
    assert capacity == {
        "load": ([0.0], [0.0]),
        "ess": ([0.2, 0.6], [0.3, 0.7]),
        "pv": ([0.0, 1.6], [0.0, 1.6]),
        "generator": ([0.35 + 0.25], [0.15]),
        "grid": ([6.25], [4.25]),
    }
