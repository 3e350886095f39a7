"""Fragility curves against scipy and published points."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import lognorm, norm

from resilience.errors import UsageError
from resilience.fragility.lines.curves import CURVES, Curve, hardened, restated

SPEEDS = np.linspace(0.0, 120.0, 2401)
TABLE = {"speed_mps": (20.0, 30.0, 40.0, 60.0), "probability": (0.0, 0.1, 0.1, 0.9)}


def curve(kind: str, **parameters: object) -> Curve:
    return Curve("test", kind, parameters, 3.0, 10.0, "land", "test")


OTHERS = (
    curve("piecewise", v_crit_mps=30.0, v_collapse_mps=60.0),
    curve("piecewise", v_crit_mps=30.0, v_collapse_mps=60.0, median_mps=45.0, beta=0.3),
    curve("tabulated", **TABLE),
)
ALL = (*CURVES.values(), *OTHERS)


@pytest.mark.parametrize("one", ALL, ids=lambda one: f"{one.name} {one.kind}")
def test_a_probability_that_never_falls(one: Curve) -> None:
    chance = one.probability(SPEEDS)
    assert chance[0] == 0.0
    assert chance[-1] > 0.89
    assert (np.diff(chance) >= 0.0).all()


@pytest.mark.parametrize("one", ALL, ids=lambda one: f"{one.name} {one.kind}")
def test_half_at_the_median_and_the_speed_is_the_inverse(one: Curve) -> None:
    assert one.probability(one.median_mps) == pytest.approx(0.5)
    u = np.linspace(0.02, 0.88, 200)
    speed = one.speed(u)
    assert (one.probability(speed) >= u - 1e-9).all()
    assert (one.probability(speed - 1e-6) <= u + 1e-9).all()
    assert one.speed(0.0) == 0.0


@pytest.mark.parametrize(
    "one", [c for c in CURVES.values() if c.kind == "lognormal"], ids=lambda one: one.name
)
def test_lognormal_is_that_of_scipy(one: Curve) -> None:
    m, beta = one.parameters["median_mps"], one.parameters["beta"]
    assert one.probability(SPEEDS) == pytest.approx(lognorm(s=beta, scale=m).cdf(SPEEDS), abs=1e-14)
    assert one.median_mps == pytest.approx(m)
    assert norm.cdf(one.score(SPEEDS)) == pytest.approx(one.probability(SPEEDS))


@pytest.mark.parametrize(("speed", "chance"), [(30.0, 0.007), (35.0, 0.087), (40.0, 0.42)])
def test_twenty_poles_of_a_kilometre(speed: float, chance: float) -> None:
    one = CURVES["pole"].probability(speed)
    assert 1.0 - (1.0 - one) ** 20 == pytest.approx(chance, abs=0.0055 if chance > 0.1 else 5e-4)


def test_a_pole_curve_of_sections_breaks_every_kilometre() -> None:
    one = CURVES["erad-pole"].probability(30.0)
    assert one == pytest.approx(0.156, abs=1e-3)
    assert 1.0 - (1.0 - one) ** 20 == pytest.approx(0.97, abs=5e-3)


def test_piecewise() -> None:
    line, bend, _ = OTHERS
    assert line.probability([29.9, 30.0, 37.5, 59.9999, 60.0, 99.0]) == pytest.approx(
        [0.0, 0.0, 0.25, 1.0, 1.0, 1.0], abs=1e-5
    )
    inner = lognorm(s=0.3, scale=45.0).cdf
    assert bend.probability([29.9, 31.0, 50.0, 60.0]) == pytest.approx(
        [0.0, inner(31.0), inner(50.0), 1.0]
    )
    assert bend.speed([0.01, 0.999]) == pytest.approx([30.0, 60.0])


def test_tabulated() -> None:
    table = OTHERS[2]
    assert table.probability([10.0, 25.0, 35.0, 50.0, 80.0]) == pytest.approx(
        [0.0, 0.05, 0.1, 0.5, 0.9]
    )
    assert table.speed([0.1, 0.9, 0.95]) == pytest.approx([30.0, 60.0, np.inf])


@pytest.mark.parametrize("one", ALL, ids=lambda one: f"{one.name} {one.kind}")
def test_hardening_moves_the_curve_to_higher_speeds(one: Curve) -> None:
    strong = hardened(one, 1.3)
    assert strong.probability(1.3 * SPEEDS) == pytest.approx(one.probability(SPEEDS), abs=1e-12)
    assert strong.median_mps == pytest.approx(1.3 * one.median_mps)
    assert strong.measure == one.measure


def test_restating_changes_speed_and_measure_together() -> None:
    mean = restated(CURVES["pole"], 1 / 1.49, averaging_s=60.0)
    assert mean.measure == "60 s mean at 10 m over land"
    assert mean.probability(40.0) == pytest.approx(CURVES["pole"].probability(1.49 * 40.0))


def test_every_shipped_curve_says_where_it_is_from() -> None:
    for name, one in CURVES.items():
        assert one.name == name
        assert one.source
        assert one.obtained
        assert one.element
        assert one.checked is ("memory" not in one.source)


@pytest.mark.parametrize(
    ("kind", "parameters", "words"),
    [
        ("normal", {}, "allowed: lognormal, piecewise, tabulated"),
        ("lognormal", {"median_mps": 45.0}, "'beta' is missing"),
        ("lognormal", {"median_mps": -1.0, "beta": 0.0, "b": 1.0}, "unknown parameter 'b'; median"),
        ("piecewise", {"v_crit_mps": 60.0, "v_collapse_mps": 30.0}, "not below v_collapse_mps"),
        ("piecewise", {"v_crit_mps": 3.0, "v_collapse_mps": 4.0, "beta": 1.0}, "both or neither"),
        ("tabulated", {"speed_mps": (1.0, 2.0)}, "allowed: speed_mps and probability"),
        ("tabulated", TABLE | {"probability": (0.0, 0.5, 0.1, 1.2)}, "probabilities fall; prob"),
        ("tabulated", TABLE | {"speed_mps": (1.0, 1.0, 2.0, 3.0)}, "do not rise"),
        ("tabulated", TABLE | {"speed_mps": (1.0,)}, "1 speeds and 4 probabilities"),
    ],
)
def test_no_curve(kind: str, parameters: dict[str, object], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        curve(kind, **parameters)


def test_no_measure_and_no_factor() -> None:
    with pytest.raises(UsageError, match=r"averaging_s 0\.0.*height_m -1.*exposure 'sea'"):
        Curve("x", "lognormal", {"median_mps": 45.0, "beta": 0.4}, 0.0, -1.0, "sea", "")
    with pytest.raises(UsageError, match="a factor above 0"):
        hardened(CURVES["pole"], 0.0)


def test_a_table_given_as_lists_is_hardened_like_one_of_tuples() -> None:
    table = {"speed_mps": [10.0, 20.0, 40.0], "probability": [0.0, 0.5, 1.0]}
    curve = Curve("t", "tabulated", table, 3.0, 10.0, "land", "")
    speed = np.array([12.0, 25.0, 39.0])
    for factor in (2, 1.3):
        found = hardened(curve, factor).probability(factor * speed)
        assert found == pytest.approx(curve.probability(speed))
