"""Economic recourse is the optimum of the slot, on microgrids that chance drew."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from resilience.arrays import Floats
from resilience.case import Case
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import lower
from resilience.models.language.tree import Tree
from resilience.models.microgrid import Microgrid
from resilience.models.program.standard import Standard, Vectors
from resilience.models.program.unroll import unroll
from resilience.models.simulator import NetworkSimulator, Simulator, Step
from resilience.testing import small_case
from tests.property.random_cases import number, quick
from tests.stepping import Scene, assert_sound, scene

MEMBERS = 6
LOADS = {"p_max_mw": number(0.1, 1.5), "shed_cost_per_mwh": number(2, 9)}
DEVICES: dict[str, tuple[int, dict[str, st.SearchStrategy[Any]]]] = {
    "load": (4, {**LOADS, "priority": st.sampled_from([1.0, 1.0, 5.0])}),
    "pv": (
        2,
        {
            "p_max_mw": number(0.1, 1.5),
            "cost_per_mwh": number(-1, 1),
            "curtailable": st.sampled_from([True, True, False]),
        },
    ),
    "ess": (
        2,
        {
            "p_max_mw": number(0.2, 1.0),
            "e_mwh": number(0.5, 3.0),
            "efficiency_charge": number(0.8, 1.0),
            "efficiency_discharge": number(0.8, 1.0),
            "degradation_cost_per_mwh": number(0, 1),
            "grid_forming": st.booleans(),
        },
    ),
    "generator": (2, {"p_max_mw": number(0.2, 1.5), "cost_per_mwh": number(-1, 4)}),
    "grid": (
        2,
        {
            "import_max_mw": number(0.0, 2.0),
            "export_max_mw": number(0.0, 2.0),
            "import_cost_per_mwh": number(-2, 4),
            "export_cost_per_mwh": number(-3, 2),
        },
    ),
}


@st.composite
def cases(draw: st.DrawFn) -> Case:
    """Up to four buses in a tree or a mesh, every line a breakpoint or none; exports may pay,
    prices may be negative, several connections may differ, and power may have to be taken.
    """
    buses = draw(st.integers(1, 4))
    pairs = [(i, j) for j in range(2, buses + 1) for i in range(1, j)]
    tree = [(draw(st.integers(1, j - 1)), j) for j in range(2, buses + 1)]
    more = draw(st.lists(st.sampled_from(pairs), max_size=2)) if pairs else []
    lines = sorted({*tree, *more})
    weak = [draw(st.booleans()) for _ in lines]
    devices: dict[str, Any] = {}
    for kind, (most, keys) in DEVICES.items():
        table = st.fixed_dictionaries({"bus": st.integers(1, buses).map(str), **keys})
        least = 1 if kind == "generator" else 0
        devices[kind] = draw(st.lists(table, min_size=least, max_size=most))
    return small_case(
        buses=buses,
        lines=[(i, j, 1e-6, 1e-6) for i, j in lines],
        parallel_grids=True,
        line_tables=[
            {"name": f"{i}-{j}", "breakpoint": True}
            for (i, j), weak in zip(lines, weak, strict=True)
            if weak
        ],
        **devices,
    )


def optimum(problem: Standard, solver: Highs, seen: Scene, k: int, charging: Floats) -> float:
    """$ of the best dispatch of member k with storage fixed; inf where there is none.

    Every connection either imports or exports: all ways are tried, since a binary is only 0 or 1
    within a solver's tolerance.
    """
    one = {name: values[:, [k]] for name, values in seen.named.items()}
    vectors = problem.vectors(one, {"ess.energy": seen.energy[:, k]} if len(charging) else {})
    for name, sign in (("ess.charge", 1.0), ("ess.discharge", -1.0)):
        if len(charging):
            power = np.maximum(sign * charging, 0.0)
            vectors = vectors.fixed(problem.columns(name)[:, 0], power)
    if not problem.has("grid.import"):
        return _solved(solver, vectors)
    ways = np.stack([problem.columns(f"grid.{way}")[:, 0] for way in ("import", "export")])
    each = np.arange(ways.shape[1])
    return min(
        _solved(solver, vectors.fixed(ways[list(side), each], np.zeros(len(each))))
        for side in product((0, 1), repeat=len(each))
    )


def _solved(solver: Highs, vectors: Vectors) -> float:
    solver.update(vectors)
    return solver.solve().objective


@settings(quick, max_examples=60)
@given(cases(), st.integers(0, 2**16))
def test_economic_recourse_is_the_optimum_of_every_slot(case: Case, seed: int) -> None:
    """HiGHS finds nothing cheaper in any mode; where an order was not followed, or power
    was spilled, no dispatch at all could have followed it.
    """
    simulator = Simulator(Microgrid.build(case, "copperplate"), 1.0)
    seen = scene(simulator, MEMBERS, np.random.default_rng(seed))
    step: Step = simulator.step(*seen.all)
    assert_sound(simulator, seen, step)
    problem = unroll([simulator.microgrid.stage(1.0)], Tree.chain(["now"]))
    solver = Highs(lower(problem, modes={}))
    low, high = simulator.limits(seen.energy, seen.data)
    asked, done = np.clip(seen.action, low, high), step.charge - step.discharge
    for k in range(MEMBERS):
        if step.spill[:, k].max() < 1e-9:
            found = optimum(problem, solver, seen, k, done[:, k])
            np.testing.assert_allclose(step.cost[k], found, atol=1e-8)
        else:
            assert optimum(problem, solver, seen, k, done[:, k]) == np.inf
        if np.abs(done[:, k] - asked[:, k]).max(initial=0.0) > 1e-6:
            assert optimum(problem, solver, seen, k, asked[:, k]) == np.inf


@settings(quick, max_examples=40)
@given(cases(), st.integers(0, 2**16))
def test_the_network_step_agrees_where_the_network_does_not_matter(case: Case, seed: int) -> None:
    """At copperplate, and at lindistflow with wires so short that no voltage moves; two grids would
    hold two voltages alike, between which active power alone does not flow.
    """
    simulator = Simulator(Microgrid.build(case, "copperplate"), 1.0)
    seen = scene(simulator, MEMBERS, np.random.default_rng(seed))
    step = simulator.step(*seen.all)
    agree(step, NetworkSimulator(simulator.microgrid, 1.0).step(*seen.all))
    if len(case.grid) < 2 and len(case.network.line_names) < len(case.network.bus_names):
        wired = NetworkSimulator(Microgrid.build(case, "lindistflow"), 1.0)
        other = scene(wired, MEMBERS, np.random.default_rng(seed))
        np.testing.assert_array_equal(seen.energy, other.energy)
        found = wired.step(*other.all)
        assert_sound(wired, other, found, tolerance=1e-6)
        agree(step, found)


def agree(step: Step, other: Step) -> None:
    """Units that are cut back together may share the cut in another way."""
    for name in ("charge", "discharge", "spill"):
        ours, theirs = getattr(step, name).sum(0), getattr(other, name).sum(0)
        np.testing.assert_allclose(theirs, ours, atol=1e-6)
    whole = np.abs(step.charge - other.charge).max(0, initial=0.0) < 1e-6
    whole &= np.abs(step.discharge - other.discharge).max(0, initial=0.0) < 1e-6
    np.testing.assert_allclose(other.cost[whole], step.cost[whole], atol=1e-6)
    np.testing.assert_allclose(other.energy[:, whole], step.energy[:, whole], atol=1e-6)


@quick
@given(cases(), st.integers(0, 2**16))
def test_the_papers_recourse_conserves_energy_too(case: Case, seed: int) -> None:
    simulator = Simulator(Microgrid.build(case, "copperplate"), 1.0, "paper")
    seen = scene(simulator, 50, np.random.default_rng(seed))
    assert_sound(simulator, seen, simulator.step(*seen.all))


@quick
@given(cases(), st.integers(0, 2**16))
def test_a_member_does_not_see_the_others(case: Case, seed: int) -> None:
    simulator = Simulator(Microgrid.build(case, "copperplate"), 1.0)
    seen = scene(simulator, MEMBERS, np.random.default_rng(seed))
    whole = simulator.step(*seen.all)
    for k in range(MEMBERS):
        alone = simulator.step(*seen.of(k))
        np.testing.assert_allclose(alone.cost, whole.cost[[k]], atol=1e-12)
        np.testing.assert_allclose(alone.energy, whole.energy[:, [k]], atol=1e-12)
