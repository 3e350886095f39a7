"""The installed meshes: what the network of ieee14 carries, and what closed ties are worth."""

from __future__ import annotations

import numpy as np
import pytest

import resilience as rs
from resilience.case import load_case
from resilience.models.case_program import CaseProgram, horizon
from resilience.models.methods import MethodOptions, MethodResult, conic
from resilience.models.methods.meshed import with_cliques
from tests.known.ybus import Pi, power_flow


def test_ieee14_keeps_its_voltage_at_full_load_without_local_sources() -> None:
    """Taps, charging and the capacitor in an independent power flow, which has a slack of 1 pu."""
    case = load_case("ieee14")
    network = case.network
    branches = [
        Pi(
            int(network.from_bus[k]) + 1,
            int(network.to_bus[k]) + 1,
            float(network.r_pu[k]),
            float(network.x_pu[k]),
            b=float((network.y_from_pu + network.y_to_pu)[k].imag),
            tap=float(network.tap[k]),
        )
        for k in range(len(network.line_names))
    ]
    shunts = {b + 1: complex(y) for b, y in enumerate(network.y_bus_pu) if y}
    full, none = np.zeros(14, complex), np.zeros(14, complex)
    for load in case.load:
        full[network.bus(load.bus)] -= complex(load.p_max_mw, load.q_peak_mvar)
    volts = np.abs(power_flow(branches, full.tolist(), shunts).volts)
    assert volts.min() == pytest.approx(0.917, abs=5e-4)
    assert np.abs(power_flow(branches, none.tolist(), shunts).volts).max() == pytest.approx(
        1.10, abs=5e-3
    )


def test_lines_of_ieee14_are_of_the_archive() -> None:
    """16 times the impedances on 100 MVA, and a sixteenth of the charging."""
    network = load_case("ieee14").network
    assert network.line_names[0] == "1-2"
    z = (network.r_pu + 1j * network.x_pu) * 100.0 / 16.0
    np.testing.assert_allclose(z[[0, 9]], [0.01938 + 0.05917j, 0.25202j], rtol=1e-6)
    b = (network.y_from_pu + network.y_to_pu).imag * 16.0 / 100.0
    np.testing.assert_allclose(b[:2], [0.0528, 0.0492], rtol=1e-6)


def test_bounds_of_rows_on_loops_are_as_high_as_their_points(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A current is bounded a thousand times above what flows, where nothing draws it down.

    Clarabel leaves 1e-6 $ on some of them, which those bounds made 0.007 % of the cost.
    """
    monkeypatch.setattr(conic, "MAX_CUT_ROUNDS", 3)

    def last_round(program: CaseProgram, options: MethodOptions) -> MethodResult:
        deadline = options.deadline()
        root = conic.root(program, options, deadline)
        tighter = conic.tightened(program, root, options, deadline)
        return MethodResult.from_solution(program, tighter, tighter.bound, options.gap, "")

    case = load_case("ieee14").replace(outages="")
    found = with_cliques(last_round)(horizon(case, "distflow"), MethodOptions(gap=1e-6))
    assert found.objective == pytest.approx(32.0133, abs=5e-4)
    assert 0.0 <= found.objective - found.bound <= 1e-5 * found.objective


@pytest.mark.slow
def test_closed_ties_of_ieee33_are_worth_what_a_prototype_found() -> None:
    """Bound and plan of a prototype of its own; radial, the same day costs 36.4669 $."""
    plan = rs.solve(load_case("ieee33-meshed"), method="minlp", time_limit=300.0)
    assert isinstance(plan, rs.Plan)
    assert plan.objective == pytest.approx(35.58252, rel=2e-4)
    assert plan.bound is not None
    assert plan.bound == pytest.approx(35.57848, rel=2e-4)
    assert plan.bound <= plan.objective
