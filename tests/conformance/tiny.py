"""Problems small enough to solve on paper, and what the answer is.

Every problem says which structures it needs. A backend that holds them all must find `optimum`;
one that relaxes some of them must find a bound no higher, and `relaxed` where that is known too.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from resilience.models.stage import Stage
from resilience.models.standard import Standard
from resilience.models.tree import Cut, Tree
from resilience.models.unroll import unroll

Values = Mapping[str, Any]


@dataclass(frozen=True)
class Tiny:
    """A problem, its data, and its optimum in $."""

    name: str
    problem: Standard
    optimum: float
    needs: frozenset[str] = frozenset({"affine"})
    data: Values = field(default_factory=dict)
    x0: Values = field(default_factory=dict)
    relaxed: float | None = None  # optimum of the linear or conic relaxation, where another

    def __str__(self) -> str:
        return self.name


TINY: dict[str, Callable[[], Tiny]] = {}


def tiny(build: Callable[..., Tiny]) -> Callable[..., Tiny]:
    """Adds a problem to the list under the name of its function."""
    TINY[build.__name__] = build
    return build


def one_node(stage: Stage, **more: Any) -> Standard:
    return unroll([stage], Tree.chain(["now"]), **more)


@tiny
def affine() -> Tiny:
    # min 2x + 3y, x + y >= 1, x <= 0.6: all of the cheap one, 0.6 * 2 + 0.4 * 3 = 2.4.
    stage = Stage(1.0)
    x, y = stage.var("x", ["a"], 0.0, 0.6), stage.var("y", ["a"], 0.0, 5.0)
    stage.le("demand", 1.0 - x - y)
    stage.cost("x", x, 2.0)
    stage.cost("y", y, 3.0)
    return Tiny("affine", one_node(stage), 2.4)


@tiny
def equality() -> Tiny:
    # x + y = 1 and x - y = 0.2 leave one point, (0.6, 0.4); cost x + 2y + 0.5 = 1.9.
    stage = Stage(1.0)
    x, y = (stage.var(name, ["a"], -5.0, 5.0) for name in "xy")
    stage.eq("sum", x + y, 1.0)
    stage.eq("difference", x - y, 0.2)
    stage.cost("all", x + 2.0 * y + 0.5)
    return Tiny("equality", one_node(stage), 1.9)


@tiny
def data(cap: float = 3.0, demand: float = 4.0, price: float = 2.0) -> Tiny:
    # x at `price` up to `cap`, the rest of `demand` at 5: 3 * 2 + 1 * 5 = 11 (while price <= 5),
    # and a levy of 0.25 per unit of demand that no decision can avoid: 12.
    stage = Stage(1.0)
    values = {"cap": cap, "demand": demand, "price": price}
    given = {name: stage.data(name, ["a"]) for name in values}
    x = stage.var("x", ["a"], 0.0, given["cap"])
    y = stage.var("y", ["a"], 0.0, 50.0)
    stage.eq("balance", x + y, given["demand"])
    stage.cost("x", x, given["price"])
    stage.cost("y", y, 5.0)
    stage.cost("levy", given["demand"] * 0.25)
    best = price * min(cap, demand) + 5.0 * max(demand - cap, 0.0) + 0.25 * demand
    return Tiny("data", one_node(stage), best, data={k: [v] for k, v in values.items()})


def storage(dt: float = 1.0, size: float = 2.0) -> Stage:
    """Buys and sells up to 1 MW each at a price, keeps what it does not sell."""
    stage = Stage(dt)
    now, after = stage.state("energy", ["a"], 0.0, size, unit="MWh")
    price = stage.data("price", ["a"], unit="$/MWh")
    buy, sell = stage.var("buy", ["a"], 0.0, 1.0), stage.var("sell", ["a"], 0.0, 1.0)
    stage.eq("dynamics", after, now + (buy - sell) * dt)
    stage.cost("buy", buy, price * dt)
    stage.cost("sell", sell, price * -dt)
    return stage


@tiny
def chain(energy: float = 1.0) -> Tiny:
    # Prices 1, 3, 2; 1 MWh at the start, room for 2: buy 1, then sell 1 and 1: 1 - 3 - 2 = -4.
    # Each MWh more at the start, up to 2, saves buying one at 1.
    problem = unroll([storage()], Tree.chain(["t0", "t1", "t2"]))
    return Tiny(
        "chain",
        problem,
        -4.0 - (energy - 1.0),
        data={"price": [[1.0, 3.0, 2.0]]},
        x0={"energy": [energy]},
    )


def shop(dt: float = 1.0) -> Stage:
    """Stores what it buys; meets demand from the store or pays for what is short."""
    stage = Stage(dt)
    now, after = stage.state("store", ["a"], 0.0, 5.0, unit="MWh")
    most, price = stage.data("most", ["a"]), stage.data("price", ["a"], unit="$/MWh")
    demand = stage.data("demand", ["a"])
    buy, use = stage.var("buy", ["a"], 0.0, most), stage.var("use", ["a"], 0.0, 5.0)
    short = stage.var("short", ["a"], 0.0, demand)
    stage.eq("store", after, now + (buy - use) * dt)
    stage.eq("demand", use + short, demand)
    stage.cost("buy", buy, dt)
    stage.cost("short", short, price * dt)
    return stage


@tiny
def fan(shortage: float = 3.0) -> Tiny:
    # Buy at 1 before demand is known: 1 with probability 0.7, 3 with 0.3. The first unit saves
    # `shortage`, the next two save 0.3 * shortage each: 0.9 < 1, so buy one and be short of two:
    # 1 + 0.3 * 2 * 3 = 2.8 (1.6 with foresight, 3.0 with three bought). At shortage 5: buy 3.
    tree = Tree(
        parent=np.array([-1, 0, 0]),
        probability=np.array([1.0, 0.7, 0.3]),
        stage=np.zeros(3, np.intp),
        labels=("now", "low", "high"),
    )
    given = {
        "most": [[5.0, 0.0, 0.0]],
        "demand": [[0.0, 1.0, 3.0]],
        "price": [[shortage, shortage, shortage]],
    }
    best = min(1.0 + 0.3 * 2.0 * shortage, 3.0)
    return Tiny("fan", unroll([shop()], tree), best, data=given, x0={"store": [0.0]})


@tiny
def durations() -> Tiny:
    # Two quarter hours and an hour, 1 MW of demand throughout: 1.5 MWh, of which 1.25 are there.
    # Being short costs 4 $/MWh in the quarters and 10 in the hour: 0.25 MWh * 4 = 1.
    tree = Tree(
        parent=np.array([-1, 0, 1]),
        probability=np.ones(3),
        stage=np.array([0, 0, 1]),
        labels=("00:00", "00:15", "00:30"),
    )
    given = {"most": [0.0], "demand": [1.0], "price": [[4.0, 4.0, 10.0]]}
    problem = unroll([shop(0.25), shop(1.0)], tree)
    return Tiny("durations", problem, 1.0, data=given, x0={"store": [1.25]})


@tiny
def split() -> Tiny:
    # max 2 pos + neg with one of them zero, pos <= 1, neg <= 3: 3. Both at once would give 5.
    # The second pair may move half as far: min(-2 * 0.5, -1.5) = -1.5, relaxed -2.5.
    stage = Stage(1.0)
    most = stage.data("most", ["a", "b"], unit="1")
    pos, neg = stage.split("x", ["a", "b"], (most, most * 3.0), (1.0, 3.0))
    stage.cost("pos", pos, -2.0)
    stage.cost("neg", neg, -1.0)
    return Tiny(
        "split",
        one_node(stage),
        -4.5,
        frozenset({"affine", "split"}),
        data={"most": [1.0, 0.5]},
        relaxed=-7.5,
    )


def curve(points: list[tuple[float, float]], other: float) -> Standard:
    """Meets a demand of 1 from a curve and from another source at `other` $/MWh."""
    stage = Stage(1.0)
    x, y = stage.var("x", ["a"], 0.0, points[-1][0]), stage.var("y", ["a"], 0.0, 5.0)
    xs, ys = np.array(points).T
    spent = stage.piecewise("f", x, xs[None], ys[None], "$/h")
    stage.eq("demand", x + y, 1.0)
    stage.cost("f", spent)
    stage.cost("y", y, other)
    return one_node(stage)


@tiny
def adjacent_concave() -> Tiny:
    # f through (0,0) (1,3) (2,4) rises by 3 at first: the other source at 2.5 is cheaper.
    # Without adjacency the chord from 0 to 2, slope 2, is used: 2.
    problem = curve([(0.0, 0.0), (1.0, 3.0), (2.0, 4.0)], other=2.5)
    return Tiny("adjacent_concave", problem, 2.5, frozenset({"affine", "adjacent"}), relaxed=2.0)


@tiny
def adjacent_convex() -> Tiny:
    # f through (0,0) (0.5,0.5) (2,5) has slopes 1 and 3: half a unit of it, half at 2: 1.5.
    # Convex, so that adjacency holds by itself.
    problem = curve([(0.0, 0.0), (0.5, 0.5), (2.0, 5.0)], other=2.0)
    return Tiny("adjacent_convex", problem, 1.5, frozenset({"affine", "adjacent"}), relaxed=1.5)


@tiny
def cone_tight() -> Tiny:
    # min u + v with u v = 2^2: u = v = 2. The relaxation u v >= 4 closes by itself.
    stage = Stage(1.0)
    u, v = (stage.var(name, ["a"], 0.1, 9.0) for name in "uv")
    x = stage.var("x", ["a"], -3.0, 3.0)
    stage.eq("x", x, 2.0)
    stage.cone("flow", u, v, x)
    stage.cost("all", u + v)
    return Tiny("cone_tight", one_node(stage), 4.0, frozenset({"affine", "cone"}), relaxed=4.0)


@tiny
def cone_open() -> Tiny:
    # max u with u v = 0.6^2 + 0.8^2 = 1, 0.5 <= v <= 1, u <= 3: u = 2. The relaxation has u = 3.
    stage = Stage(1.0)
    u, v = stage.var("u", ["a"], 0.0, 3.0), stage.var("v", ["a"], 0.5, 1.0)
    x, y = (stage.var(name, ["a"], -1.0, 1.0) for name in "xy")
    stage.eq("x", x, 0.6)
    stage.eq("y", y, -0.8)
    stage.cone("flow", u, v, x, y)
    stage.cost("u", u, -1.0)
    return Tiny("cone_open", one_node(stage), -2.0, frozenset({"affine", "cone"}), relaxed=-3.0)


@tiny
def disc() -> Tiny:
    # max 3x + 4y on the disc of radius 2: 2 * |(3, 4)| = 10, at (1.2, 1.6).
    stage = Stage(1.0)
    x, y = (stage.var(name, ["a"], -5.0, 5.0) for name in "xy")
    stage.disc("rating", 2.0, x, y)
    stage.cost("all", x * -3.0 - 4.0 * y)
    return Tiny("disc", one_node(stage), -10.0, frozenset({"affine", "disc"}))


@tiny
def largest() -> Tiny:
    # y = max(2 - a, a, 0) has its minimum 1 at a = 1; a itself costs 0.1. The second y is free of
    # charge, and must be made equal to its largest argument all the same.
    stage = Stage(1.0)
    of = ["priced", "free"]
    a, y = stage.var("a", of, 0.0, 5.0), stage.var("y", of, 0.0, 9.0)
    stage.largest("y", y, 2.0 - a, a, a * 0.0)
    stage.cost("y", y[[0]])
    stage.cost("a", a, 0.1)
    return Tiny("largest", one_node(stage), 1.1, frozenset({"affine", "largest"}))


@tiny
def knapsack() -> Tiny:
    # Worth 5, 4, 3 at weights 2, 3, 1, at most 4 in all: the first and the third, 8.
    # Relaxed, a third of the second joins them: 8 + 4 / 3.
    stage = Stage(1.0)
    take = stage.binary("take", ["a", "b", "c"])
    stage.le("weight", (take * [2.0, 3.0, 1.0]).sum(), 4.0)
    stage.cost("worth", take, [-5.0, -4.0, -3.0])
    return Tiny(
        "knapsack",
        one_node(stage),
        -8.0,
        frozenset({"affine", "integer"}),
        relaxed=-8.0 - 4.0 / 3.0,
    )


@tiny
def counts() -> Tiny:
    # The most whole x with 2 x <= 5 is 2; relaxed 2.5. An integer need not be 0 or 1.
    stage = Stage(1.0)
    x = stage.var("x", ["a"], 0.0, 4.0, unit="1", integer=True)
    stage.le("room", x * 2.0, 5.0)
    stage.cost("x", x, -1.0)
    needs = frozenset({"affine", "integer"})
    return Tiny("counts", one_node(stage), -2.0, needs, relaxed=-2.5)


CUTS = (
    Cut(4.0, {"store": np.array([-3.0])}),
    Cut(2.0, {"store": np.array([-1.0])}),
    Cut(0.0, {"store": np.array([0.0])}),
)


@tiny
def terminal(cuts: tuple[Cut, ...] = CUTS) -> Tiny:
    # Behind the horizon max(4 - 3 e, 2 - e, 0), buying at 1 up to 0.8: 0.8 + 4 - 2.4 = 2.4.
    problem = unroll([shop()], Tree.chain(["now"]), cuts)
    given = {"most": [0.8], "demand": [0.0], "price": [0.0]}
    return Tiny("terminal", problem, 2.4, data=given, x0={"store": [0.0]})


@tiny
def terminal_fan(cuts: tuple[Cut, ...] = CUTS) -> Tiny:
    # As `fan` with shortage 10 (three are bought, 1 is left with probability 0.7 unless it is 2),
    # and the cuts behind both leaves. For e bought: e + 0.7 f(e - 1) + 0.3 (10 (3 - e)+ + f(e-3)+).
    # Slope beyond e = 3: 1 - 0.7 * 0 - 0.3 * 3 > 0, below: 1 - 0.7 - 3 < 0; so e = 3:
    # 3 + 0.7 f(2) + 0.3 f(0) = 3 + 0 + 1.2 = 4.2.
    tree = Tree(
        parent=np.array([-1, 0, 0]),
        probability=np.array([1.0, 0.7, 0.3]),
        stage=np.zeros(3, np.intp),
        labels=("now", "low", "high"),
    )
    given = {"most": [[5.0, 0.0, 0.0]], "demand": [[0.0, 1.0, 3.0]], "price": [[10.0] * 3]}
    problem = unroll([shop()], tree, cuts)
    return Tiny("terminal_fan", problem, 4.2, data=given, x0={"store": [0.0]})
