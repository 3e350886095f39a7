"""Every backend on every tiny problem: the optimum where it holds all, a bound where it relaxes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from resilience.arrays import Floats
from resilience.errors import UsageError
from resilience.models.backends.casadi import NLP
from resilience.models.backends.conic import Conic
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import lower
from resilience.models.backends.pyomo import Pyomo
from resilience.models.language.stage import Stage
from resilience.models.program.referee import audit, settle
from resilience.models.program.standard import Standard
from resilience.models.structures import Angle, Cone, Disc, Largest, Structure
from resilience.testing import TINY, TinyProgram
from resilience.testing.backends import CHANGED_DATA
from resilience.testing.tiny import one_node
from resilience.testing.tiny_linear import CUTS
from resilience.testing.tiny_structures import one_cone

BACKENDS: dict[str, Callable[[Standard], Any]] = {
    "highs": lambda problem: Highs(problem, gap=0.0),
    "pyomo-highs": Pyomo,
    "pyomo-scip": lambda problem: Pyomo(problem, solver="scip"),
    "conic": Conic,
    "nlp": NLP,
}
EXACT = {
    "highs": Highs.exact,
    "pyomo-highs": Pyomo.exact - {Disc, Cone, Angle},
    "pyomo-scip": Pyomo.exact,
    "conic": Conic.exact,
    "nlp": NLP.exact,
}
INTEGERS = {"highs", "pyomo-highs", "pyomo-scip"}
CONVEX: frozenset[type[Structure]] = frozenset({Disc, Largest})
TOLERANCE = {"pyomo-scip": 2e-6, "nlp": 1e-6}
BUILT = {name: build() for name, build in TINY.items()}


def pairs(wanted: Callable[[TinyProgram, str], bool]) -> Any:
    chosen = [(name, b) for name, tiny in BUILT.items() for b in BACKENDS if wanted(tiny, b)]
    return pytest.mark.parametrize(("name", "backend"), chosen)


def solved(tiny: TinyProgram, backend: str) -> tuple[Any, Any]:
    solver = BACKENDS[backend](tiny.standard)
    solver.update(tiny.vectors)
    return solver, solver.solve()


@pairs(lambda tiny, b: tiny.needs <= EXACT[b] and (b in INTEGERS or not tiny.integers))
def test_the_optimum_is_found_where_everything_is_held(name: str, backend: str) -> None:
    tiny = TINY[name]()
    _, found = solved(tiny, backend)
    tolerance = TOLERANCE.get(backend, 1e-7)
    assert found.status == "optimal"
    assert found.objective == pytest.approx(tiny.optimum, abs=tolerance)
    assert found.bound <= tiny.optimum + tolerance
    vectors = tiny.vectors
    z = settle(tiny.standard, found.point, vectors)
    assert audit(tiny.standard, z, vectors).maximum <= 1e-6
    assert vectors.cost @ z + vectors.offset == pytest.approx(tiny.optimum, abs=tolerance)


@pairs(lambda tiny, backend: tiny.relaxed is not None and backend == "conic")
def test_what_is_relaxed_gives_the_optimum_of_the_relaxation(name: str, backend: str) -> None:
    tiny = TINY[name]()
    _, found = solved(tiny, backend)
    assert found.objective == pytest.approx(tiny.relaxed, abs=1e-6)
    assert tiny.relaxed is not None
    assert tiny.relaxed - 1e-6 <= found.bound <= tiny.relaxed + 1e-9
    assert found.bound <= tiny.optimum + 1e-9


POLYGONS = {  # optimum of the polygon with 12 sides within, and of the one around
    # The vertex of either that lies nearest to (3, 4) is at 45 degrees.
    "disc": (-7.0 * np.sqrt(2.0), -7.0 * np.sqrt(2.0) / np.cos(np.pi / 12)),
    "disc_below": (-7.0 * np.sqrt(2.0), -7.0 * np.sqrt(2.0) / np.cos(np.pi / 12)),
    # A side of either is normal to the x axis, and one to the y axis.
    "shifted_disc": (1.0 - 2.0 * np.cos(np.pi / 12), -1.0),
    "shifted_disc_below": (-1.0 - 2.0 * np.cos(np.pi / 12), -3.0),
    "shifted_disc_beside": (-0.7 - 2.0 * np.cos(np.pi / 12), -2.7),
}


@pytest.mark.parametrize("name", POLYGONS)
@pytest.mark.parametrize("backend", ["highs", "pyomo-highs"])
def test_a_polygon_within_a_disc_costs_more_and_one_around_it_less(name: str, backend: str) -> None:
    tiny, (inner, outer) = TINY[name](), POLYGONS[name]
    _, found = solved(tiny, backend)
    assert found.objective == pytest.approx(inner, abs=1e-9)
    around = Highs(lower(tiny.standard, discs="outer"))
    around.update(tiny.vectors)
    assert around.solve().objective == pytest.approx(outer, abs=1e-9)
    assert outer <= tiny.optimum + 1e-9
    assert inner >= tiny.optimum


@pytest.mark.parametrize("name", CHANGED_DATA)
@pytest.mark.parametrize("backend", BACKENDS)
def test_new_data_gives_what_a_fresh_build_gives(name: str, backend: str) -> None:
    first, other = TINY[name](), TINY[name](**CHANGED_DATA[name])
    assert other.optimum != pytest.approx(first.optimum)
    solver, _ = solved(first, backend)
    for tiny in (other, first, other):
        solver.update(first.standard.vectors(tiny.data, tiny.x0))
        found = solver.solve().objective
        assert found == pytest.approx(tiny.optimum, abs=2e-6)
        assert found == pytest.approx(solved(tiny, backend)[1].objective, abs=2e-6)


@pytest.mark.parametrize("name", ["terminal", "terminal_fan"])
@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("built_in", [0, 1], ids=["all later", "one before"])
def test_cuts_added_later_are_worth_what_cuts_built_in_are(
    name: str, backend: str, built_in: int
) -> None:
    tiny, bare = TINY[name](), TINY[name](cuts=CUTS[:built_in])
    vectors = bare.vectors
    solver = BACKENDS[backend](bare.standard)
    solver.update(vectors)
    free = solver.solve().objective
    assert built_in or free < tiny.optimum - 0.5
    for leaf in bare.standard.tree.leaves:
        for some in (CUTS[built_in:2], CUTS[2:]):
            alpha = np.array([cut.alpha for cut in some])
            solver.add_cuts(leaf, alpha, np.array([cut.beta["store"] for cut in some]))
    for _ in range(2):
        assert solver.solve().objective == pytest.approx(tiny.optimum, abs=2e-6)
        solver.update(vectors)


@pytest.mark.parametrize("backend", ["pyomo-highs", "conic", "nlp"])
def test_a_cut_that_is_not_at_a_leaf_is_refused(backend: str) -> None:
    solver, _ = solved(TINY["terminal_fan"](cuts=()), backend)
    with pytest.raises(ValueError, match=r"leaves: \[1, 2\]"):
        solver.add_cuts(0, np.array([1.0]), np.array([[0.0]]))


@pytest.mark.parametrize("slopes", [[[0.7, 0.4]], [[]], [[0.7], [0.3]], [0.7]])
@pytest.mark.parametrize("backend", ["highs", "conic", "nlp", "pyomo-highs"])
def test_a_cut_that_is_not_of_the_states_is_refused(backend: str, slopes: list[Any]) -> None:
    solver, _ = solved(TINY["terminal_fan"](cuts=()), backend)
    with pytest.raises(ValueError, match=r"slopes of shape .*; allowed: \(1, 1\)"):
        solver.add_cuts(2, np.array([1.5]), np.array(slopes))


@pytest.mark.parametrize("backend", ["highs", "conic"])
def test_the_bound_stays_proven_with_cuts(backend: str) -> None:
    tiny, bare = TINY["terminal"](), TINY["terminal"](cuts=())
    solver, _ = solved(bare, backend)
    for cut in CUTS:
        solver.add_cuts(0, np.array([cut.alpha]), cut.beta["store"][None])
    bound = solver.solve().bound
    assert tiny.optimum - 1e-6 <= bound <= tiny.optimum + 1e-9


@pytest.mark.parametrize("name", ["chain", "fan", "terminal", "durations"])
@pytest.mark.parametrize("backend", ["highs", "conic", "nlp"])
def test_the_price_of_a_state_is_the_slope_of_the_optimum(name: str, backend: str) -> None:
    tiny = TINY[name]()
    (state,) = tiny.x0
    start, step = tiny.x0[state][0] + 0.1, 0.01  # away from the kinks
    solver = BACKENDS[backend](tiny.standard)
    value = {}
    for x in (start - step, start, start + step):
        solver.update(tiny.standard.vectors(tiny.data, {state: [x]}))
        value[x] = solver.solve()
    slope = (value[start + step].objective - value[start - step].objective) / (2 * step)
    assert value[start].state_price == pytest.approx([slope], abs=1e-4)
    assert abs(slope) > 0.05


@pairs(lambda tiny, b: b in ("highs", "conic") and tiny.needs <= CONVEX and not tiny.integers)
def test_the_certified_bound_is_at_most_the_optimum_and_close(name: str, backend: str) -> None:
    tiny = TINY[name]()
    solver, found = solved(tiny, backend)
    proven, optimum = found.bound, tiny.optimum
    if backend == "highs":
        proven = solver.certified_bound(found)
        if Disc in tiny.needs:
            optimum = POLYGONS[name][0]
    assert optimum - 1e-6 <= proven <= optimum + 1e-12


def battery() -> tuple[Standard, Any]:
    """1.5 MWh are to be left of 1 MWh after three hours of rest."""
    tiny = TINY["chain"]()
    problem = tiny.standard
    vectors = problem.vectors(tiny.data, tiny.x0)
    rest = np.concatenate([problem.columns(word)[0] for word in ("buy", "sell")])
    end = problem.columns("energy")[0, 2]
    return problem, vectors.fixed(np.append(rest, end), np.append(np.zeros(6), 1.5))


def fixed_row() -> tuple[Standard, Any]:
    """A column that is fixed at 1 and may not exceed 0.5, beside one that is free."""
    stage = Stage(1.0)
    stage.le("limit", stage.var("x", ["a"], 1.0, 1.0), 0.5)
    stage.cost("y", stage.var("y", ["a"], 0.0, 1.0))
    problem = one_node(stage)
    return problem, problem.vectors({}, {})


def fixed_cone() -> tuple[Standard, Any]:
    """0 v = 1^2, with v free."""
    tiny = one_cone(0.0, 1.0, 1.0, np.inf, np.inf, "out, but loaded")
    return tiny.standard, tiny.standard.vectors({}, {})


RELAX_CONES = ("highs", "pyomo-highs")


@pytest.mark.parametrize(
    ("impossible", "backend"),
    [
        pytest.param(build, backend, id=f"{build.__name__}-{backend}")
        for build in (battery, fixed_row, fixed_cone)
        for backend in BACKENDS
        if build is not fixed_cone or backend not in RELAX_CONES
    ],
)
def test_what_cannot_be_is_called_infeasible(
    impossible: Callable[[], tuple[Standard, Any]], backend: str
) -> None:
    problem, vectors = impossible()
    solver = BACKENDS[backend](problem)
    solver.update(vectors)
    found = solver.solve()
    assert found.z is None
    assert found.status in (("infeasible", "none") if backend == "nlp" else ("infeasible",))


@pytest.mark.parametrize("backend", ["highs", "conic"])
def test_what_conflicts_has_the_names_of_the_model(backend: str) -> None:
    problem, vectors = battery()
    solver = BACKENDS[backend](problem)
    solver.update(vectors)
    assert solver.solve().status == "infeasible"
    named = solver.conflict()
    assert any(name.startswith("dynamics[a, t") for name in named)
    assert all("[a, " in name for name in named)


@pytest.mark.parametrize("backend", BACKENDS)
def test_bounds_that_cross_are_infeasible_for_all(backend: str) -> None:
    tiny = TINY["data"](cap=-1.0)
    solver, found = solved(tiny, backend)
    assert found.status == "infeasible"
    if hasattr(solver, "conflict"):
        assert solver.conflict() == ["bounds of x[a, now]"]


class Length(Structure):
    """r = |(x, y)|, which nobody has said how to state."""

    title = "length"
    complaint = "lengths off"

    def violation(self, args: Sequence[Floats], limits: Sequence[Floats]) -> Floats:
        r, y, x = args
        return np.abs(r - np.hypot(y, x))


def unknown() -> Standard:
    stage = Stage(1.0)
    stage.structure(
        Length, "hypotenuse", tuple(stage.var(name, ["a"], -1.0, 1.0) for name in "ryx")
    )
    return one_node(stage)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_structure_that_a_backend_does_not_know_is_refused_by_name(backend: str) -> None:
    with pytest.raises(UsageError, match=r"cannot hold the length 'hypotenuse'; allowed: .*disc"):
        BACKENDS[backend](unknown())


def test_the_referee_audits_a_structure_that_no_backend_knows() -> None:
    problem = unknown()
    z = np.zeros(problem.n_columns)
    for name, value in {"r": 0.75, "y": 0.3, "x": 0.4}.items():
        z[problem.columns(name)] = value
    checked = audit(problem, z, problem.vectors({}, {}))
    assert checked.worst["hypotenuse"] == pytest.approx(0.25)
    assert checked.name == "hypotenuse[a, now]"
