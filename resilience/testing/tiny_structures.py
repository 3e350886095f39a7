"""One structure at a time: splits, curves, cones, discs, maxima and integers."""

from __future__ import annotations

import numpy as np

from resilience.models.language.stage import Stage
from resilience.models.program.standard import Standard
from resilience.models.structures import Adjacent, Angle, Cone, Disc, Largest, Split
from resilience.testing.tiny import TinyProgram, one_node, tiny_program


@tiny_program
def split() -> TinyProgram:
    """max 2 pos + neg with one of them zero, pos <= 1, neg <= 3: 3. Both at once would give 5.
    The second pair may move half as far: min(-2 * 0.5, -1.5) = -1.5, relaxed -2.5.
    """
    stage = Stage(1.0)
    limit = stage.data("limit", ["a", "b"], unit="1")
    pos, neg = stage.split("x", ["a", "b"], (limit, limit * 3.0), (1.0, 3.0))
    stage.cost("pos", pos, -2.0)
    stage.cost("neg", neg, -1.0)
    return TinyProgram(
        "split",
        one_node(stage),
        -4.5,
        {Split},
        data={"limit": [1.0, 0.5]},
        relaxed=-7.5,
    )


def curve(points: list[tuple[float, float]], price: float) -> Standard:
    """Meets a demand of 1 from a curve and from another source at `price`, $/MWh."""
    stage = Stage(1.0)
    x, y = stage.var("x", ["a"], 0.0, points[-1][0]), stage.var("y", ["a"], 0.0, 5.0)
    xs, ys = np.array(points).T
    spent = stage.piecewise("f", x, xs[None], ys[None], "$/h")
    stage.eq("demand", x + y, 1.0)
    stage.cost("f", spent)
    stage.cost("y", y, price)
    return one_node(stage)


@tiny_program
def adjacent_concave() -> TinyProgram:
    """f through (0,0) (1,3) (2,4) rises by 3 at first: the other source at 2.5 is cheaper.
    Without adjacency the chord from 0 to 2, slope 2, is used: 2.
    """
    standard = curve([(0.0, 0.0), (1.0, 3.0), (2.0, 4.0)], price=2.5)
    return TinyProgram("adjacent_concave", standard, 2.5, {Adjacent}, relaxed=2.0)


@tiny_program
def adjacent_convex() -> TinyProgram:
    """f through (0,0) (0.5,0.5) (2,5) has slopes 1 and 3: half a unit of it, half at 2: 1.5.
    Convex, so that adjacency holds by itself.
    """
    standard = curve([(0.0, 0.0), (0.5, 0.5), (2.0, 5.0)], price=2.0)
    return TinyProgram("adjacent_convex", standard, 1.5, {Adjacent}, relaxed=1.5)


@tiny_program
def cone_tight() -> TinyProgram:
    """min u + v with u v = 2^2: u = v = 2. The relaxation u v >= 4 closes by itself."""
    stage = Stage(1.0)
    u, v = (stage.var(name, ["a"], 0.1, 9.0) for name in "uv")
    x = stage.var("x", ["a"], -3.0, 3.0)
    stage.eq("x", x, 2.0)
    stage.cone("flow", u, v, x)
    stage.cost("all", u + v)
    return TinyProgram("cone_tight", one_node(stage), 4.0, {Cone}, relaxed=4.0)


@tiny_program
def cone_open() -> TinyProgram:
    """max u with u v = 0.6^2 + 0.8^2 = 1, 0.5 <= v <= 1, u <= 3: u = 2. Relaxed, u = 3."""
    stage = Stage(1.0)
    u, v = stage.var("u", ["a"], 0.0, 3.0), stage.var("v", ["a"], 0.5, 1.0)
    x, y = (stage.var(name, ["a"], -1.0, 1.0) for name in "xy")
    stage.eq("x", x, 0.6)
    stage.eq("y", y, -0.8)
    stage.cone("flow", u, v, x, y)
    stage.cost("u", u, -1.0)
    return TinyProgram("cone_open", one_node(stage), -2.0, {Cone}, relaxed=-3.0)


