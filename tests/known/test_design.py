"""What is built before anything is known: the newsvendor, whose optimum is a quantile."""

from __future__ import annotations

import numpy as np
import pytest

from resilience.models.backends.highs import Highs
from resilience.models.language.decision import decision
from resilience.models.language.stage import Stage
from resilience.models.language.tree import Tree
from resilience.models.program.risk import Risk
from resilience.models.program.unroll import unroll
from resilience.planning.two_stage.extensive import extensive
from resilience.planning.two_stage.lshaped import DecompositionOptions, Machinery, lshaped
from resilience.planning.two_stage.two_stage import TwoStage

DEMAND = (2.0, 5.0, 9.0)
CHANCE = (0.2, 0.5, 0.3)
SLOTS = 2
SOLVERS = {"extensive": extensive, "lshaped": lshaped}


def shop(cost: float, *, integer: bool, most: float = 20.0) -> Stage:
    """One slot: who wants more than there is pays 1 $ a unit elsewhere."""
    stage, at = Stage(1.0), ("shop",)
    size = stage.design("size", at, 0.0, most, cost, unit="1", integer=integer)
    bought = stage.var("bought", at, unit="1")
    stage.le("served", stage.data("demand", at, unit="1") - size, bought)
    stage.cost("elsewhere", bought, 1.0)
    return stage


def newsvendor(
    cost: float,
    *,
    integer: bool = False,
    most: float = 20.0,
    budget: float = np.inf,
    risk: Risk | None = None,
) -> TwoStage:
    """The size first, then one of three demands for two slots."""
    slot = shop(cost, integer=integer, most=most)
    first = decision(slot)
    first.le("budget", first["size"], first.data("limit", ("all",), unit="1"))
    n = len(DEMAND) * SLOTS
    parent = np.where(np.arange(n) % SLOTS, np.arange(n), 0)
    tree = Tree(
        np.append(-1, parent),
        np.append(1.0, np.repeat(CHANCE, SLOTS)),
        np.append(0, np.ones(n, np.intp)),
        ("before", *(f"{t} in {s}" for s in range(3) for t in range(SLOTS))),
    )
    data = {
        "demand": np.append(0.0, np.repeat(DEMAND, SLOTS))[None],
        "limit": np.array([[min(budget, 1e3)]]),
    }
    return TwoStage([first, slot], tree, 1, data, {}, (), risk or Risk())


def by_hand(size: float, cost: float) -> float:
    """$ of a size."""
    return cost * size + SLOTS * float(
        np.dot(CHANCE, [max(demand - size, 0.0) for demand in DEMAND])
    )


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize(
    ("cost", "most", "integer", "size"),
    [(1.0, 20.0, False, 5.0), (0.5, 20.0, True, 9.0), (0.5, 7.5, False, 7.5), (0.5, 7.5, True, 7)],
)
def test_the_size_is_the_quantile(
    solver: str, cost: float, most: float, integer: bool, size: float
) -> None:
    """2 P(demand > x) = cost: above 1.6 nothing pays, between 0.6 and 1.6 up to 5, then to 9."""
    two_stage = newsvendor(cost, integer=integer, most=most)
    solution = SOLVERS[solver](two_stage)
    built = two_stage.first.initial["size"]
    assert solution.trunk[built] == pytest.approx(size, abs=1e-7)
    assert solution.objective == pytest.approx(by_hand(size, cost), abs=1e-7)
    assert solution.bound == pytest.approx(solution.objective, rel=1e-4)


@pytest.mark.parametrize("integer", [True, False])
def test_a_budget_binds_and_the_cuts_outlive_it(integer: bool) -> None:
    """With 3 units at 1 $: 3 + 2 (0.5 * 2 + 0.3 * 6); with 4 more the free optimum, 5."""
    two_stage = newsvendor(1.0, integer=integer, budget=3.0)
    options = DecompositionOptions()
    machinery = Machinery.without_cuts(two_stage, options)
    tight = lshaped(two_stage, options, machinery)
    assert tight.objective == pytest.approx(by_hand(3.0, 1.0)) == pytest.approx(8.6)
    machinery.master.change_data(two_stage.first_data | {"limit": np.array([[7.0]])})
    rounds = lshaped(two_stage, options, machinery)
    assert rounds.objective == pytest.approx(by_hand(5.0, 1.0)) == pytest.approx(7.4)


@pytest.mark.parametrize("weight", [0.0, 0.5, 1.0])
def test_risk_aversion_builds_for_the_worst(weight: float) -> None:
    """CVaR 70 % is the cost of the largest demand, whose 2 $ a unit pay for 1.2 up to 9; of half
    the mean, worth 0.6 there, and half the CVaR it is 1.3.
    """
    risk, cost = Risk(0.7, weight), 1.2
    two_stage = newsvendor(cost, integer=True, risk=risk)
    solution = lshaped(two_stage)
    whole = extensive(newsvendor(cost, integer=True, risk=risk))
    sizes = np.arange(10)
    values = [
        (1 - weight) * by_hand(float(x), cost) + weight * (cost * x + SLOTS * max(9.0 - x, 0.0))
        for x in sizes
    ]
    assert solution.objective == pytest.approx(min(values), abs=1e-6)
    assert whole.objective == pytest.approx(min(values), abs=1e-6)
    assert {0.0: 5, 0.5: 9, 1.0: 9}[weight] == sizes[int(np.argmin(values))]


def test_a_chain_builds_too_and_pays_once() -> None:
    """A horizon known in advance: 3 and 4 units wanted, 1 $ a unit built, 1 $ a unit elsewhere."""
    standard = unroll([shop(1.5, integer=False)], Tree.chain(["a", "b"]))
    data = {"demand": np.array([[3.0, 4.0]])}
    vectors = standard.vectors(data, {})
    solver = Highs(standard)
    solver.update(vectors)
    solution = solver.solve()
    assert solution.z is not None
    assert solution.objective == pytest.approx(1.5 * 3.0 + 1.0)
    terms = standard.cost_terms(solution.z, data)
    assert {name: paid.tolist() for name, paid in terms.items()} == {
        "size": [pytest.approx(4.5), 0.0],
        "elsewhere": [pytest.approx(0.0), pytest.approx(1.0)],
    }
    assert standard.column_name(int(standard.initial["size"][0])) == "size[shop, start]"
