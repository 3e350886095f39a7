"""Whether a dispatcher acts on what has not happened yet: two worlds that are alike up to a slot.

After that slot everything is replaced: lines are up or down at random, load and PV are off their
forecast otherwise, and hazards peak elsewhere, today's too where nobody is told it. Up to the slot,
and in it, actions must be the same to the last bit.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from resilience.arrays import Floats
from resilience.errors import CertificateError
from resilience.fragility.outages.bell import REFERENCE_SLOTS
from resilience.progress import meter
from resilience.simulation.observation import Action, Dispatcher, Observation, parts_of
from resilience.simulation.setting import Setting
from resilience.simulation.simulate import simulate
from resilience.simulation.world import World

Factory = Callable[[Setting], Dispatcher]


class _EnoughSeenError(Exception):
    """The slot up to which actions are compared has passed."""


@dataclass
class _Overheard:
    """Passes observations on to a dispatcher and notes its actions, up to a slot."""

    name: str
    dispatcher: Dispatcher
    last: int
    actions: list[Floats]

    def act(self, observation: Observation) -> Action:
        """The dispatcher's action."""
        action = self.dispatcher.act(observation)
        stated = [np.array(powers, float) for powers in parts_of(action) if powers is not None]
        self.actions.append(np.concatenate(stated))
        if observation.t == self.last:
            raise _EnoughSeenError
        return action


def check_causality(
    world: World,
    makers: Mapping[str, Factory],
    *,
    episodes: int = 2,
    slots: int = 3,
    seed: int = 0,
) -> list[int]:
    """Holds dispatchers against worlds whose future was replaced.

    Args:
        world: where they act.
        makers: how to make every dispatcher.
        episodes: of the world, its first ones; each by itself.
        slots: how many slots are drawn, one in every part of the first day or of the horizon if
            that is shorter; the future after each of them is replaced in turn.
        seed: of the slots and of the futures.

    Returns:
        The slots.

    Raises:
        CertificateError: a method acts otherwise before anything is different; with method,
            episode and slot.
    """
    rng = np.random.default_rng(seed)
    reach = min(world.microgrid.case.slots - 1, world.microgrid.case.window.slots_per_day)
    edges = np.linspace(0, reach, slots + 1).astype(int)
    chosen = [int(rng.integers(a, max(b, a + 1))) for a, b in pairwise(edges)]
    count = min(episodes, world.scenarios.n)
    with meter("causality", len(makers) * count * len(chosen)) as progress:
        for name, make in makers.items():
            for k in range(count):
                episode = world.with_scenarios(np.array([k]))
                actions = _actions(episode, make, max(chosen))
                for slot in chosen:
                    changed_world = with_another_future(episode, slot, rng)
                    _compare(
                        name,
                        int(episode.index[0]),
                        slot,
                        actions,
                        _actions(changed_world, make, slot),
                    )
                    progress.advance(1)
    return chosen


def with_another_future(world: World, slot: int, rng: np.random.Generator) -> World:
    """The same world up to a slot, and another one afterwards.

    Args:
        world: the world.
        slot: the last one that stays.
        rng: of what comes then.
    """
    scenarios, outlook = world.scenarios, world.outlook
    down, centre = scenarios.down.copy(), scenarios.centre
    after = down[:, slot + 1 :]
    down[:, slot + 1 :] = np.where(rng.random(after.shape) < 0.5, after, ~after)
    if centre is not None:
        centre = centre.copy()
        first = world.microgrid.case.window.day_number(slot) + (1 if world.known_centre else 0)
        centre[first:] = rng.integers(0, REFERENCE_SLOTS, centre[first:].shape)
    if outlook is not None:
        error = outlook.error.copy()
        spread = max(float(np.abs(error).max(initial=0.0)), 0.05)
        error[:, slot + 1 :] = rng.normal(0.0, spread, error[:, slot + 1 :].shape)
        outlook = replace(outlook, error=error)
    return replace(world, scenarios=replace(scenarios, down=down, centre=centre), outlook=outlook)


def _actions(world: World, make: Factory, last: int) -> Floats:
    """(slots, units, batch) what a fresh dispatcher does up to a slot, rations included."""
    recorder = _Overheard("recorder", make(world.setting), last, [])
    with contextlib.suppress(_EnoughSeenError):
        simulate(world, recorder)
    return np.array(recorder.actions)


def _compare(name: str, episode: int, slot: int, actions: Floats, changed: Floats) -> None:
    differs = np.flatnonzero((actions[: slot + 1] != changed[: slot + 1]).any(axis=(1, 2)))
    if len(differs):
        first = int(differs[0])
        raise CertificateError(
            f"{name} acts otherwise in slot {first} of episode {episode} if only what comes after "
            f"slot {slot} is replaced; allowed: the same action to the last bit",
            hint="use the observation alone, and random numbers of a stream that "
            "`setting.numbers` keys",
        )


def causality_text(methods: Iterable[str], slots: Iterable[int], world: World) -> str:
    """What was found, in words."""
    window = world.microgrid.case.window
    when = ", ".join(f"{window.time(t):%H:%M}" for t in slots)
    return (
        f"Up to {when} of the first day, {', '.join(methods)} act alike to the last bit if all "
        "that comes later is replaced."
    )
