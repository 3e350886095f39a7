"""Cuts by sampled paths: forward with the cuts there are, backward to better ones."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.dispatch.sddp.blocks import Blocks
from resilience.dispatch.sddp.model import Cuts, Multistage, NoiseOutcomes
from resilience.dispatch.sddp.program import StageProgram
from resilience.progress import phase

Begin = tuple[Floats, Floats]
Start = Callable[[np.random.Generator, Floats | None], Begin]
"""Draws the states and the levels at which a path begins, told the states where the last ended."""


@dataclass(frozen=True)
class Settings:
    """How many paths, when to stop, and the seed.

    Attributes:
        iterations: at most so many.
        paths: of one iteration, which share the work of a pass.
        patience: stop once so many iterations gained less than `tolerance` in the bound.
        tolerance: of the bound, relative.
        jump: chance per slot that a path goes on from elsewhere, about half of its states being
            drawn anew: cuts are needed where the policy does not go yet.
        tidy: every so many iterations, cuts that are highest nowhere are dropped.
        seed: of the paths; the same one gives the same cuts.
    """

    iterations: int = 100
    paths: int = 1
    patience: int = 20
    tolerance: float = 1e-4
    jump: float = 0.05
    tidy: int = 20
    seed: int = 0


@dataclass(frozen=True)
class Paths:
    """Simulated paths.

    Attributes:
        states: (slots + 1, paths, states), those at the start first.
        levels: (paths, levels).
        modes: (slots, paths) index of the mode.
        cost: (paths,) $.
    """

    states: Floats
    levels: Floats
    modes: Ints
    cost: Floats


@dataclass(frozen=True)
class Trained:
    """What training gives.

    Attributes:
        cuts: by slot, then by mode: the future cost behind that slot.
        root: the cost of the whole path, as a function of where it begins.
        bounds: (iterations,) $: the lower bound after each iteration, proven, averaged over
            the beginnings that are watched.
    """

    cuts: list[list[Cuts]]
    root: Cuts
    bounds: Floats

    @property
    def bound(self) -> float:
        """Lower bound on the expected cost of any policy, $."""
        return float(self.bounds[-1])


class TrainingSlot:
    """All modes and outcomes of a slot, at several points at once, with the cuts of their futures.

    Blocks are numbered by point, then by mode, then by outcome.
    """

    def __init__(
        self, programs: list[StageProgram], modes: Sequence[NoiseOutcomes], levels: int, points: int
    ) -> None:
        self.noise, self.points = [mode.probability for mode in modes], points
        numbered = [(programs[m.stage], programs[m.stage].numbers(m, levels)) for m in modes]
        count = [len(p) for p in self.noise]
        self.first, self.n = np.cumsum(count) - count, sum(count)
        mode = np.repeat(np.arange(len(modes)), count)
        none = Cuts(np.zeros(0), np.zeros((0, numbered[0][0].n_now)), np.zeros((0, levels)))
        owner = np.tile(mode, points)
        self.blocks = Blocks(numbered * points, owner, none, np.zeros(0, np.intp))
        self._expect = np.zeros((len(modes), self.n))
        self._expect[mode, np.arange(self.n)] = np.concatenate(self.noise)

    def expected(self, states: Floats, levels: Floats) -> list[Cuts]:
        """Per point (points, ...) a cut per mode, on what is still to pay from this slot on."""
        cuts = self.blocks.bounds(*(np.repeat(x, self.n, axis=0) for x in (states, levels)))
        points = [slice(k * self.n, (k + 1) * self.n) for k in range(self.points)]
        return [cuts[blocks].mixed(self._expect) for blocks in points]

    def add_cuts(self, cuts: Sequence[Cuts]) -> None:
        """Takes more cuts, each of `cuts` holding one for every mode."""
        mode = np.tile(np.arange(len(self.noise)), len(cuts))
        self.blocks.add_cuts(Cuts.joined(cuts), mode)

    def replace_cuts(self, cuts: Sequence[Cuts]) -> None:
        """Takes the cuts of every mode, mode by mode, in place of those there are."""
        mode = np.repeat(np.arange(len(cuts)), [c.n for c in cuts])
        self.blocks.replace_cuts(Cuts.joined(cuts), mode)

    @property
    def cuts(self) -> list[Cuts]:
        """By mode."""
        return [self.blocks.cuts[self.blocks.cut_owner == m] for m in range(len(self.noise))]


class Engine:
    """The slots of a problem, all warm; `points` paths go through them at once."""

    def __init__(
        self, multistage: Multistage, cuts: list[list[Cuts]] | None = None, points: int = 1
    ) -> None:
        self.multistage, self.points = multistage, points
        programs = [StageProgram(stage) for stage in multistage.stages]
        levels = multistage.levels
        self.slots = [
            TrainingSlot(programs, modes, levels, points) for modes in multistage.outcomes
        ]
        for slot, slot_cuts in zip(self.slots, cuts or [], strict=False):
            slot.replace_cuts(slot_cuts)
        self.slots[-1].replace_cuts([multistage.terminal] * len(multistage.outcomes[-1]))

    def forward(
        self, begin: Begin, rng: np.random.Generator, jump: Callable[[Floats], Floats] | None = None
    ) -> Paths:
        """Paths from (points, states) and (points, levels), with the cuts there are.

        `jump` may replace the states, (points, states), behind every slot.
        """
        state, levels = begin
        states, cost = [state], np.zeros(self.points)
        modes = [np.zeros(self.points, np.intp)]
        for slot, transition in zip(self.slots, self.multistage.transition, strict=True):
            mode = np.array([_draw(transition[m], rng) for m in modes[-1]])
            noise = [_draw(slot.noise[m], rng) for m in mode]
            chosen = np.arange(self.points) * slot.n + slot.first[mode] + noise
            after, spent = slot.blocks.step(chosen, states[-1], levels)
            states.append(jump(after) if jump else after)
            modes.append(mode)
            cost += spent
        terminal = self.multistage.terminal
        cost += [terminal.value(*end) for end in zip(states[-1], levels, strict=True)]
        return Paths(np.array(states), levels, np.array(modes[1:]), cost)

    def backward(self, states: Floats, levels: Floats) -> Cuts:
        """Cuts for every slot and mode at (slots, points, states); returns those of the whole."""
        transition = self.multistage.transition
        for t in range(self.multistage.slots - 1, 0, -1):
            expected = self.slots[t].expected(states[t], levels)
            self.slots[t - 1].add_cuts([cuts.mixed(transition[t]) for cuts in expected])
        expected = self.slots[0].expected(states[0], levels)
        return Cuts.joined([cuts.mixed(transition[0]) for cuts in expected])

    def tidy(self, paths: list[Paths]) -> None:
        """Drops cuts that are highest at none of the states that paths have visited."""
        levels = np.concatenate([path.levels for path in paths])
        for t, slot in enumerate(self.slots[:-1]):
            states = np.concatenate([path.states[t + 1] for path in paths])
            slot.replace_cuts([cuts.useful(states, levels) for cuts in slot.cuts])

    @property
    def cuts(self) -> list[list[Cuts]]:
        """By slot, then by mode."""
        return [slot.cuts for slot in self.slots]


def train(
    multistage: Multistage,
    start: Start,
    probes: Sequence[Begin],
    settings: Settings | None = None,
) -> Trained:
    """Iterates until the bound stalls.

    Args:
        multistage: what to learn the future cost of.
        start: where paths begin; every path may begin elsewhere.
        probes: beginnings at which the bound is taken, and its mean watched.
        settings: when to stop.
    """
    settings = settings or Settings()
    rng = np.random.default_rng(settings.seed)
    every: list[Paths] = []
    bounds: list[float] = []

    def begin() -> Begin:
        last = every[-1].states[-1] if every else [None] * settings.paths
        drawn = [start(rng, ended) for ended in last]
        return np.array([x for x, _ in drawn]), np.array([levels for _, levels in drawn])

    def jump(states: Floats) -> Floats:
        anew = rng.random(len(states)) < settings.jump
        for row in np.flatnonzero(anew):
            drawn, _ = start(rng, None)
            states[row] = np.where(rng.random(len(drawn)) < 0.5, drawn, states[row])
        return states

    with phase("cuts", f"{multistage.slots} slots, {sum(map(len, multistage.outcomes))} modes"):
        engine = Engine(multistage, points=settings.paths)
        states, levels = begin()
        # The first cuts need no policy: going backward, every future is met before it is used.
        root = engine.backward(np.repeat(states[None], multistage.slots, axis=0), levels)
        while len(every) < settings.iterations and not _stalled(bounds, settings):
            paths = engine.forward(begin(), rng, jump)
            every.append(paths)
            root = Cuts.joined([root, engine.backward(paths.states, paths.levels)])
            bounds.append(float(np.mean([root.value(*probe) for probe in probes])))
            if len(every) % settings.tidy == 0:
                engine.tidy(every)
        engine.tidy(every)
    return Trained(engine.cuts, root, np.array(bounds))


def _stalled(bounds: list[float], settings: Settings) -> bool:
    if len(bounds) <= settings.patience:
        return False
    gained = bounds[-1] - bounds[-1 - settings.patience]
    return gained <= settings.tolerance * abs(bounds[-1])


def _draw(probability: Floats, rng: np.random.Generator) -> int:
    return int(np.searchsorted(np.cumsum(probability)[:-1], rng.random(), side="right"))
