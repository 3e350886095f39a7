"""Linear problems: rows, bounds, prices, states over chains and trees, cuts at the end."""

from __future__ import annotations

import numpy as np

from resilience.models.language.stage import Stage
from resilience.models.language.tree import Cut, Tree
from resilience.models.program.unroll import unroll
from resilience.testing.tiny import TinyProgram, one_node, tiny_program


@tiny_program
def affine() -> TinyProgram:
    """min 2x + 3y, x + y >= 1, x <= 0.6: all of the cheap one, 0.6 * 2 + 0.4 * 3 = 2.4."""
    stage = Stage(1.0)
    x, y = stage.var("x", ["a"], 0.0, 0.6), stage.var("y", ["a"], 0.0, 5.0)
    stage.le("demand", 1.0 - x - y)
    stage.cost("x", x, 2.0)
    stage.cost("y", y, 3.0)
    return TinyProgram("affine", one_node(stage), 2.4)


@tiny_program
def equality() -> TinyProgram:
    """x + y = 1 and x - y = 0.2 leave one point, (0.6, 0.4); cost x + 2y + 0.5 = 1.9."""
    stage = Stage(1.0)
    x, y = (stage.var(name, ["a"], -5.0, 5.0) for name in "xy")
    stage.eq("sum", x + y, 1.0)
    stage.eq("difference", x - y, 0.2)
    stage.cost("all", x + 2.0 * y + 0.5)
    return TinyProgram("equality", one_node(stage), 1.9)


@tiny_program
def data(cap: float = 3.0, demand: float = 4.0, price: float = 2.0) -> TinyProgram:
    """x at `price` up to `cap`, the rest of `demand` at 5: 3 * 2 + 1 * 5 = 11 (while price <= 5),
    and a levy of 0.25 per unit of demand that no decision can avoid: 12.
    """
    stage = Stage(1.0)
    values = {"cap": cap, "demand": demand, "price": price}
    datum = {name: stage.data(name, ["a"]) for name in values}
    x = stage.var("x", ["a"], 0.0, datum["cap"])
    y = stage.var("y", ["a"], 0.0, 50.0)
    stage.eq("balance", x + y, datum["demand"])
    stage.cost("x", x, datum["price"])
    stage.cost("y", y, 5.0)
    stage.cost("levy", datum["demand"] * 0.25)
    optimum = price * min(cap, demand) + 5.0 * max(demand - cap, 0.0) + 0.25 * demand
    return TinyProgram("data", one_node(stage), optimum, data={k: [v] for k, v in values.items()})


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


@tiny_program
def chain(energy: float = 1.0) -> TinyProgram:
    """Prices 1, 3, 2; 1 MWh at the start, room for 2: buy 1, then sell 1 and 1: 1 - 3 - 2 = -4.
    Each MWh less at the start is one less to sell at 2, each more up to 2 one less to buy at 1.
    """
    standard = unroll([storage()], Tree.chain(["t0", "t1", "t2"]))
    return TinyProgram(
        "chain",
        standard,
        -4.0 - min(energy - 1.0, 2.0 * (energy - 1.0)),
        data={"price": [[1.0, 3.0, 2.0]]},
        x0={"energy": [energy]},
    )


def shop(dt: float = 1.0) -> Stage:
    """Stores what it buys; meets demand from the store or pays for what is short."""
    stage = Stage(dt)
    now, after = stage.state("store", ["a"], 0.0, 5.0, unit="MWh")
    limit, price = stage.data("limit", ["a"]), stage.data("price", ["a"], unit="$/MWh")
    demand = stage.data("demand", ["a"])
    buy, use = stage.var("buy", ["a"], 0.0, limit), stage.var("use", ["a"], 0.0, 5.0)
    short = stage.var("short", ["a"], 0.0, demand)
    stage.eq("store", after, now + (buy - use) * dt)
    stage.eq("demand", use + short, demand)
    stage.cost("buy", buy, dt)
    stage.cost("short", short, price * dt)
    return stage


@tiny_program
def fan(shortage: float = 3.0) -> TinyProgram:
    """Buy at 1 before demand is known: 1 with probability 0.7, 3 with 0.3. The first unit saves
    `shortage`, the next two save 0.3 * shortage each: 0.9 < 1, so buy one and be short of two:
    1 + 0.3 * 2 * 3 = 2.8 (1.6 with foresight, 3.0 with three bought). At shortage 5: buy 3.
    """
    tree = Tree(
        parent=np.array([-1, 0, 0]),
        probability=np.array([1.0, 0.7, 0.3]),
        stage=np.zeros(3, np.intp),
        labels=("now", "low", "high"),
    )
    values = {
        "limit": [[5.0, 0.0, 0.0]],
        "demand": [[0.0, 1.0, 3.0]],
        "price": [[shortage, shortage, shortage]],
    }
    optimum = min(1.0 + 0.3 * 2.0 * shortage, 3.0)
    return TinyProgram("fan", unroll([shop()], tree), optimum, data=values, x0={"store": [0.0]})


@tiny_program
def durations() -> TinyProgram:
    """Two quarter hours and an hour, 1 MW of demand throughout: 1.5 MWh, of which 1.25 are there.
    Being short costs 4 $/MWh in the quarters and 10 in the hour: 0.25 MWh * 4 = 1.
    """
    tree = Tree(
        parent=np.array([-1, 0, 1]),
        probability=np.ones(3),
        stage=np.array([0, 0, 1]),
        labels=("00:00", "00:15", "00:30"),
    )
    values = {"limit": [0.0], "demand": [1.0], "price": [[4.0, 4.0, 10.0]]}
    standard = unroll([shop(0.25), shop(1.0)], tree)
    return TinyProgram("durations", standard, 1.0, data=values, x0={"store": [1.25]})


CUTS = (
    Cut(4.0, {"store": np.array([-3.0])}),
    Cut(2.0, {"store": np.array([-1.0])}),
    Cut(0.0, {"store": np.array([0.0])}),
)


@tiny_program
def terminal(cuts: tuple[Cut, ...] = CUTS) -> TinyProgram:
    """Behind the horizon max(4 - 3 e, 2 - e, 0), buying at 1 up to 0.8: 0.8 + 4 - 2.4 = 2.4."""
    standard = unroll([shop()], Tree.chain(["now"]), cuts)
    values = {"limit": [0.8], "demand": [0.0], "price": [0.0]}
    return TinyProgram("terminal", standard, 2.4, data=values, x0={"store": [0.0]})


@tiny_program
def terminal_fan(cuts: tuple[Cut, ...] = CUTS) -> TinyProgram:
    """As `fan` with shortage 10 (three are bought, 1 is left with probability 0.7 unless it is 2),
    and the cuts behind both leaves. For e bought: e + 0.7 f(e - 1) + 0.3 (10 (3 - e)+ + f(e-3)+).
    Slope beyond e = 3: 1 - 0.7 * 0 - 0.3 * 3 > 0, below: 1 - 0.7 - 3 < 0; so e = 3:
    3 + 0.7 f(2) + 0.3 f(0) = 3 + 0 + 1.2 = 4.2.
    """
    tree = Tree(
        parent=np.array([-1, 0, 0]),
        probability=np.array([1.0, 0.7, 0.3]),
        stage=np.zeros(3, np.intp),
        labels=("now", "low", "high"),
    )
    values = {"limit": [[5.0, 0.0, 0.0]], "demand": [[0.0, 1.0, 3.0]], "price": [[10.0] * 3]}
    standard = unroll([shop()], tree, cuts)
    return TinyProgram("terminal_fan", standard, 4.2, data=values, x0={"store": [0.0]})