def one_angle(
    im: float, costs: tuple[float, float], optimum: float, relaxed: float, name: str
) -> TinyProgram:
    """theta = atan2(im, re) with im fixed, theta within 3 and re from -1 to 1.

    The two squares are 2: of numbers of which the product may be re + j im.
    """
    stage = Stage(1.0)
    theta, re = stage.var("theta", ["a"], -3.0, 3.0), stage.var("re", ["a"], -1.0, 1.0)
    product = stage.var("im", ["a"], im, im)
    squares = stage.var("u", ["a"], 2.0, 2.0), stage.var("v", ["a"], 2.0, 2.0)
    stage.angle("loop", theta, re, product, squares)
    for word, x, cost in zip(("theta", "re"), (theta, re), costs, strict=True):
        stage.cost(word, x, cost)
    return TinyProgram(name, one_node(stage), optimum, {Angle}, relaxed=relaxed)


@tiny_program
def angle_least() -> TinyProgram:
    """min theta with im = 1: re = 1, pi / 4. Half a turn less has the same tangent."""
    return one_angle(1.0, (1.0, 0.0), np.pi / 4, -3.0, "angle_least")


@tiny_program
def angle_below() -> TinyProgram:
    """max theta with im = -1: -pi / 4."""
    return one_angle(-1.0, (-1.0, 0.0), np.pi / 4, -3.0, "angle_below")


@tiny_program
def angle_steep() -> TinyProgram:
    """min 4 re - 5 theta with im = 1: re = cot(theta) and -theta both fall, until re = 0 ends it at
    pi / 2.
    """
    return one_angle(1.0, (-5.0, 4.0), -2.5 * np.pi, -19.0, "angle_steep")


def on_a_disc(x_cost: float, y_cost: float, optimum: float, name: str) -> TinyProgram:
    """A linear cost on the disc of radius 2 around the origin."""
    stage = Stage(1.0)
    x, y = (stage.var(name, ["a"], -5.0, 5.0) for name in "xy")
    stage.disc("rating", 2.0, x, y)
    stage.cost("all", x * x_cost + y * y_cost)
    return TinyProgram(name, one_node(stage), optimum, {Disc})


@tiny_program
def disc() -> TinyProgram:
    """max 3x + 4y on the disc of radius 2: 2 * |(3, 4)| = 10, at (1.2, 1.6)."""
    return on_a_disc(-3.0, -4.0, -10.0, "disc")


@tiny_program
def disc_below() -> TinyProgram:
    """The same on the other side, at (-1.2, -1.6)."""
    return on_a_disc(3.0, 4.0, -10.0, "disc_below")


@tiny_program
def largest() -> TinyProgram:
    """y = max(2 - a, a, 0) has its minimum 1 at a = 1; a itself costs 0.1. The second y is free of
    charge, and must be made equal to its largest argument all the same.
    """
    stage = Stage(1.0)
    labels = ["priced", "free"]
    a, y = stage.var("a", labels, 0.0, 5.0), stage.var("y", labels, 0.0, 9.0)
    stage.largest("y", y, 2.0 - a, a, a * 0.0)
    stage.cost("y", y[[0]])
    stage.cost("a", a, 0.1)
    return TinyProgram("largest", one_node(stage), 1.1, {Largest})


@tiny_program
def knapsack() -> TinyProgram:
    """Worth 5, 4, 3 at weights 2, 3, 1, at most 4 in all: the first and the third, 8.
    Relaxed, a third of the second joins them: 8 + 4 / 3.
    """
    stage = Stage(1.0)
    take = stage.binary("take", ["a", "b", "c"])
    stage.le("weight", (take * [2.0, 3.0, 1.0]).sum(), 4.0)
    stage.cost("worth", take, [-5.0, -4.0, -3.0])
    return TinyProgram(
        "knapsack",
        one_node(stage),
        -8.0,
        relaxed=-8.0 - 4.0 / 3.0,
        integers=True,
    )


