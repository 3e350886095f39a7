"""The program behind rolling dispatch: a first slot common to all, then chains, solved anew in
every slot.

Eight slots are followed by ten blocks of an hour, unless said otherwise. What a slot changes, line
status, forecasts, prices, path probabilities, the worth of energy at the end, enters by bounds,
right-hand sides and the cost vector, so a program is built once and keeps its basis.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Bools, Floats, Ints
from resilience.case import Case
from resilience.dispatch.merged_grid import MergedGrid, profiles_of
from resilience.dispatch.reserve import Reserve
from resilience.errors import UsageError
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import lower
from resilience.models.backends.risk_averse import RiskAverse
from resilience.models.language.tree import Tree
from resilience.models.program.risk import Risk
from resilience.models.program.standard import Vectors
from resilience.models.program.unroll import unroll
from resilience.simulation.world import Forecast

MEAN = Risk()
POWERS = ("MW", "Mvar")  # units of data that shrink with the part of a step that is left


@dataclass(frozen=True)
class WindowSteps:
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

    @cached_property
    def width(self) -> Ints:
        """(steps,) slots of every step."""
        return np.repeat([1, self.block_slots], [self.slots, self.blocks])

    @cached_property
    def starts(self) -> Ints:
        """(steps,) first slot of every step."""
        return np.cumsum(self.width) - self.width

    def tree(self, paths: int) -> Tree:
        """A first slot common to all, then `paths` chains, equally likely until told otherwise."""
        later = self.n - 1
        parent = np.concatenate([[-1], *(self._chain(p) for p in range(paths))])
        chance = np.append(1.0, np.full(paths * later, 1.0 / paths))
        stage = np.append(0, np.tile((np.arange(1, self.n) >= self.slots).astype(int), paths))
        names = [f"path {p + 1} step {k}" for p in range(paths) for k in range(1, self.n)]
        return Tree(parent.astype(np.intp), chance, stage.astype(np.intp), ("now", *names))

    def _chain(self, path: int) -> Ints:
        first = 1 + path * (self.n - 1)
        found = np.arange(first - 1, first + self.n - 2)
        found[:1] = 0
        return found


@dataclass(frozen=True)
class WindowRequest:
    """What a program is asked at slot `t`.

    Attributes:
        t: slot of the horizon.
        energy: (units,) stored energy, MWh.
        up: (lines of the case, steps, paths) line status; the first step is the same in all paths.
        share: (paths,) probability of every path.
        forecast: of profiles, by name and slots.
        value: (units,) $ per MWh left at the end of the steps.
        reserve: level in MWh and price in $/MWh, (buses with storage, steps) each, where there is
            one.
    """

    t: int
    energy: Floats
    up: Bools
    share: Floats
    forecast: Forecast
    value: Floats
    reserve: tuple[Floats, Floats] | None = None


def check_storage(case: Case) -> None:
    """Checks that there is something to decide ahead of time.

    Raises:
        UsageError: the case has no storage.
    """
    if not case.ess:
        raise UsageError(
            f"case {case.name!r} has no storage; allowed: a case with [[ess]]",
            hint="without storage there is nothing to look ahead for; `solve` plans it",
        )


class WindowProgram:
    """`paths` chains behind a common first slot.

    Args:
        small: the microgrid, its like devices joined.
        steps: of every path.
        paths: how many.
        reserve: rows of a reserve, if any.
        risk: what counts besides the mean over the paths.
    """

    def __init__(
        self,
        small: MergedGrid,
        steps: WindowSteps,
        paths: int,
        reserve: Reserve | None = None,
        risk: Risk = MEAN,
    ) -> None:
        self.small, self.steps, self.paths = small, steps, paths
        check_storage(small.microgrid.case)
        dt = small.microgrid.case.step_h
        stages = [small.microgrid.stage(dt), small.microgrid.stage(dt * steps.block_slots)]
        if reserve is not None:
            for stage in stages:
                reserve.emit(stage)
        if not steps.blocks:
            stages = stages[:1]
        self.standard = standard = unroll(stages, steps.tree(paths))
        lowered = lower(standard, integer=np.zeros(standard.n_columns, bool), exact={})
        averse = risk.averse and paths > 1
        make = partial(RiskAverse, risk=risk) if averse else Highs
        self.solver: Highs = make(lowered, duals=False, threads=1)
        later = np.arange(1, steps.n)
        self.step_of = np.append(0, np.tile(later, paths))
        self.path_of = np.append(0, np.repeat(np.arange(paths), len(later)))
        ends = standard.tree.leaves
        self._end = standard.columns("ess.energy")[:, ends]
        self._first = [standard.columns(f"ess.{way}")[:, 0] for way in ("charge", "discharge")]
        self._column_path = self._paths_of_columns()
        self._powers = {b.name for s in stages for b in s.datums if b.unit in POWERS}

    def _paths_of_columns(self) -> Ints:
        """(columns,) path of every column, -1 for what is common to all."""
        found = np.full(self.standard.n_columns, -1)
        for form, table, nodes in zip(
            self.standard.forms, self.standard.tables, self.standard.members, strict=True
        ):
            own = np.where(nodes > 0, self.path_of[nodes], -1)
            found[table[:, form.n_now :]] = own[:, None]
        return found

    def data(self, asked: WindowRequest) -> dict[str, Floats]:
        """The data of every node for what is asked, arrays (labels, nodes)."""
        steps, small = self.steps, self.small
        last = small.microgrid.case.slots - 1
        at = np.minimum(asked.t + np.arange(steps.horizon), last)
        means = {
            name: np.add.reduceat(asked.forecast(name, at), steps.starts) / steps.width
            for name in profiles_of(small.microgrid.case)
            if name not in small.mixed
        }
        for members, _ in small.mixed.values():
            for name in members:
                if name not in means:
                    mean = np.add.reduceat(asked.forecast(name, at), steps.starts) / steps.width
                    means[name] = mean
        profile = small.profile(lambda name: means[name][self.step_of])
        up = asked.up[:, self.step_of, self.path_of]
        data = small.microgrid.data(small.microgrid.situation(up, profile))
        left = np.clip(last + 1 - asked.t - steps.starts, 0, steps.width) / steps.width
        if left[-1] < 1.0:
            data = {k: v * left[self.step_of] if k in self._powers else v for k, v in data.items()}
        if asked.reserve is not None:
            level, price = asked.reserve
            data["reserve.level"] = level[:, self.step_of]
            data["reserve.price"] = price[:, self.step_of]
        return data

    def vectors(self, asked: WindowRequest, data: dict[str, Floats] | None = None) -> Vectors:
        """All numbers of the program for what is asked."""
        given = self.data(asked) if data is None else data
        found = self.standard.vectors(given, {"ess.energy": asked.energy})
        shared = self._column_path < 0
        weight = np.where(shared, 1.0, self.paths * asked.share[self._column_path])
        found.cost *= weight
        found.cost[self._end] -= asked.share * asked.value[:, None]
        return found

    def _worth(self, value: Floats) -> sp.csr_array:
        """(paths, columns) $ per MWh left at the end of every path, as a cost."""
        units, paths = self._end.shape
        at = (np.tile(np.arange(paths), units), self._end.ravel())
        shape = (paths, self.standard.n_columns)
        return sp.csr_array((np.repeat(-value, paths), at), shape=shape)

    def decide(self, asked: WindowRequest) -> Floats:
        """(units,) charging power in the first slot, MW; negative is discharging."""
        data = self.data(asked)
        if isinstance(self.solver, RiskAverse):
            self.solver.weigh(asked.share)
            self.solver.price(data, self._worth(asked.value))
        self.solver.update(self.vectors(asked, data))
        z = self.solver.solve().point
        return z[self._first[0]] - z[self._first[1]]
