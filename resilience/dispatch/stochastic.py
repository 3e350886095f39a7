"""The hazard-aware fan: a two-stage program over sampled outage paths, solved anew every slot.

The first slot is common to all paths; from the second on, each path knows its own outages. Eight
slots are followed by ten blocks of an hour. Where no path has an outage, the chain of one path
decides, which is the same program. Everything that changes enters by bounds and right-hand sides,
so both programs are built once and keep their basis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from resilience.dispatch.base import Observation, World
from resilience.fragility.bell import Bell
from resilience.fragility.conditional import Known, futures
from resilience.models.algebra import Floats, Ints
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import lower
from resilience.models.tree import Cut, Tree
from resilience.models.unroll import unroll


@dataclass(frozen=True)
class Steps:
    """The time steps of a path: `slots` single ones, then `blocks` of `block_slots` each."""

    slots: int = 8
    blocks: int = 10
    block_slots: int = 4

    @property
    def n(self) -> int:
        """Number of steps."""
        return self.slots + self.blocks

    @property
    def horizon(self) -> int:
        """Number of slots that the steps cover."""
        return self.slots + self.blocks * self.block_slots

    @property
    def starts(self) -> Ints:
        """(steps,) first slot of every step."""
        later = self.slots + self.block_slots * np.arange(self.blocks)
        return np.concatenate([np.arange(self.slots), later])

    def tree(self, paths: int) -> Tree:
        """A first slot common to all, then `paths` equally likely chains."""
        parent, stage, labels, chance = [-1], [0], ["now"], [1.0]
        for path in range(paths):
            for k in range(1, self.n):
                parent.append(0 if k == 1 else len(parent) - 1)
                stage.append(int(k >= self.slots))
                labels.append(f"path {path + 1} step {k}")
                chance.append(1.0 / paths)
        return Tree(np.array(parent), np.array(chance), np.array(stage), tuple(labels))

    def spread(self, first: Floats, later: Floats) -> Floats:
        """(..., nodes) from values now (...) and per step and path (..., steps - 1, paths)."""
        rest = np.moveaxis(later, -1, -2).reshape(*later.shape[:-2], -1)
        return np.concatenate([first[..., None], rest], axis=-1)


class Program:
    """The fan with a given number of paths, built once."""

    def __init__(self, world: World, steps: Steps, paths: int, value_per_mwh: float) -> None:
        self.grid, self.steps, self.paths = world.grid, steps, paths
        dt = world.grid.case.step_h
        stages = [world.grid.stage(dt), world.grid.stage(dt * steps.block_slots)]
        cut = Cut(0.0, {"ess.energy": np.full(len(world.grid.case.ess), -value_per_mwh)})
        self.problem = unroll(stages, steps.tree(paths), [cut] if value_per_mwh else [])
        self.solver = Highs(lower(self.problem, exact={}), duals=False)
        self.first = [self.problem.columns(f"ess.{way}")[:, 0] for way in ("charge", "discharge")]

    def decide(self, t: int, energy: Floats, up: Floats) -> Floats:
        """(units,) charging power now, for line status `up` (lines, horizon, paths) from slot t."""
        steps, case = self.steps, self.grid.case
        status = np.minimum.reduceat(up, steps.starts, axis=1)
        line_up = steps.spread(status[:, 0, 0], status[:, 1:])
        at = np.minimum(t + np.arange(steps.horizon), case.slots - 1)
        width = np.diff(np.append(steps.starts, steps.horizon))

        def profile(name: str | None) -> Floats:
            means = np.add.reduceat(case.profile(name)[at], steps.starts) / width
            later = np.repeat(means[1:, None], self.paths, axis=1)
            return steps.spread(means[0], later)

        data = self.grid.data(self.grid.situation(line_up.astype(bool), profile))
        self.solver.update(self.problem.vectors(data, {"ess.energy": energy}))
        z = self.solver.solve().point
        found: Floats = z[self.first[0]] - z[self.first[1]]
        return found


class Stochastic:
    """Two-stage dispatch over sampled outages, conditioned on what is known.

    Args:
        world: where it acts.
        bell: the outage process that it believes in.
        paths: sampled futures; fewer than 30 miss rare joint outages.
        value_per_mwh: worth of energy at the end of the horizon, $/MWh.
        seed: of the sampled futures; they have nothing to do with the storms it is judged on.
    """

    def __init__(
        self,
        world: World,
        bell: Bell,
        *,
        paths: int = 30,
        value_per_mwh: float = 0.0,
        steps: Steps | None = None,
        seed: int = 0,
    ) -> None:
        self.name, self.world, self.bell, self.paths = "stochastic", world, bell, paths
        self.steps = steps or Steps()
        self.fan = Program(world, self.steps, paths, value_per_mwh)
        self.chain = Program(world, self.steps, 1, value_per_mwh)
        self.rng = np.random.default_rng(seed)
        case = world.grid.case
        self.per_day = round(24.0 / case.step_h)
        self.lines = [case.network.line(name) for name in world.scenarios.lines]
        shape = (len(self.lines), world.scenarios.n)
        self.since = np.full(shape, -1)
        self.spent = np.zeros(shape, bool)

    def act(self, seen: Observation) -> Floats:
        """The common first slot of every scenario's program."""
        clock = seen.t % self.per_day
        self._remember(clock, ~seen.line_up[self.lines])
        found = np.empty_like(seen.energy)
        for k in range(seen.energy.shape[1]):
            known = Known(clock, int(seen.centre[k]), self.since[:, k], self.spent[:, k])
            later = futures(
                self.bell, known, self.steps.horizon - 1, self.per_day, self.paths, self.rng
            )
            program = self.fan if later.any() else self.chain
            up = np.ones((len(seen.line_up), self.steps.horizon, program.paths))
            up[:, 0] = seen.line_up[:, [k]]
            if program is self.fan:
                up[self.lines, 1:] = ~later
            found[:, k] = program.decide(seen.t, seen.energy[:, k], up)
        return found

    def _remember(self, clock: int, down: np.ndarray) -> None:
        if clock == 0:
            self.since[:], self.spent[:] = -1, False
        began = down & (self.since < 0)
        self.since[began] = clock
        self.since[~down] = -1
        self.spent |= down
