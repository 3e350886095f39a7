"""The L-shaped method against the extensive form, on random programs."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
import pytest

from resilience.arrays import Floats
from resilience.errors import InfeasibleError, SolverError
from resilience.models.backends.base import NOTHING, OutOfTimeError, Solution
from resilience.models.backends.highs import Highs
from resilience.models.backends.plain import Plain
from resilience.models.language.stage import Stage
from resilience.models.language.tree import Cut, Tree
from resilience.models.methods.answer import GRACE_S
from resilience.models.program.risk import Risk
from resilience.planning.two_stage.extensive import extensive
from resilience.planning.two_stage.lshaped import DecompositionOptions, lshaped
from resilience.planning.two_stage.master import Master
from resilience.planning.two_stage.recourse import Recourse, SecondStage
from resilience.planning.two_stage.two_stage import TwoStage

STATES = ("a", "b")
TIGHT = DecompositionOptions(gap=1e-9)


def stage(rng: np.random.Generator) -> Stage:
    """Two stores, filled at a price, that serve demands; what is missing is bought dearly."""
    made = Stage(1.0)
    now, after = made.state("store", STATES, 0.0, [3.0, 2.0], unit="1")
    demand, price = made.data("demand", STATES), made.data("price", STATES)
    fill = made.var("fill", STATES, 0.0, 1.5)
    use = made.var("use", STATES, 0.0, 2.0)
    short = made.var("short", STATES, 0.0, 9.0)
    made.eq("stores", after, now * rng.uniform(0.8, 1.0, 2) + fill - use)
    mixing = np.eye(2) + rng.uniform(0.0, 0.3, (2, 2))
    made.le("serve", demand, use.mapped(mixing) + short)
    made.cost("filling", fill, price)
    made.cost("missing", short, rng.uniform(4.0, 9.0, 2))
    made.cost("holding", now, rng.uniform(0.0, 0.2, 2))  # a price of the states themselves
    made.cost("standing", fill * 0.0 + 0.7, price)  # whatever is done
    return made


def program(
    seed: int, risk: Risk | None = None, *, trunk: int = 3, chains: int = 6, apart: bool = True
) -> TwoStage:
    """A trunk, and chains of random weight that leave it anywhere, the start included."""
    rng = np.random.default_rng(seed)
    leaves = rng.integers(-1, trunk - 1, chains) if apart else np.full(chains, trunk - 1)
    horizon = trunk + 3
    weight = rng.random(chains + 1) + 0.2
    weight /= weight.sum()
    if not apart:
        weight[:-1] /= weight[:-1].sum()
        weight[-1] = 0.0
    parent, chance = list(range(-1, trunk - 1)), []
    for t in range(trunk):
        chance.append(weight[-1] + weight[:-1][leaves >= t].sum())
    labels, slots = [f"t{t}" for t in range(trunk)], list(range(trunk))
    for k in range(chains):
        for t in range(leaves[k] + 1, horizon):
            parent.append(int(leaves[k]) if t == leaves[k] + 1 else len(parent) - 1)
            chance.append(weight[k])
            labels.append(f"t{t} in scenario {k}")
            slots.append(t)
    kinds = (np.array(slots) >= horizon - 2).astype(int)  # the last two steps are of another stage
    tree = Tree(np.array(parent), np.array(chance), kinds, tuple(labels))
    data = {
        "demand": rng.uniform(0.0, 3.0, (2, tree.n)),
        "price": rng.uniform(0.5, 3.0, (2, tree.n)),
    }
    value = Cut(0.0, {"store": np.array([-0.7, -0.4])})
    start = {"store": np.array([1.0, 0.5])}
    return TwoStage([stage(rng), stage(rng)], tree, trunk, data, start, [value], risk or Risk())


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("risk", [Risk(), Risk(0.7, 0.5), Risk(0.5, 1.0)], ids=str)
def test_it_is_the_extensive_form(seed: int, risk: Risk) -> None:
    two = program(seed, risk, apart=seed % 2 == 0)
    cut, whole = lshaped(two, TIGHT), extensive(two, TIGHT)
    assert cut.objective == pytest.approx(whole.objective, rel=1e-8)
    assert cut.bound == pytest.approx(whole.objective, rel=1e-8)
    # Not capped: sums of some hundred doubles, in two orders.
    assert cut.bound <= cut.objective + 1e-12 * two.cost_scale
    for found in (cut, whole):
        assert found.probability.sum() == pytest.approx(1.0)
        assert risk.value(found.cost, found.probability) == pytest.approx(found.objective)


def test_the_bound_of_the_extensive_form_is_that_of_its_multipliers(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A solver whose multipliers are a little off, and which says that its bound is far above."""
    two = program(2)
    best = extensive(two, TIGHT).objective
    solve = Highs.solve

    def careless(solver: Highs) -> Solution:
        found = solve(solver)
        assert found.duals is not None
        noise = np.random.default_rng(5).normal(size=len(found.duals.rows))
        off = replace(found.duals, rows=found.duals.rows + 0.05 * noise)
        return replace(found, bound=found.objective + 1000.0, duals=off)

    monkeypatch.setattr(Highs, "solve", careless)
    found = extensive(two, TIGHT)
    assert found.objective == pytest.approx(best, rel=1e-9)
    assert found.bound < best - 0.01
    assert found.status == "feasible"


