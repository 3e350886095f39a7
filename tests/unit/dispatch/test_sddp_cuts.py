"""Cuts by hand: the highest one depends on its constant, on the levels, and on the state."""

from __future__ import annotations

import numpy as np
import pytest

from resilience.dispatch.sddp.model import Cuts, Multistage, NoiseOutcomes
from resilience.dispatch.sddp.program import StageProgram
from resilience.dispatch.sddp.training import Engine, Paths
from resilience.models.language.stage import Stage

CUTS = Cuts(
    np.array([3.0, 10.0, -2.0]),
    np.array([[2.0, -0.5], [-1.0, 0.25], [0.75, 3.0]]),
    np.array([[0.5], [2.0], [4.0]]),
)
STATE = np.array([1.5, 2.5])  # slopes times state: 1.75, -0.875, 8.625


@pytest.mark.parametrize(
    ("level", "value", "slope"),
    [(0.3, 10.6 - 0.875, [-1.0, 0.25]), (5.0, 18.0 + 8.625, [0.75, 3.0])],
)
def test_the_highest_cut_gives_value_and_slope(
    level: float, value: float, slope: list[float]
) -> None:
    levels = np.array([level])
    assert CUTS.value(STATE, levels) == pytest.approx(value)
    assert CUTS.slope(STATE, levels).tolist() == slope


def test_a_mixture_of_cuts_is_worth_the_mixture_of_their_worths() -> None:
    weights, levels = np.array([[0.2, 0.3, 0.5], [0.6, 0.1, 0.3]]), np.array([1.7])
    each = CUTS.constants(levels) + CUTS.beta @ STATE
    mixed = CUTS.mixed(weights)
    np.testing.assert_allclose(mixed.constants(levels) + mixed.beta @ STATE, weights @ each)


def test_joined_cuts_are_those_of_all_batches_in_their_order() -> None:
    joined = Cuts.joined([CUTS[1:], CUTS[:2]])
    levels = np.array([2.3])
    every = CUTS.constants(levels)
    np.testing.assert_allclose(joined.constants(levels), every[[1, 2, 0, 1]])
    assert joined.n == 4


def test_what_remains_is_worth_its_price() -> None:
    cuts = Cuts.of_prices(np.array([4.0, 7.0]), levels=2)
    assert cuts.value(STATE, np.array([3.0, 9.0])) == pytest.approx(-(4.0 * 1.5 + 7.0 * 2.5))


def warehouse() -> Multistage:
    """Three half hours in which a store buys, or is drawn from; the last two may be rough."""
    stage = Stage(0.5)
    before, after = stage.state("store", ["a"], 0.0, 9.0, unit="MWh")
    buy = stage.var("buy", ["a"], 0.0, 4.0)
    stage.eq("balance", after - before, buy * stage.dt - stage.data("need", ["a"]))
    stage.cost("buy", buy, stage.data("price", ["a"]))
    calm, rough = (
        NoiseOutcomes(0, np.ones(1), {"need": np.full((1, 1, 1), need), "price": PRICE})
        for need in (0.3, 0.7)
    )
    both = np.array([[0.6, 0.4], [0.2, 0.8]])
    return Multistage(
        [stage],
        [[calm], [calm, rough], [calm, rough]],
        [np.ones((1, 1)), both[:1], both],
        Cuts.of_prices(np.array([6.0])),
    )


PRICE = np.full((1, 1, 1), 2.5)


def lines_through(*points: tuple[float, float]) -> Cuts:
    """Cuts of one state from their constants and slopes."""
    alpha, beta = np.array(points).T
    return Cuts(alpha, beta[:, None], np.zeros((len(alpha), 0)))


def test_the_end_is_worth_its_price_in_every_mode() -> None:
    last = Engine(warehouse()).slots[-1]
    assert [cuts.beta.tolist() for cuts in last.cuts] == [[[-6.0]], [[-6.0]]]


def test_every_slot_keeps_the_cuts_that_are_highest_where_it_was_left() -> None:
    # 20 - 3 s is higher than 8 - 0.5 s where s < 4.8: so at 2 MWh, behind the first slot, and
    # not at 7, behind the second.
    steep, flat = (20.0, -3.0), (8.0, -0.5)
    both = lines_through(steep, flat)
    engine = Engine(warehouse(), [[both], [both, both]])
    states = np.array([[[3.0]], [[2.0]], [[7.0]], [[5.0]]])
    engine.tidy([Paths(states, np.zeros((1, 0)), np.zeros((3, 1), np.intp), np.zeros(1))])
    kept = [[cuts.alpha.tolist() for cuts in slot.cuts] for slot in engine.slots[:-1]]
    assert kept == [[[20.0]], [[8.0], [8.0]]]


@pytest.mark.parametrize("level", [1, 2])
def test_a_price_that_depends_on_a_level_is_refused(level: int) -> None:
    problem = warehouse()
    price = np.zeros((1, 2, 3))
    price[:, :, 0], price[0, 1, level] = 2.5, 0.4
    need = np.full((1, 2, 3), 0.3)
    outcomes = NoiseOutcomes(0, np.array([0.4, 0.6]), {"need": need, "price": price})
    with pytest.raises(ValueError, match="prices depend on a level"):
        StageProgram(problem.stages[0]).numbers(outcomes, 2)
