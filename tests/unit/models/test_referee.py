"""The referee finds every kind of violation, says where it is, and takes nothing for granted."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from resilience.arrays import Floats
from resilience.models.language.stage import Stage
from resilience.models.language.tree import Cut, Tree
from resilience.models.program.referee import audit, row_violations, settle
from resilience.models.program.standard import Standard, Vectors
from resilience.models.program.unroll import unroll

SLOTS = ["t0", "t1", "t2"]


@pytest.fixture(scope="module")
def problem() -> Standard:
    """Every kind of row and structure, over three slots, and a cut at the end."""
    of = ["a", "b"]
    stage = Stage(1.0)
    now, after = stage.state("energy", of, 0.0, 9.0, unit="MWh")
    pos, neg = stage.split("mode", of, (4.0, 4.0), (4.0, 4.0))
    stage.eq("dynamics", after, now + pos - neg)
    stage.le("limit", pos, 3.0)
    u, v, x = (stage.var(name, of, -9.0, 9.0) for name in "uvx")
    stage.cone("flow", u, v, x)
    stage.disc("rating", 2.0, u, v)
    y = stage.var("y", of, -9.0, 9.0)
    stage.largest("most", y, u, v)
    stage.binary("on", of)
    points = np.array([[0.0, 1.0, 2.0]] * 2), np.array([[0.0, 1.0, 3.0]] * 2)
    stage.piecewise("curve", stage.var("power", of, 0.0, 2.0), *points, "$/h")
    return unroll([stage], Tree.chain(SLOTS), [Cut(1.0, {"energy": np.array([1.0, 0.0])})])


@pytest.fixture(scope="module")
def vectors(problem: Standard) -> Vectors:
    return problem.vectors({}, {"energy": [1.0, 2.0]})


@pytest.fixture
def good(problem: Standard) -> Floats:
    """A point at which all holds: energies stay, u = v = x = y = 1, the cut is tight."""
    z = np.zeros(problem.n_columns)
    z[problem.initial["energy"]] = 1.0, 2.0
    z[problem.columns("energy")] = np.array([[1.0], [2.0]])
    for name in "uvxy":
        z[problem.columns(name)] = 1.0
    z[problem.columns("curve.weight1")] = z[problem.columns("curve.weight2")] = 0.5
    z[problem.columns("power")], z[problem.columns("curve")] = 1.5, 2.0
    z[problem.future] = 2.0
    return z


def test_a_good_point_passes(problem: Standard, vectors: Vectors, good: Floats) -> None:
    found = audit(problem, good, vectors)
    assert found.maximum == 0.0
    assert set(found.worst) == {
        "dynamics", "limit", "cut", "bounds", "integrality",
        "mode", "flow", "rating", "most", "most.above0", "most.above1",
        "curve", "curve.one", "curve.x", "curve.y",
    }  # fmt: skip


WRONG: dict[str, tuple[str, Callable[[Standard, Floats], None]]] = {}


def wrong(where: str) -> Callable[[Callable[[Standard, Floats], None]], None]:
    """A way to spoil the good point at (b, t1), and the name under which it is found."""

    def note(spoil: Callable[[Standard, Floats], None]) -> None:
        WRONG[spoil.__name__] = where, spoil

    return note


@wrong("limit[b, t1]")
def row(problem: Standard, z: Floats) -> None:
    z[problem.columns("mode.pos")[1, 1:]] = 4.0  # and the energy with it, so that only it is wrong
    z[problem.columns("energy")[1, 1]] += 4.0
    z[problem.columns("energy")[1, 2]] += 4.0
    z[problem.columns("mode.pos")[1, 2]] = 0.0


@wrong("dynamics[b, t1]")
def dynamics(problem: Standard, z: Floats) -> None:
    z[problem.columns("energy")[1, 1:]] += 0.1


@wrong("mode[b, t1]")
def both_modes(problem: Standard, z: Floats) -> None:
    z[problem.columns("mode.pos")[1, 1]] = z[problem.columns("mode.neg")[1, 1]] = 0.5


@wrong("flow[b, t1]")
def open_cone(problem: Standard, z: Floats) -> None:
    z[problem.columns("x")[1, 1]] = 0.9


@wrong("rating[b, t1]")
def overload(problem: Standard, z: Floats) -> None:
    for name in "uvxy":
        z[problem.columns(name)[1, 1]] = 1.5


@wrong("most[b, t1]")
def loose_maximum(problem: Standard, z: Floats) -> None:
    z[problem.columns("y")[1, 1]] = 1.1


@wrong("curve[b, t1]")
def far_neighbours(problem: Standard, z: Floats) -> None:
    for name, value in {
        "curve.weight0": 0.5,
        "curve.weight1": 0.0,
        "power": 1.0,
        "curve": 1.5,
    }.items():
        z[problem.columns(name)[1, 1]] = value


@wrong("on[b, t1]")
def half_on(problem: Standard, z: Floats) -> None:
    z[problem.columns("on")[1, 1]] = 0.5


@wrong("cut[1, t2]")
def future_too_cheap(problem: Standard, z: Floats) -> None:
    z[problem.future] = 1.5


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_found_where_it_is(
    problem: Standard, vectors: Vectors, good: Floats, name: str
) -> None:
    where, spoil = WRONG[name]
    spoil(problem, good)
    found = audit(problem, good, vectors)
    assert found.name == where
    assert found.maximum > 0.01
    assert sorted(found.worst.values())[-2] < found.maximum


def test_a_value_beyond_its_bound_is_found(
    problem: Standard, vectors: Vectors, good: Floats
) -> None:
    good[problem.columns("x")[1, 1]] = -90.0
    found = audit(problem, good, vectors)
    assert found.where["bounds"] == "x[b, t1]"
    assert found.worst["bounds"] == pytest.approx(81.0 / 10.0)


def test_what_is_no_number_is_no_answer(problem: Standard, vectors: Vectors, good: Floats) -> None:
    good[problem.columns("u")[0, 2]] = np.nan
    assert audit(problem, good, vectors).maximum == np.inf


def test_dust_is_settled_and_what_is_no_dust_is_left(
    problem: Standard, vectors: Vectors, good: Floats
) -> None:
    on, x = problem.columns("on")[0], problem.columns("x")[0]
    good[on] = 1e-7, 1.0 - 1e-7, 0.3
    good[x] = 9.0 + 1e-9, -9.0 - 1e-9, 1.0
    settled = settle(problem, good, vectors)
    assert settled[on].tolist() == [0.0, 1.0, 0.3]
    assert settled[x].tolist() == [9.0, -9.0, 1.0]


def countdown(dt: float) -> Stage:
    """Hours left, which fall by dt; nothing holds them down but the wish to be exact."""
    stage = Stage(dt)
    now, after = stage.state("left", ["a"], 0.0, 9.0, unit="h")
    stage.largest("left.most", after, now - dt, now * 0.0)
    return stage


def test_maxima_are_settled_along_the_tree_whatever_the_durations() -> None:
    # Nodes of 2 h and 1 h by turns: 5.5 - 2 - 1 - 2, and then nothing is left of the last hour.
    tree = Tree(np.arange(4) - 1, np.ones(4), np.array([0, 1, 0, 1]), ("p", "q", "r", "s"))
    problem = unroll([countdown(2.0), countdown(1.0)], tree)
    vectors = problem.vectors({}, {"left": [5.5]})
    z = np.full(problem.n_columns, 9.0)
    settled = settle(problem, z, vectors)
    assert settled[problem.columns("left")[0]] == pytest.approx([3.5, 2.5, 0.5, 0.0])
    assert audit(problem, settled, vectors).maximum == 0.0


def test_a_row_is_measured_by_its_largest_term_whatever_its_sign() -> None:
    """2 x + 3 y of 20 at (3, 4) are 2 too few for terms of 6 and 12, and 4 x - y = 8 in place of 9
    for terms of 12 and 4.
    """
    stage = Stage(1.0)
    x, y = (stage.var(name, ["a"], -9.0, 9.0) for name in "xy")
    stage.le("need", 20.0 - x * 2.0 - y * 3.0)
    stage.eq("gap", y - x * 4.0 + 9.0)
    problem = unroll([stage], Tree.chain(["t0"]))
    z = np.zeros(problem.n_columns)
    z[problem.columns("x")], z[problem.columns("y")] = 3.0, 4.0
    off = row_violations(problem, z, problem.vectors({}, {}))
    assert off[problem.rows("need")].ravel().tolist() == pytest.approx([2.0 / 13.0])
    assert off[problem.rows("gap")].ravel().tolist() == pytest.approx([1.0 / 13.0])


def test_a_value_near_an_auxiliary_bound_is_noted_on_either_side() -> None:
    """From 99 % of -4 and of 7 on, where the bound is there for solvers."""
    stage = Stage(1.0)
    stage.var("flow", ["a", "b", "c"], -4.0, 7.0)
    stage.mark_auxiliary("flow", np.array([True, True, False]))
    problem = unroll([stage], Tree.chain(["t0"]))
    vectors, z = problem.vectors({}, {}), np.zeros(problem.n_columns)
    z[problem.columns("flow")[:, 0]] = -3.99, 6.9, -4.0
    found = audit(problem, z, vectors)
    assert found.worst["auxiliary flow"] == pytest.approx(0.75, abs=1e-4)
    assert found.where["auxiliary flow"] == "flow[a, t0]"
    z[problem.columns("flow")[:, 0]] = -3.9, 6.986, -4.0
    found = audit(problem, z, vectors)
    assert found.worst["auxiliary flow"] == pytest.approx(0.8, abs=1e-4)
    assert found.where["auxiliary flow"] == "flow[b, t0]"


def test_where_a_rating_is_exceeded_no_auxiliary_bound_is_judged() -> None:
    """Such a point is an answer to less than the model, and may go to any limit."""
    stage = Stage(1.0)
    flow = stage.var("flow", ["a"], -4.0, 4.0)
    stage.mark_auxiliary("flow", np.array([True]))
    stage.disc("rating", 3.5, flow, flow * 0.0)
    problem = unroll([stage], Tree.chain(["t0"]))
    vectors, z = problem.vectors({}, {}), np.zeros(problem.n_columns)
    z[problem.columns("flow")] = 4.0
    assert set(audit(problem, z, vectors).worst) == {"bounds", "rating"}
    z[problem.columns("flow")] = 3.5
    assert audit(problem, z, vectors).worst["auxiliary flow"] == 0.0