def test_it_says_how_it_came_to_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rounds are counted as the second stage is solved; a cost at the start needs a start."""
    two, calls = program(4), list[int]()
    solve = Recourse.solve
    monkeypatch.setattr(Recourse, "solve", lambda self, x: calls.append(1) or solve(self, x))
    found = lshaped(two, TIGHT)
    assert found.iterations == len(calls) >= 2
    assert found.start_cost is None
    again = lshaped(two, replace(TIGHT, start=np.full((two.trunk, 2), 0.3)))
    assert again.start_cost is not None
    assert again.iterations == len(calls) - found.iterations


def test_columns_that_are_held_idle_are_zero_and_cost_as_in_one_piece() -> None:
    """The first store of branch 2 is not filled any more, nor is the second in the trunk."""
    two = program(6)
    standard = two.programs[two.branches[2].program]
    idle = {2: standard.columns("fill")[0]}
    trunk = two.first.columns("fill")[1]
    options = replace(TIGHT, idle_branches=idle, idle_trunk=trunk)
    cut, whole, free = lshaped(two, options), extensive(two, options), lshaped(two, TIGHT)
    assert cut.objective == pytest.approx(whole.objective, rel=1e-8)
    assert cut.objective > free.objective + 1e-3
    assert np.abs(cut.points[2][idle[2]]).max() == 0.0
    assert np.abs(cut.trunk[trunk]).max() == 0.0


def test_a_solver_that_stops_without_an_answer_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    two = program(2)
    recourse = Recourse(two)
    monkeypatch.setattr(Highs, "solve", lambda solver: NOTHING)
    with pytest.raises(SolverError, match=r"no recourse from 't\d in scenario 0' on"):
        recourse.solve(np.full((len(two.branches), 2), 0.6))


def test_a_start_changes_the_way_and_not_the_end() -> None:
    two = program(3)
    states = np.full((two.trunk, 2), 0.4)
    found = lshaped(two, DecompositionOptions(gap=1e-9, start=states))
    assert found.start_cost is not None
    assert two.risk.value(found.start_cost, found.probability) >= found.objective
    assert found.objective == pytest.approx(extensive(two, TIGHT).objective, rel=1e-8)


@pytest.mark.parametrize("seed", range(3))
def test_cuts_hold_everywhere_and_touch_where_they_were_made(seed: int) -> None:
    two, rng = program(seed, chains=8), np.random.default_rng(seed)
    recourse, n = Recourse(two), len(two.branches)
    here = rng.uniform(0.0, 2.0, (n, 2))
    made = recourse.solve(here)
    assert made.alpha + (made.beta * here).sum(1) == pytest.approx(made.cost, abs=1e-7)
    for _ in range(10):
        there = rng.uniform(0.0, 2.0, (n, 2))
        cost = recourse.solve(there).cost
        assert (made.alpha + (made.beta * there).sum(1) <= cost + 1e-9).all()


def test_the_result_does_not_depend_on_the_number_of_workers() -> None:
    two = program(5, chains=70)
    one, many = (
        lshaped(two, DecompositionOptions(gap=1e-6, workers=workers)) for workers in (1, 3)
    )
    assert (one.trunk == many.trunk).all()
    assert (one.cost == many.cost).all()
    assert one.bound == many.bound


@dataclass
class Watch:
    """What shows the time that solves take, and what each of them was given.

    Attributes:
        pace: seconds that one solve takes.
        now: what it shows, s.
        given: (seconds since the start, seconds given) of every solve.
    """

    pace: float
    now: float = 17.0
    given: list[tuple[float, float]] = field(default_factory=list)

    def __call__(self) -> float:
        return self.now

    def watch(self, monkeypatch: pytest.MonkeyPatch) -> None:
        solve, linear = Highs.solve, Plain.solve

        def scenario(solver: Highs) -> Solution:
            self.take(solver.time_limit)
            solver.time_limit = 60.0
            return solve(solver)

        def trunk(program: Plain, seconds: float) -> tuple[Floats, Floats] | None:
            self.take(seconds)
            return linear(program)

        monkeypatch.setattr(Highs, "solve", scenario)
        monkeypatch.setattr(Plain, "solve", trunk)

    def take(self, seconds: float) -> None:
        self.given.append((self.now - 17.0, seconds))
        self.now += self.pace


@pytest.mark.parametrize("limit", [0.0, 0.3, 1.7, 2.7])
def test_every_solve_gets_what_is_left(monkeypatch: pytest.MonkeyPatch, limit: float) -> None:
    """A trunk, then its seven scenarios, each solve 0.2 s: after the limit only what is missing."""
    two, watch = program(4, chains=7), Watch(pace=0.2)
    best = extensive(two, TIGHT).objective
    watch.watch(monkeypatch)
    options = DecompositionOptions(gap=1e-12, time_limit=limit, clock=watch)
    if limit < 1.0:
        with pytest.raises(OutOfTimeError, match=f"within {limit:g} s"):
            lshaped(two, options)
    else:
        found = lshaped(two, options)
        assert found.status == "feasible"
        assert found.bound <= best + 1e-7
        assert found.objective >= best - 1e-7
        assert all(start < limit for start, _ in watch.given)
    for start, given in watch.given:
        assert 0.0 < given <= limit + GRACE_S - start


def test_a_limit_that_is_over_leaves_one_plan_and_its_bound(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    two, watch = program(4, chains=12), Watch(pace=0.05)
    best = extensive(two, TIGHT).objective
    watch.watch(monkeypatch)
    found = lshaped(two, DecompositionOptions(gap=1e-12, time_limit=0.0, clock=watch))
    assert (found.status, found.iterations) == ("feasible", 1)
    assert found.start_cost is None
    assert -np.inf < found.bound <= best + 1e-7
    assert found.objective >= best - 1e-7


def test_what_took_too_long_is_no_infeasible_scenario() -> None:
    two = program(4, chains=7)
    master = Master(two)
    trial = master.solve()
    with pytest.raises(OutOfTimeError):
        Recourse(two, seconds=lambda: 1e-9).solve(trial.states)
    with pytest.raises(OutOfTimeError):
        Recourse(two, seconds=lambda: 0.0).solve(trial.states)
    with pytest.raises(OutOfTimeError):
        Master(two, seconds=lambda: 0.0).solve()
    with pytest.raises(OutOfTimeError, match="within 1e-09 s"):
        extensive(program(4, chains=40), DecompositionOptions(time_limit=1e-9))


def test_iterations_are_second_stages(monkeypatch: pytest.MonkeyPatch) -> None:
    two, calls, solve = program(4, chains=7), [], Recourse.solve

    def counted(recourse: Recourse, states: Floats) -> SecondStage:
        calls.append(states)
        return solve(recourse, states)

    monkeypatch.setattr(Recourse, "solve", counted)
    found = lshaped(two, TIGHT)
    assert found.iterations == len(calls) >= 2
    assert found.start_cost is None
    assert found.status == "optimal"


@pytest.mark.parametrize("solve", [lshaped, extensive])
def test_a_scenario_without_recourse_is_named(solve: object) -> None:
    two = program(1, chains=5)
    data = {name: values.copy() for name, values in two.data.items()}
    data["demand"][:, two.branches[3].nodes[-1]] = 99.0
    broken = TwoStage(two.stages, two.tree, two.trunk, data, two.x0, two.cuts)
    with pytest.raises(InfeasibleError, match="in scenario 3"):
        solve(broken, TIGHT)  # type: ignore[operator]


def check_boxes(monkeypatch: pytest.MonkeyPatch, two: TwoStage) -> None:
    """Every box that a bound is taken over holds the optimum of its round; no cut widens it
    downwards.
    """
    boxes = noted_boxes(monkeypatch)
    found = lshaped(two, TIGHT)
    assert found.objective == pytest.approx(extensive(two, TIGHT).objective, rel=1e-8)
    for low, high, optimum in boxes:
        assert (low <= optimum + 1e-6).all()
        assert (optimum <= high + 1e-6).all()
    for (low, *_), (later, *_) in pairwise(boxes):  # every cut is one bound more
        assert (later >= low - 1e-9).all()


def noted_boxes(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Floats, Floats, Floats]]:
    """The boxes that bounds are taken over from now on, and the optimum that comes with each."""
    boxes, points = list[tuple[Floats, Floats, Floats]](), list[Floats]()
    bound, solve = Plain.bound, Plain.solve

    def noted_bound(plain, multipliers, low, high):
        boxes.append((low, high, points[-1]))
        return bound(plain, multipliers, low, high)

    def noted_solve(plain, seconds):
        solution = solve(plain, seconds)
        assert solution is not None
        points.append(solution[0])
        return solution

    monkeypatch.setattr(Plain, "bound", noted_bound)
    monkeypatch.setattr(Plain, "solve", noted_solve)
    return boxes


def test_a_later_cut_narrows_nothing_that_an_earlier_one_reaches(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The first says 28 or more, wherever the stores are; the second 5 at most."""
    two = program(5)
    master, boxes, n = Master(two), noted_boxes(monkeypatch), len(two.branches)
    for alpha, slopes in ((40.0, [-2.0, -3.0]), (3.0, [0.5, 0.25])):
        constants, beta = alpha + np.arange(n, dtype=float), np.array([slopes] * n)
        master.add(SecondStage(np.zeros(n), constants, beta, []))
    master.solve()
    ((low, high, optimum),) = boxes
    assert (low <= optimum + 1e-6).all()
    assert (optimum <= high + 1e-6).all()