@tiny_program
def counts() -> TinyProgram:
    """The most whole x with 2 x <= 5 is 2; relaxed 2.5. An integer need not be 0 or 1."""
    stage = Stage(1.0)
    x = stage.var("x", ["a"], 0.0, 4.0, unit="1", integer=True)
    stage.le("room", x * 2.0, 5.0)
    stage.cost("x", x, -1.0)
    return TinyProgram("counts", one_node(stage), -2.0, relaxed=-2.5, integers=True)


@tiny_program
def switch() -> TinyProgram:
    """|x| <= 2 on, at 1.5 for being on. Going to x = -1 and y = 1 is worth 1 each: not enough.
    Relaxed, half on is: -1 + 0.75, twice.
    """
    stage = Stage(1.0)
    x, y = (stage.var(name, ["a"], -1.0, 1.0) for name in "xy")
    for name, z in {"x": x, "y": y}.items():
        on = stage.binary(f"{name}.on", ["a"])
        stage.switch(f"{name}.switch", z, on, 2.0)
        stage.cost(f"{name}.on", on, 1.5)
    stage.cost("worth", x - y)
    return TinyProgram("switch", one_node(stage), 0.0, relaxed=-0.5, integers=True)


def on_a_shifted_disc(x_cost: float, y_cost: float, optimum: float, name: str) -> TinyProgram:
    """A linear cost on the disc of radius 2 around (-1, 0.7)."""
    stage = Stage(1.0)
    x, y = (stage.var(name, ["a"], -5.0, 5.0) for name in "xy")
    stage.disc("rating", 2.0, x + 1.0, y - 0.7)
    stage.cost("all", x * x_cost + y * y_cost)
    return TinyProgram(name, one_node(stage), optimum, {Disc})


@tiny_program
def shifted_disc() -> TinyProgram:
    """max x with |(x + 1, y - 0.7)| <= 2: x = 1."""
    return on_a_shifted_disc(-1.0, 0.0, -1.0, "shifted_disc")


@tiny_program
def shifted_disc_below() -> TinyProgram:
    """min x: x = -3."""
    return on_a_shifted_disc(1.0, 0.0, -3.0, "shifted_disc_below")


@tiny_program
def shifted_disc_beside() -> TinyProgram:
    """max y: y = 2.7."""
    return on_a_shifted_disc(0.0, -1.0, -2.7, "shifted_disc_beside")


def one_cone(
    u: float, x: float, worth: float, optimum: float, relaxed: float, name: str
) -> TinyProgram:
    """u v = x^2 with u and x fixed, v between 0.5 and 9 at `worth` $ each."""
    stage = Stage(1.0)
    fixed = [stage.var(key, ["a"], value, value) for key, value in (("u", u), ("x", x))]
    v = stage.var("v", ["a"], 0.5, 9.0)
    stage.cone("flow", fixed[0], v, fixed[1])
    stage.cost("v", v, worth)
    return TinyProgram(name, one_node(stage), optimum, {Cone}, relaxed=relaxed)


@tiny_program
def cone_with_one_free_side() -> TinyProgram:
    """4 v = 2^2 leaves v = 1 alone, though u and x are fixed. Relaxed, v may be as large as 9."""
    return one_cone(4.0, 2.0, worth=-1.0, optimum=-1.0, relaxed=-9.0, name="one free side")


@tiny_program
def cone_of_a_line_that_is_out() -> TinyProgram:
    """0 v = 0^2 says nothing of v, which falls to its lower bound."""
    return one_cone(0.0, 0.0, worth=1.0, optimum=0.5, relaxed=0.5, name="line out")
