"""Episodes in lockstep, in NumPy: what all adapters are made of, so that they agree.

It sees, acts and is rewarded as `BatchEnv` does, and needs no torch.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from resilience.arrays import Floats
from resilience.case import Case
from resilience.dispatch.anchors import Anchors
from resilience.errors import UsageError
from resilience.evaluation.compare import parse_error
from resilience.models.simulator import Simulator
from resilience.models.simulator.arrays import array_ops
from resilience.models.simulator.simulator import Step
from resilience.rl.ground.bands import band, clipped
from resilience.rl.ground.episodes import Episodes, EpisodeSampler
from resilience.rl.ground.observe import Observer

BASELINES = ("none", "idle", "rule")
KNOWN: Mapping[str, tuple[float, float]] = {
    "soc_of_band": (0.0, 1.0),
    "line_up": (0.0, 1.0),
    "line_down_h": (0.0, np.inf),
    "line_failed_before": (0.0, 1.0),
    "clock": (-1.0, 1.0),
}
"""Bounds of blocks of an observation, by name, where they are known."""
ROUNDING = 1e-6  # by which a number may be beyond its bounds


class Played(NamedTuple):
    """What a slot brought.

    Attributes:
        numbers: (batch, numbers) float32, what is observed then.
        reward: (batch,) $.
        is_over: whether it was the last slot of the episodes.
        info: arrays with a leading batch axis, by name.
    """

    numbers: np.ndarray
    reward: Floats
    is_over: bool
    info: dict[str, np.ndarray]


class Play:
    """A batch of episodes that end together.

    Args:
        case: the case; it is played on its training days.
        n: episodes at once.
        band_name: how actions become MW, anchors or affine.
        baseline: whose cost rewards are relative to: none, idle or rule.
        days: of an episode.
        forecast_error: as in `compare`.
        known_centre: likewise.
        random_start: episodes begin with a random state of charge, not with the case's.

    Raises:
        UsageError: a case without storage or breakpoints, one that a step cannot hold, or an
            unknown band or baseline.
    """

    def __init__(
        self,
        case: Case,
        n: int = 1,
        *,
        band_name: str = "anchors",
        baseline: str = "none",
        days: int = 1,
        forecast_error: str = "none",
        known_centre: bool = True,
        random_start: bool = False,
    ) -> None:
        if baseline not in BASELINES:
            raise UsageError(
                f"baseline {baseline!r} is unknown; allowed: {', '.join(BASELINES)}",
                hint="none is the default of environments",
            )
        self.sampler = EpisodeSampler(
            case, days=days, forecast_error=parse_error(forecast_error), known_centre=known_centre
        )
        self.setting, self.n, self.baseline = self.sampler.setting, n, baseline
        simulator = self.setting.simulator
        if not isinstance(simulator, Simulator):
            raise UsageError(
                f"environments step copperplate, not {self.setting.microgrid.physics}",
                hint="AC power flow certifies what was done afterwards",
            )
        self.simulator, self.random_start = simulator, random_start
        if not self.units:
            raise UsageError(
                f"case {case.name!r} has no storage to decide on; allowed: one unit or more",
                hint="[[ess]] adds one",
            )
        self.band = band(band_name, simulator)
        self._anchors = Anchors(simulator)
        self.bounds = _bounds(Observer(self.setting))
        self.t = self.slots

    @property
    def units(self) -> tuple[str, ...]:
        """Names of the storage units."""
        return self.simulator.units

    def facts(self) -> dict[str, Any]:
        """What is observed and done here, as plain data."""
        blocks = Observer(self.setting).blocks
        return {
            "case": self.setting.case.name,
            "slots": self.slots,
            "step_min": self.setting.case.step_min,
            "days_to_begin_on": len(self.sampler.starts),
            "observation": {block.name: len(block.labels) for block in blocks},
            "numbers": sum(len(block.labels) for block in blocks),
            "agents": list(self.units),
        }

    @property
    def slots(self) -> int:
        """Slots of an episode."""
        return self.setting.case.slots

    def reset(self, rng: np.random.Generator) -> np.ndarray:
        """New episodes, drawn by a generator; (batch, numbers) float32, what is observed first."""
        number = int(rng.integers(2**31))
        self.episodes: Episodes = self.sampler.draw(self.n, number)
        self.observer = Observer(self.episodes.setting)
        self.t, self.energy = 0, np.repeat(self.setting.start()[:, :1], self.n, axis=1)
        if self.random_start:
            low, high = self.simulator.low, self.simulator.high
            self.energy = low + (high - low) * rng.random(self.energy.shape)
        self._baseline_cost = self._rolled_out()
        self._look()
        return self._seen()

    def step(self, actions: np.ndarray) -> Played:
        """One slot.

        Args:
            actions: (batch, units) in [-1, 1].

        Raises:
            UsageError: the episodes are over, or actions of another shape, or that are no numbers.
        """
        shape = (self.n, len(self.units))
        if self.t >= self.slots:
            raise UsageError("the episode is over; allowed: a step within it", hint="call reset")
        actions = np.asarray(actions, float)
        if actions.shape != shape or not np.isfinite(actions).all():
            raise UsageError(
                f"actions of shape {actions.shape}, or not finite; allowed: numbers of {shape}",
                hint="a number in [-1, 1] for every storage unit",
            )
        t, output = self.t, clipped(actions.T)
        slot = self.band.slot(self._data, self._island)
        request = self.band.power(output, self.energy, slot)
        step = self._step(t, self.energy, request)
        cost = self._cost(t, step)
        info = self._info(step, request, cost)
        self.energy, self.t = step.energy, t + 1
        is_over = self.t == self.slots
        if not is_over:
            self._look()
        return Played(self._seen(), self._baseline_cost[t] - cost, is_over, info)

    def _look(self) -> None:
        """Takes notice of the slot; what is observed after the last one is the world as it was."""
        observation = self.episodes.observation(self.t, self.energy)
        self._data, self._island = observation.data, observation.island
        self._up = observation.line_up
        self._world = self.observer.world(observation)

    def _seen(self) -> np.ndarray:
        storage = self.observer.storage(self.energy)
        return np.concatenate([storage, self._world]).T.astype(np.float32)

    def _step(self, t: int, energy: Floats, power: Floats) -> Step:
        slot = self.episodes.slot(t)
        return self.simulator.step(energy, power, slot.stacked, slot.island)

    def _cost(self, t: int, step: Step) -> Floats:
        """(batch,) $ of slot t, in the last one less what the energy left is worth."""
        credit = self.setting.end_value_per_mwh * step.energy.sum(0)
        return step.cost - credit if t == self.slots - 1 else step.cost

    def _rolled_out(self) -> Floats:
        """(slots, batch) $ that the slots of the baseline cost."""
        costs, energy = np.zeros((self.slots, self.n)), self.energy
        for t in range(self.slots if self.baseline != "none" else 0):
            slot, power = self.episodes.slot(t), np.zeros_like(energy)
            if self.baseline == "rule":
                storage = self.simulator.storage_slot(slot.stacked, slot.island)
                needs = self._anchors.needs(slot.stacked, slot.island, storage)
                power = self._anchors.actions(energy, storage, needs).rule
            step = self._step(t, energy, power)
            costs[t], energy = self._cost(t, step), step.energy
        return costs

    def _info(self, step: Step, request: Floats, cost: Floats) -> dict[str, np.ndarray]:
        """What happened, arrays (batch, ...) by name."""
        simulator, ops = self.simulator, array_ops(step.energy)
        prices = simulator.price(ops, self._data)
        spent = prices * step.flows
        wear = sum(
            (price(ops, self._data) * mw).sum(0)
            for price, mw in zip(
                simulator.storage_price, (step.charge, step.discharge), strict=True
            )
        )
        terms = {
            f"cost_{kind}_usd": spent[simulator.kinds == kind].sum(0)
            for kind in dict.fromkeys(simulator.kinds.tolist())
        }
        shed = step.flows[simulator.kinds == "load.shed"].sum(0) * simulator.dt
        islands = [len(np.unique(column)) for column in self._island.T]
        return {
            **terms,
            "cost_wear_usd": np.broadcast_to(wear, self.n).astype(float),
            "cost_usd": step.cost,
            "credit_usd": step.cost - cost,
            "shed_mwh": shed,
            "islands": np.array(islands),
            "lines_down": (~self._up).sum(0),
            "asked_mw": request.T,
            "done_mw": (step.charge - step.discharge).T,
        }


def _bounds(observer: Observer) -> tuple[np.ndarray, np.ndarray]:
    """(numbers,) lowest and highest value of every number of an observation, float32."""
    low, high = [], []
    for block in observer.blocks:
        bounds = KNOWN.get(block.name, (-np.inf, np.inf))
        low += [bounds[0] - ROUNDING] * len(block.labels)
        high += [bounds[1] + ROUNDING] * len(block.labels)
    return np.array(low, np.float32), np.array(high, np.float32)
