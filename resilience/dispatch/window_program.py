"""The program behind rolling dispatch: a first slot common to all, then chains, solved anew in
every slot.

Eight slots are followed by ten blocks of four, unless said otherwise. What a slot changes, line
status, forecasts, prices, path probabilities, the worth of energy at the end, enters by bounds,
right-hand sides and the cost vector, so a program is built once and keeps its basis.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Bools, Floats, Ints
from resilience.case import Case
from resilience.case.schema import LoadTable
from resilience.dispatch.decision_columns import DecisionColumns
from resilience.dispatch.merged_grid import MergedGrid, profiles_of
from resilience.dispatch.reserve import Reserve
from resilience.dispatch.window_plan import WindowPlan, window_plan
from resilience.errors import UsageError
from resilience.models.backends.branching import Branching
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import lower
from resilience.models.backends.risk_averse import RiskAverse
from resilience.models.case_program import line_up_before
from resilience.models.components.generator import BOUND
from resilience.models.language.tree import Tree
from resilience.models.program.risk import Risk
from resilience.models.program.standard import Vectors
from resilience.models.program.unroll import unroll
from resilience.models.simulator import Decision, part_by_part
from resilience.simulation.observation import Action, Forecast, Observation, Rationed

RISK_NEUTRAL = Risk()
"""Nothing but the mean counts."""

FAR_BLOCK_H = 4.0
MAX_REACH_H = 48.0
"""Paths know from their second slot on how long they last, so that longer ones keep too much."""

GAP = 1e-6
"""Share of the cost, and $, by which the commitment of a first slot may miss the optimum."""

LATER = 1e-7
"""Share by which shedding costs less for every slot that it comes later: of plans that cost the
same, the one that serves loads now is taken, as what is ahead may turn out better."""

POWER_UNITS = ("MW", "Mvar", "m³/h")
"""Units of data that shrink with the part of a step that lies within the horizon."""


@dataclass(frozen=True)
class WindowSteps:
    """The time steps of a path.

    Attributes:
        slots: steps of a slot each, which come first.
        blocks: longer steps behind them.
        block_slots: slots of each of these.
        far_blocks: still longer steps behind these.
        far_slots: slots of each of those.
    """

    slots: int = 8
    blocks: int = 10
    block_slots: int = 4
    far_blocks: int = 0
    far_slots: int = 16

    @classmethod
    def with_fuel(cls, longest_slots: int, step_h: float) -> WindowSteps:
        """Steps for who must keep fuel: they cover an outage of so many slots, or two days of it.

        Storage is filled again when the sun shines, and half a day ahead is far enough for it; a
        tank is not.

        Args:
            longest_slots: of outages.
            step_h: length of a slot; a far block is 4 hours, or as long as the blocks before it.
        """
        usual = cls()
        width = max(round(FAR_BLOCK_H / step_h), usual.block_slots)
        slots = min(longest_slots, round(MAX_REACH_H / step_h))
        return cls(far_blocks=-(-max(slots - usual.horizon, 0) // width), far_slots=width)

    @property
    def n(self) -> int:
        """Number of steps."""
        return self.slots + self.blocks + self.far_blocks

    @property
    def horizon(self) -> int:
        """Number of slots that the steps cover."""
        return int(self.width.sum())

    @property
    def widths(self) -> list[int]:
        """Slots of every kind of step that there is, the first kind first."""
        kinds = [(1, 1), (self.block_slots, self.blocks), (self.far_slots, self.far_blocks)]
        return [width for width, steps in kinds if steps]

    @cached_property
    def width(self) -> Ints:
        """(steps,) slots of every step."""
        widths = [1, self.block_slots, self.far_slots]
        return np.repeat(widths, [self.slots, self.blocks, self.far_blocks])

    def down(self, slot_by_slot: Bools) -> Bools:
        """(lines, steps - 1, paths) where lines are down in the steps behind the first.

        A short step is down where any of its slots is, as a slot is that an outage touches; a far
        one where half of its slots are, or each outage there would last a step more.

        Args:
            slot_by_slot: (lines, slots, paths) likewise, from the second slot on.
        """
        first, later = self.starts[1:] - 1, self.width[1:, None]
        if not self.far_blocks:
            return np.logical_or.reduceat(slot_by_slot, first, axis=1)
        slots_down = np.add.reduceat(slot_by_slot, first, axis=1, dtype=np.intp)
        return np.asarray(slots_down >= np.where(self.kind[1:, None] == 2, later / 2.0, 1))

    @cached_property
    def kind(self) -> Ints:
        """(steps,) which of `widths` a step has."""
        steps = [count for count in (self.slots, self.blocks, self.far_blocks) if count]
        return np.repeat(np.arange(len(steps)), steps)

    @cached_property
    def starts(self) -> Ints:
        """(steps,) first slot of every step."""
        return np.cumsum(self.width) - self.width

    def tree(self, paths: int) -> Tree:
        """A first slot common to all, then `paths` chains, equally likely."""
        later = self.n - 1
        parent = np.concatenate([[-1], *(self._parents(p) for p in range(paths))])
        chance = np.append(1.0, np.full(paths * later, 1.0 / paths))
        stage = np.append(0, np.tile(self.kind[1:], paths))
        names = [f"path {p + 1} step {k}" for p in range(paths) for k in range(1, self.n)]
        return Tree(parent.astype(np.intp), chance, stage.astype(np.intp), ("now", *names))

    def _parents(self, path: int) -> Ints:
        """Parents of the nodes of a path: each the node before, the first one the common slot."""
        first = 1 + path * (self.n - 1)
        parents = np.arange(first - 1, first + self.n - 2)
        parents[:1] = 0  # nothing where a path has no node of its own
        return parents


@dataclass(frozen=True)
class WindowRequest:
    """What a program is asked at slot `t`.

    Attributes:
        t: slot of the horizon.
        energy: (units,) stored energy, MWh.
        up: (elements of the case, steps, paths) status; the first step is the same in all paths.
        probability: (paths,) of every path.
        forecast: of profiles, by name and slots.
        value: (units,) $ per MWh left at the end of the steps.
        reserve: level in MWh and price in $/MWh, (buses with storage, steps) each, where there is
            one.
        devices: what else devices carry, (devices,) by name; see `Observation.states`.
        before: (lines of the case,) line status one slot before `t`; None: as in `t`.
        off: what may be added to the forecast of a profile by name, (slots of the steps, paths),
            nothing in the first slot; None: the forecast is exact.
        fuel: m³ in every tank, and $ per m³, beyond its price, of what is left at the end of the
            steps, (tanks,) each; None without tanks.
    """

    t: int
    energy: Floats
    up: Bools
    probability: Floats
    forecast: Forecast
    value: Floats
    reserve: tuple[Floats, Floats] | None = None
    fuel: tuple[Floats, Floats] | None = None
    devices: Mapping[str, Floats] = field(default_factory=dict)
    before: Bools | None = None
    off: Mapping[str | None, Floats] | None = None

    @property
    def states(self) -> dict[str, Floats]:
        """All that is at the start, by the names of the states."""
        fuel = {} if self.fuel is None else {"tank.level": self.fuel[0]}
        return {"ess.energy": self.energy, **fuel, **self.devices}

    @property
    def end_values(self) -> Floats:
        """(units and tanks,) $ per MWh and per m³ at the end of the steps."""
        return self.value if self.fuel is None else np.concatenate([self.value, self.fuel[1]])


def fuel_of(observation: Observation, k: int, value: Floats) -> tuple[Floats, Floats] | None:
    """Fuel of scenario k with its value (tanks,) at the end, as a request has them."""
    return None if observation.fuel is None else (observation.fuel[:, k], value)


def devices_of(observation: Observation, k: int) -> dict[str, Floats]:
    """What devices of scenario k carry, as a request has it."""
    return {name: values[:, k] for name, values in observation.states.items()}


def before_of(observation: Observation, k: int) -> Bools | None:
    """(lines,) status of the slot before in scenario k, as a request has it."""
    before = observation.line_up_before
    return None if before is None else before[:, k]


def joined_action(decisions: Sequence[Decision]) -> Action:
    """What a dispatcher answers for a batch, from the decisions (rows,) of every scenario."""
    decision = part_by_part(lambda columns: np.stack(columns, axis=1), decisions)
    power, burner_mw, *commitment = decision
    if any(values is not None for values in commitment):
        return decision
    return power if burner_mw is None else Rationed(power, burner_mw)


def check_stored(case: Case) -> None:
    """Checks that there is something to decide ahead of time.

    Raises:
        UsageError: the case has neither storage nor a tank.
    """
    if not case.ess and not case.tank:
        raise UsageError(
            f"case {case.name!r} has no storage; allowed: a case with [[ess]] or [[tank]]",
            hint="without stored energy there is nothing to look ahead for; `solve` plans it",
        )


class WindowProgram:
    """The program of a window: `paths` chains behind a common first slot.

    Args:
        merged: the microgrid, its like devices joined.
        steps: of every path.
        paths: how many.
        reserve: rows of a reserve, if any.
        risk: what counts besides the mean over the paths.

    Attributes:
        standard: the program in standard form.
        solver: holds it, and its basis between solves.
        step_of: (nodes,) step of every node of the tree.
        path_of: (nodes,) path of every node; 0 for the common slot.
        final_price_per_mwh: of what storage lacks of `soc_final_min` at the end of the horizon,
            that of the dearest load: no outage leaves the program without a solution.
    """

    def __init__(
        self,
        merged: MergedGrid,
        steps: WindowSteps,
        paths: int,
        reserve: Reserve | None = None,
        risk: Risk = RISK_NEUTRAL,
    ) -> None:
        self.merged, self.steps, self.paths = merged, steps, paths
        check_stored(merged.microgrid.case)
        loads = merged.microgrid.case.tables_of(LoadTable)
        self.final_price_per_mwh = max((load.shed_price_per_mwh for load in loads), default=0.0)
        dt = merged.microgrid.case.step_h
        stages = [merged.microgrid.stage(dt * width, may_spill=True) for width in steps.widths]
        if reserve is not None:
            for stage in stages:
                reserve.emit(stage)
        self.standard = standard = unroll(stages, steps.tree(paths))
        lowered = lower(standard, integer="none", modes={})
        averse = risk.averse and paths > 1
        make = partial(RiskAverse, risk=risk) if averse else Highs
        self.solver: Highs = make(lowered, duals=False, threads=1)
        later = np.arange(1, steps.n)
        self.step_of = np.append(0, np.tile(later, paths))
        self.path_of = np.append(0, np.repeat(np.arange(paths), len(later)))
        ends = standard.tree.leaves
        state_names = [name for name in ("ess.energy", "tank.level") if standard.has(name)]
        self._end = np.concatenate([standard.columns(name)[:, ends] for name in state_names])
        self._decided = DecisionColumns.of_program(standard, merged)
        now = standard.copies[0].columns[0]
        integers = now[standard.integer[now]]
        # Later steps stay relaxed: what a start is worth is all that they have to tell.
        self.search = Branching(self.solver, integers, gap=GAP, gap_abs=GAP)
        self._with_before = any(b.name == BOUND for b in stages[0].datums)
        self._latest: tuple[WindowRequest, dict[str, Floats], Floats] | None = None
        self._column_path = self._paths_of_columns()
        self._served_sooner = np.ones(standard.n_columns)
        if standard.has("load.shed"):
            later_slots = steps.starts[self.step_of]
            self._served_sooner[standard.columns("load.shed")] -= LATER * later_slots
        self._powers = {b.name for s in stages for b in s.datums if b.unit in POWER_UNITS}

    def _paths_of_columns(self) -> Ints:
        """(columns,) path of every column, -1 for what is common to all."""
        path = np.full(self.standard.n_columns, -1)
        for stage in self.standard.copies:
            path_of_node = np.where(stage.nodes > 0, self.path_of[stage.nodes], -1)
            path[stage.own_columns] = path_of_node[:, None]
        return path

    def data(self, request: WindowRequest) -> dict[str, Floats]:
        """The data of every node for a request, arrays (labels, nodes)."""
        steps, merged = self.steps, self.merged
        last = merged.microgrid.case.slots - 1
        slots = np.minimum(request.t + np.arange(steps.horizon), last)
        followed = [n for n in profiles_of(merged.microgrid) if n not in merged.mixed]
        members = [name for names, _ in merged.mixed.values() for name in names]
        at_node = {
            name: self._at_nodes(request, name, slots)
            for name in dict.fromkeys([*followed, *members])
        }
        profile = merged.profile(lambda name: at_node[name])
        up = request.up[:, self.step_of, self.path_of]
        is_last = (steps.starts <= last - request.t) & (
            last - request.t < steps.starts + steps.width
        )
        before = self._before(request, up) if self._with_before else None
        situation = merged.microgrid.situation(
            up, profile, before=before, is_last=is_last[self.step_of]
        )
        situation = replace(situation, final_price_per_mwh=self.final_price_per_mwh)
        data = merged.microgrid.data(situation)
        # Of a step that passes the end of the horizon only the part before it counts.
        inside = np.clip(last + 1 - request.t - steps.starts, 0, steps.width) / steps.width
        if inside[-1] < 1.0:
            share = inside[self.step_of]
            data = {k: v * share if k in self._powers else v for k, v in data.items()}
            if BOUND in data:
                # A unit that has to stay on, or may fall only slowly, ends with the horizon.
                data[BOUND] = data[BOUND] * (share >= 1.0)
        if request.reserve is not None:
            level, price = request.reserve
            data["reserve.level"] = level[:, self.step_of]
            data["reserve.price"] = price[:, self.step_of]
        return data

    def _before(self, request: WindowRequest, up: Bools) -> Bools:
        """(lines of the case, nodes) status a slot before every node, whose status is `up`."""
        before = line_up_before(up, self.standard.tree)
        before[:, 0] = up[:, 0] if request.before is None else request.before
        return before

    def _at_nodes(self, request: WindowRequest, name: str | None, slots: Ints) -> Floats:
        """(nodes,) mean of a profile over the step of every node, on its path."""
        steps, values = self.steps, request.forecast(name, slots)
        off = None if request.off is None else request.off.get(name)
        if off is None:
            return (np.add.reduceat(values, steps.starts) / steps.width)[self.step_of]
        sampled = np.maximum(values[:, None] + off, 0.0)
        means = np.add.reduceat(sampled, steps.starts, axis=0) / steps.width[:, None]
        return means[self.step_of, self.path_of]

    def vectors(self, request: WindowRequest, data: dict[str, Floats] | None = None) -> Vectors:
        """All numbers of the program for a request; `data` if its data are there already."""
        data = self.data(request) if data is None else data
        vectors = self.standard.vectors(data, request.states)
        shared = self._column_path < 0
        # The tree was built with equally likely paths.
        weight = np.where(shared, 1.0, self.paths * request.probability[self._column_path])
        vectors.cost *= weight * self._served_sooner
        vectors.cost[self._end] -= request.probability * request.end_values[:, None]
        return vectors

    def _worth(self, values: Floats) -> sp.csr_array:
        """(paths, columns) $ per MWh and m³ left at the end of every path, as a cost."""
        states, paths = self._end.shape
        places = (np.tile(np.arange(paths), states), self._end.ravel())
        shape = (paths, self.standard.n_columns)
        return sp.csr_array((np.repeat(-values, paths), places), shape=shape)

    def decide(self, request: WindowRequest) -> Floats:
        """(units,) charging power in the first slot, MW; negative is discharging."""
        return self.decisions(request).power

    def decisions(self, request: WindowRequest) -> Decision:
        """All that is decided in the first slot, (rows,) each."""
        data = self.data(request)
        if isinstance(self.solver, RiskAverse):
            self.solver.weigh(request.probability)
            self.solver.price(data, self._worth(request.end_values))
        z = self.search.solve(self.vectors(request, data)).point
        self._latest = request, data, z
        return self._decided.decision(z, 0)

    def latest_plan(self) -> WindowPlan | None:
        """The plan behind the first slot that was decided last; None before."""
        if self._latest is None:
            return None
        request, data, z = self._latest
        spans = request.t + self.steps.starts, self.steps.width
        grid = self.merged.microgrid
        return window_plan(self.standard, grid, spans, request.probability, data, z)
