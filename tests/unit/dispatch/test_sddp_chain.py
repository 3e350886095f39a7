"""Lines as a Markov chain: what a mode keeps of the outage process, and what it averages over."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from resilience.arrays import Floats
from resilience.dispatch.sddp.chain import ModeChain, storm_chain
from resilience.fragility.draw import draw_day, outage_paths
from resilience.fragility.outages.bell import Bell

PER_DAY = 96
DRAWS = 6000


def marginals(chain: ModeChain) -> tuple[Floats, Floats]:
    """(slots, lines) chance of being down, and (slots,) of all being down at once."""
    chance, down, every = np.ones(1), [], []
    for modes, moves in zip(chain.down, chain.transition, strict=True):
        chance = chance @ moves
        down.append(chance @ modes)
        every.append(chance @ modes.all(axis=1))
    return np.array(down), np.array(every)


def sampled(bell: Bell, lines: int) -> tuple[Floats, Floats]:
    """The same from the process itself, on the second of two days."""
    rng = np.random.default_rng(0)
    days = [draw_day(bell, lines, PER_DAY, [rng] * DRAWS) for _ in range(2)]
    down = outage_paths(days, bell)[:, :, PER_DAY:]
    return down.mean(axis=0).T, down.all(axis=1).mean(axis=0)


@pytest.mark.parametrize(
    "bell",
    [
        Bell(centres=(60,)),
        Bell(centres=(80,), refail=True),
        Bell(centres=(40, 60), duration_slots=(24, 60), overnight=True),
        Bell(centres=(60,), sigma_slots=8.0, probability=0.4),
    ],
)
def test_the_chance_of_being_down_is_that_of_the_process(bell: Bell) -> None:
    chain = storm_chain(bell, 2, np.array(bell.centres), PER_DAY)
    down, _ = marginals(chain)
    often, _ = sampled(bell, 2)
    np.testing.assert_allclose(down, often, atol=4.5 * 0.5 / np.sqrt(DRAWS))


def test_lines_are_independent_given_the_centre() -> None:
    bell = Bell(shift_slots=0)
    down, every = marginals(storm_chain(bell, 3, np.array([48]), PER_DAY))
    np.testing.assert_allclose(every, down.prod(axis=1), atol=1e-5)


def test_a_certain_outage_of_one_slot_has_a_closed_form() -> None:
    """Fails with p in a slot, is back in the next and may fail again: down with p in every slot."""
    bell = Bell(duration_slots=(1, 1), refail=True, shift_slots=0)
    chain = storm_chain(bell, 1, np.array([48]), PER_DAY)
    chance = bell.slot_probability(48)
    down, _ = marginals(chain)
    np.testing.assert_allclose(down[:, 0], np.where(chance < 1e-4, 0.0, chance), atol=2e-5)
    at = chain.transition[48]
    np.testing.assert_allclose(at, np.tile([1.0 - chance[48], chance[48]], (2, 1)), atol=1e-12)


def test_a_line_that_fails_once_is_back_for_good() -> None:
    """Outages of one slot, one a day: whoever is down is back, whoever is up may still fail."""
    bell = Bell(duration_slots=(1, 1), shift_slots=0)
    chain = storm_chain(bell, 1, np.array([52]), PER_DAY)
    chance = bell.slot_probability(52)
    first = chance * np.cumprod(np.append(1.0, 1.0 - chance[:-1]))  # fails for the first time
    for t in (49, 52, 55):
        assert chain.down[t].ravel().tolist() == [False, True]
        fails = first[t] / (1.0 - first[t - 1])
        np.testing.assert_allclose(chain.transition[t], [[1.0 - fails, fails], [1.0, 0.0]])


def test_one_random_number_for_all_makes_failures_coincide() -> None:
    apart = Bell(shift_slots=0)
    bell = replace(apart, common_draw=True)
    chain = storm_chain(bell, 2, np.array([48]), PER_DAY)
    chance = bell.slot_probability(48)[40]
    first = chain.transition[40][0]
    both = [row.all() for row in chain.down[40]]
    assert first[both].sum() == pytest.approx(chance, rel=1e-6)


def test_modes_live_around_the_storm_only() -> None:
    chain = storm_chain(Bell(overnight=False), 4, np.array([48]), PER_DAY)
    count = np.array([len(modes) for modes in chain.down])
    assert (count[:28] == 1).all()
    assert (count[40:68] == 16).all()
    assert (count[88:] == 1).all()
    for before, modes, moves in zip([1, *count[:-1]], count, chain.transition, strict=True):
        assert moves.shape == (before, modes)
        np.testing.assert_allclose(moves.sum(axis=1), 1.0)


def test_a_mode_that_is_left_out_is_answered_by_its_nearest() -> None:
    chain = storm_chain(Bell(overnight=False), 4, np.array([48]), PER_DAY)
    assert chain.mode(0, np.array([True, False, False, False])) == 0
    asked = np.array([True, False, True, False])
    assert (chain.down[50][chain.mode(50, asked)] == asked).all()
