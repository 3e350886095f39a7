"""A plan under DistFlow is an AC power flow: pandapower finds the same voltages and losses."""

from typing import Any

import numpy as np
import pytest

from resilience.arrays import Floats
from resilience.case import Case, load_case
from resilience.models.backends.conic import Conic
from resilience.models.methods.answer import worst_violation
from resilience.testing import small_case
from tests.known.solving import Solved, power, solved


def power_flow(found: Solved, t: int) -> tuple[Floats, Floats]:
    """Voltages in pu (buses,) and power in MVA of every root, from the plan's injections in slot t.

    The root of an island, held at the plan's voltage, is its grid or its first forming bus.
    """
    import pandapower as pp

    microgrid, z_base = found.problem.microgrid, found.problem.microgrid.network.vn_kv[0] ** 2
    network, up = microgrid.network, found.problem.data["line.up"][:, t] > 0.5
    p, q = power(found)
    net = pp.create_empty_network(sn_mva=1.0)
    for name, vn_kv in zip(network.bus_names, network.vn_kv, strict=True):
        pp.create_bus(net, vn_kv, name=name)
    for k, (i, j) in enumerate(zip(network.from_bus, network.to_bus, strict=True)):
        ohm = network.r_pu[k] * z_base, network.x_pu[k] * z_base
        pp.create_line_from_parameters(net, i, j, 1.0, *ohm, 0.0, 99.0, in_service=bool(up[k]))
    for bus in range(len(p)):
        pp.create_sgen(net, bus, p[bus, t], q[bus, t])
    roots = roots_of(found, t)
    for bus in roots:
        net.sgen.loc[bus, ["p_mw", "q_mvar"]] = 0.0
        pp.create_ext_grid(net, bus, vm_pu=np.sqrt(found["bus.v_sq"][bus, t]))
    pp.runpp(net, numba=False, tolerance_mva=1e-9, init="flat")
    fed = net.res_ext_grid.p_mw.to_numpy() - p[roots, t]
    also = net.res_ext_grid.q_mvar.to_numpy() - q[roots, t]
    return net.res_bus.vm_pu.to_numpy(), np.hypot(fed, also)


def roots_of(found: Solved, t: int) -> list[int]:
    """One bus per live island: that of a grid if there is one."""
    situation, microgrid = found.problem.situation, found.problem.microgrid
    at_grid = set(microgrid.bus_index(found.problem.case.grid).tolist())
    order = sorted(np.flatnonzero(situation.forming), key=lambda b: int(b) not in at_grid)
    roots: dict[int, int] = {}
    for bus in order:
        roots.setdefault(int(situation.island[bus, t]), int(bus))
    return list(roots.values())


def compare(found: Solved, slots: Any) -> None:
    for t in slots:
        voltage, mismatch = power_flow(found, t)
        alive = found.problem.situation.alive[:, t] > 0.5
        planned = np.sqrt(found["bus.v_sq"][:, t])
        assert voltage[alive] == pytest.approx(planned[alive], abs=1e-5)
        assert mismatch.max() < 1e-4


@pytest.mark.parametrize("method", ["socp", "minlp"])
def test_ieee33_in_its_storm(method: str) -> None:
    case = load_case("ieee33")
    storm = case.replace(start=case.start.replace(hour=13), slots=24)
    found = solved(storm, method)
    assert not found.answer.relaxed
    compare(found, [0, 4, 8, 12, 20])


def island(sun: float) -> Case:
    """Four buses without grid, 1 MW of load, storage almost full, curtailable PV."""
    return small_case(
        slots=4,
        buses=4,
        lines=[(1, 2, 0.02, 0.01), (2, 3, 0.03, 0.02), (2, 4, 0.02, 0.02)],
        ess=[{"p_max_mw": 1.0, "e_mwh": 2.0, "soc_initial": 0.95, "s_mva": 1.5}
             | {"efficiency_charge": 0.95, "efficiency_discharge": 0.95}
             | {"degradation_cost_per_mwh": 0.2}],
        pv=[{"bus": "3", "p_max_mw": sun, "s_mva": 1.1 * sun}, {"bus": "4", "p_max_mw": sun / 3}],
        load=[{"bus": "2", "p_max_mw": 0.6, "power_factor": 0.95, "shed_cost_per_mwh": 1.5},
              {"bus": "4", "p_max_mw": 0.4, "power_factor": 0.95, "shed_cost_per_mwh": 1.5}],
    )  # fmt: skip


def test_where_surplus_is_free_the_relaxation_alone_is_no_power_flow() -> None:
    """Losses cost nothing there, so nothing holds the cones closed; the objective is right."""
    problem = solved(island(3.0), "minlp").problem
    solver = Conic(problem.standard)
    solver.update(problem.vectors)
    plain = solver.solve()
    assert worst_violation(problem.standard, plain.point) > 1e-3
    assert plain.objective == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("method", ["socp", "nlp", "minlp"])
def test_a_slight_price_on_losses_or_ipopt_closes_the_cones(method: str) -> None:
    found = solved(island(3.0), method)
    assert not found.answer.relaxed
    assert found.objective == pytest.approx(0.0, abs=1e-5)
    assert found["load.shed"].max() < 1e-6
    compare(found, range(4))


def test_an_island_short_of_power_closes_its_cones_by_itself() -> None:
    found = solved(island(0.3), "minlp")
    assert not found.answer.relaxed
    assert found.answer.status == "optimal"
    assert found.objective > 0.1
    compare(found, range(4))


def test_must_take_surplus_is_polished_and_its_gap_reported() -> None:
    """The relaxation burns surplus in the wires, as much as their currents may be; the AC plan has
    to export 1.5 MW less what is really lost, and pays.
    """
    case = small_case(
        slots=2,
        buses=3,
        lines=[(1, 2, 0.01, 0.01), (2, 3, 0.02, 0.02)],
        grid=[{"import_max_mw": 5.0, "export_max_mw": 5.0, "import_cost_per_mwh": 1.0}
              | {"export_cost_per_mwh": 1.0}],
        pv=[{"bus": "3", "p_max_mw": 2.0, "curtailable": False}],
        load=[{"bus": "2", "p_max_mw": 0.5, "power_factor": 0.9, "shed_cost_per_mwh": 5.0}],
    )  # fmt: skip
    found = solved(case, "minlp")
    assert not found.answer.relaxed
    assert found.answer.status == "feasible"
    compare(found, range(2))
    r = np.array([0.01, 0.02])
    most = found.problem.vectors.upper[found.problem.standard.columns("line.l")]
    assert found.bound == pytest.approx((1.5 - r @ most).sum(), rel=1e-6)
    assert found.objective == pytest.approx((1.5 - r @ found["line.l"]).sum(), rel=1e-6)
    assert found["line.l"].max() < 0.7 * most.min()
    assert any("cones open" in text for text in solved(case, "socp").answer.relaxed)


CASES = {
    "surplus": lambda: island(3.0),
    "short": lambda: island(0.3),
    "precharge": lambda: load_case("analytic/precharge"),
    "ieee33": lambda: load_case("ieee33").replace(slots=8),
}


@pytest.mark.parametrize("name", CASES)
def test_no_bound_lies_above_an_ac_plan(name: str) -> None:
    case = CASES[name]()
    ac = solved(case, "nlp")
    slack = 1e-7 * (1 + abs(ac.objective))
    for method in ("socp", "minlp", "exact"):
        if method == "exact":
            pytest.importorskip("pyscipopt", reason="the extra `exact` is not installed")
        assert solved(case, method).bound <= ac.objective + slack
    assert solved(case, "lp").bound <= ac.objective + slack