@pytest.mark.parametrize(
    ("parent", "chance", "trunk"),
    [
        ([-1, 0, 1], [1.0, 1.0, 1.0], 0),
        ([-1, 0, 0], [1.0, 0.3, 0.7], 3),
        ([-1, 0, 1, 1, 2, 2], [1.0, 1.0, 0.6, 0.4, 0.35, 0.25], 2),
    ],
    ids=["no trunk", "a trunk that forks", "a branch that forks"],
)
def test_a_trunk_is_a_chain_and_so_is_every_branch(
    parent: list[int], chance: list[float], trunk: int
) -> None:
    labels = tuple(f"t{k}" for k in range(len(parent)))
    tree = Tree(np.array(parent), np.array(chance), np.zeros(len(parent), int), labels)
    with pytest.raises(ValueError, match=f"nodes 0 to {trunk - 1} must be a chain"):
        replace(program(4), tree=tree, trunk=trunk)


@pytest.mark.parametrize("apart", [True, False])
@pytest.mark.parametrize(
    ("end_cost", "discount"), [(1000.0, 0.3), (2.0, 60.0)], ids=["dear end", "paid to fill"]
)
def test_the_box_that_a_bound_is_taken_over_holds_the_optimum(
    monkeypatch: pytest.MonkeyPatch, end_cost: float, discount: float, apart: bool
) -> None:
    # What is spent at the least is far from nothing: above it, or below where filling is paid for.
    two = program(6, Risk(0.6, 0.4), apart=apart)
    data = {**two.data, "price": two.data["price"] - discount}
    cut = Cut(end_cost, {"store": np.array([-0.7, -0.4])})
    check_boxes(
        monkeypatch, TwoStage(two.stages, two.tree, two.trunk, data, two.x0, [cut], two.risk)
    )


@pytest.mark.parametrize(
    ("branch", "price", "end_cost", "alpha"),
    [
        (None, 5000.0, 1e6, 0.97),
        (None, -2000.0, -1000.0, 0.03),
        (2, 5000.0, 2.0, 0.97),
        (2, -5000.0, 2.0, 0.03),
    ],
)
def test_the_box_holds_one_scenario_that_is_unlike_all_others(
    monkeypatch: pytest.MonkeyPatch, branch: int | None, price: float, end_cost: float, alpha: float
) -> None:
    """Only who stays on the trunk, or one branch, pays for its last slot or is paid for it: the
    worst 3 % begin with this one, or all but the best 3 % do, so the threshold is what it costs.
    """
    two = program(6, Risk(alpha, 0.4))
    only, node = two.staying, two.trunk - 1
    if branch is not None:
        only, node = two.branches[branch].probability, two.branches[branch].nodes[-1]
    assert only > 0.03
    prices = two.data["price"].copy()
    prices[:, node] = price
    data, cut = {**two.data, "price": prices}, Cut(end_cost, {"store": np.array([-0.7, -0.4])})
    check_boxes(
        monkeypatch, TwoStage(two.stages, two.tree, two.trunk, data, two.x0, [cut], two.risk)
    )
