"""Right values where limits that are there for solvers used to bind: at high profiles and large
losses. By hand, unless a source is named.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from resilience.case import Case
from resilience.errors import UsageError
from resilience.models.methods import METHODS
from resilience.models.microgrid import Microgrid, Physics
from resilience.models.program.referee import NEAR_LIMIT, audit
from resilience.planning.solve import solve
from resilience.testing import small_case
from resilience.testing.cases import BASE_OHM
from tests.known.solving import solved

LOAD = {"bus": "2", "p_max_mw": 1.3, "profile": "day", "shed_cost_per_mwh": 110.0}
GRID = {"import_max_mw": 9.0, "import_cost_per_mwh": 1.4}
DAY = [0.9, 1.8]


def two_buses(**changes: Any) -> Case:
    """A load behind a short line, at 0.9 and then 1.8 times its peak."""
    tables = {"load": [LOAD], "grid": [GRID], **changes}
    return small_case(buses=2, lines=[(1, 2, 1e-4, 2e-4)], profiles={"day": DAY}, **tables)


@pytest.mark.parametrize("method", METHODS)
def test_a_load_at_1_8_of_its_peak_is_served_by_every_method(method: str) -> None:
    """profile_above_125: 2.80 at 1 MW, 1 $/MWh and a profile of [1.0, 1.8]; here other figures.
    Losses are below r (p / v)^2, a thousandth of the cost.
    """
    found = solved(two_buses(), method)
    served = 1.3 * sum(DAY) * 1.4
    assert served - 1e-6 <= found.objective <= served * 1.001
    assert found.bound == pytest.approx(found.objective, rel=1e-4)
    assert max(found.near_limits.values()) == 0.0


@pytest.mark.parametrize("method", METHODS)
def test_the_case_that_was_reported_costs_2_80(method: str) -> None:
    case = small_case(
        buses=2,
        lines=[(1, 2, 0.01 / BASE_OHM, 0.01 / BASE_OHM)],
        profiles={"day": [1.0, 1.8]},
        load=[{**LOAD, "p_max_mw": 1.0, "shed_cost_per_mwh": 100.0}],
        grid=[{"import_max_mw": 10.0, "import_cost_per_mwh": 1.0}],
    )
    assert solved(case, method).objective == pytest.approx(2.80, abs=1e-3)


def far_load(v_min: float, v_pu: float, *, r: float, p_mw: float) -> tuple[Case, float]:
    """One slot of a load behind a resistance, and what it costs by the quadratic of its voltage,
    V2 = (V1 + sqrt(V1^2 - 4 r p)) / 2 and import = V1 (V1 - V2) / r.
    """
    case = small_case(
        slots=1,
        buses=2,
        lines=[(1, 2, r, 0.0)],
        voltage_band_pu=(v_min, 1.2),
        load=[{"bus": "2", "p_max_mw": p_mw, "shed_cost_per_mwh": 100.0}],
        grid=[{"import_max_mw": 20.0, "import_cost_per_mwh": 1.3, "v_pu": v_pu}],
    )
    v2 = 0.5 * (v_pu + math.sqrt(v_pu**2 - 4.0 * r * p_mw))
    assert v2 > v_min
    return case, 1.3 * v_pu * (v_pu - v2) / r


@pytest.mark.parametrize("method", ["socp", "nlp", "minlp", "exact"])
@pytest.mark.parametrize(
    ("v_min", "v_pu"), [(0.9, 1.0), (0.85, 1.1), (0.8, 1.05), (0.7, 1.0), (0.6, 1.15)]
)
def test_a_load_at_the_lower_edge_of_a_wide_band_is_served(
    v_min: float, v_pu: float, method: str
) -> None:
    """The resistance puts the load at v_min + 0.005, where the lossy line is worst."""
    p_mw, v2 = 1.1, v_min + 0.005
    case, cost = far_load(v_min, v_pu, r=v2 * (v_pu - v2) / p_mw, p_mw=p_mw)
    found = solved(case, method)
    assert found.objective == pytest.approx(cost, rel=1e-5)
    assert found.bound == pytest.approx(cost, rel=1e-5)
    assert max(found.near_limits.values()) == 0.0


def test_the_lossy_line_that_was_reported_costs_3_27() -> None:
    """20 + j1 ohm at 10 kV, 1.1 MW for two hours at 1 $/MWh, a band from 0.6."""
    case = small_case(
        buses=2,
        lines=[(1, 2, 20.0 / BASE_OHM, 1.0 / BASE_OHM)],
        voltage_band_pu=(0.6, 1.1),
        load=[{"bus": "2", "p_max_mw": 1.1, "shed_cost_per_mwh": 100.0}],
        grid=[{"import_max_mw": 10.0, "import_cost_per_mwh": 1.0}],
    )
    assert solved(case, "minlp").objective == pytest.approx(3.27, abs=0.005)


PLANT = {"bus": "2", "p_max_mw": 1.0, "profile": "day"}
EXPORT = {
    "import_max_mw": 5.0,
    "import_cost_per_mwh": 60.0,
    "export_max_mw": 5.0,
    "export_cost_per_mwh": -50.0,
}


@pytest.mark.parametrize("curtailable", [True, False])
@pytest.mark.parametrize("method", ["lp", "milp", "minlp"])
def test_pv_at_1_6_of_its_peak_is_exported(method: str, curtailable: bool) -> None:
    case = small_case(
        slots=1,
        buses=2,
        lines=[(1, 2, 1e-5, 1e-5)],
        profiles={"day": [1.6]},
        pv=[{**PLANT, "curtailable": curtailable}],
        grid=[EXPORT],
    )
    assert solved(case, method).objective == pytest.approx(-80.0, abs=5e-3)


@pytest.mark.parametrize("line", [{"breakpoint": True}, {"switchable": True}])
@pytest.mark.parametrize("method", ["lp", "milp"])
def test_transport_over_a_breakpoint_or_a_switch_follows_the_profile(
    method: str, line: dict[str, bool]
) -> None:
    case = small_case(
        buses=2,
        lines=[(1, 2, 1e-4, 1e-4)],
        line_tables=[{"name": "1-2", **line}],
        profiles={"day": [1.6, 0.7]},
        load=[LOAD],
        grid=[GRID],
    )
    found = solved(case, method, "copperplate")
    assert found.objective == pytest.approx(1.3 * 2.3 * 1.4)


def test_a_rating_that_binds_is_no_auxiliary_limit() -> None:
    """1.5 MVA of 2.34 MW in the second slot: the rest is shed, and nothing is wrong with that."""
    case = two_buses(line_tables=[{"name": "1-2", "breakpoint": True, "rating_mva": 1.5}])
    runs: list[tuple[str, Physics | None]] = [
        ("lp", "copperplate"), ("lp", None), ("minlp", None)
    ]  # fmt: skip
    for method, physics in runs:
        found = solved(case, method, physics, gap=1e-5)
        assert found.of("load.shed", "load1")[1] == pytest.approx(0.84, abs=1e-3)
        assert max(found.near_limits.values(), default=0.0) == 0.0


def test_scenarios_of_a_high_demand_cost_575_43(tmp_path: Path) -> None:
    """Own extensive form: half a chance of an outage in the last slot, 1.6 MW all along."""
    case = small_case(
        slots=4,
        buses=2,
        lines=[(1, 2, 1e-3, 1e-3)],
        line_tables=[{"name": "1-2", "breakpoint": True}],
        profiles={"day": [1.6] * 4},
        load=[{**LOAD, "p_max_mw": 1.0, "shed_cost_per_mwh": 500.0}],
        ess=[
            {
                "bus": "2",
                "p_max_mw": 0.2,
                "e_mwh": 0.5,
                "soc_initial": 0.2,
                "efficiency_charge": 0.9,
                "efficiency_discharge": 0.9,
            }
        ],
        grid=[{"import_max_mw": 5.0, "import_cost_per_mwh": 40.0}],
    )
    scenarios = tmp_path / "outages.csv"
    scenarios.write_text("scenario,line,first,stop,weight\n0,1-2,3,4,0.5\n1,,,,0.5\n")
    plan = solve(case, "stochastic", outages=scenarios)
    assert plan.certificate.bound is not None
    assert plan.totals.objective == pytest.approx(575.4321, abs=1e-4)
    assert plan.certificate.bound == pytest.approx(575.4321, abs=1e-4)


def test_a_forecast_beyond_what_a_case_may_state_is_served() -> None:
    """Limits are data: whoever brings a profile brings the limits that it needs."""
    case = two_buses(line_tables=[{"name": "1-2", "breakpoint": True}])
    for physics in ("copperplate", "lindistflow", "distflow"):
        microgrid = Microgrid.build(case, physics)
        up = np.ones((1, 2), bool)
        far = microgrid.situation(up, lambda name: np.array([2.7, 3.9] if name else [1.0, 1.0]))
        data = microgrid.data(far)
        assert (data["line.forth"][0] > 1.3 * np.array([2.7, 3.9])).all()


def test_a_switch_and_a_block_refuse_what_their_rows_have_no_room_for() -> None:
    far = {"day": np.array([2.7, 3.9]), None: np.ones(2)}
    switched = Microgrid.build(two_buses(line_tables=[{"name": "1-2", "switchable": True}]))
    with pytest.raises(ValueError, match="its switch was built for"):
        switched.data(switched.situation(np.ones((1, 2), bool), far.__getitem__))
    block = Microgrid.build(two_buses(load=[{**LOAD, "block": True}]))
    with pytest.raises(UsageError, match=r"a block, asks for 5\.07 MW"):
        block.data(block.situation(np.ones((1, 2), bool), far.__getitem__))


@pytest.mark.parametrize("method", ["milp", "minlp"])
@pytest.mark.parametrize("name", ["line.p", "line.q", "line.l", "line.gap", "topology.feed"])
def test_the_referee_names_a_limit_that_binds(name: str, method: str) -> None:
    """With the limit lowered to where the plan is, the same plan is near it."""
    case = two_buses(
        load=[{**LOAD, "power_factor": 0.8}],
        line_tables=[{"name": "1-2", "switchable": True}],
        ess=[{"bus": "2", "p_max_mw": 0.3, "e_mwh": 0.7}],
        outages=["1-2@01:00-02:00"],
    )
    found = solved(case, method, gap=1e-4)
    standard, vectors = found.problem.standard, found.problem.vectors
    if not standard.has(name):
        assert (method, name) == ("milp", "line.l")
        return
    columns = standard.columns(name)
    k = int(np.abs(found.z[columns]).argmax())
    column, size = columns.ravel()[k], float(np.abs(found.z[columns]).max())
    assert size > 1e-3
    assert found.near_limits[name] == 0.0
    for share, near in ((1.0, 1.0), (0.5 * (1.0 + NEAR_LIMIT), 0.5)):
        upper, lower = vectors.upper.copy(), vectors.lower.copy()
        upper[column], lower[column] = size / share, -size / share
        checked = audit(standard, found.z, replace(vectors, upper=upper, lower=lower))
        assert checked.worst[f"auxiliary {name}"] == pytest.approx(near, abs=0.05)
        assert checked.where[f"auxiliary {name}"] == standard.column_name(int(column))
