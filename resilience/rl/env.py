"""The training ground: a batch of episodes in torch, in lockstep, differentiable.

An episode ends with its last slot, where it is cut short and not over: the energy left has its
terminal value, and whoever bootstraps does so with that.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple, cast, get_args

import numpy as np
import torch

from resilience.arrays import Floats
from resilience.dispatch.anchors import Anchors, Needs
from resilience.errors import UsageError
from resilience.models.components import in_roles
from resilience.models.simulator import Simulator
from resilience.models.simulator.arrays import array_ops
from resilience.models.simulator.prices import PricedBatch
from resilience.models.simulator.simulator import Step
from resilience.rl.bands import AnchorBand, Band, band
from resilience.rl.episodes import Episodes, EpisodeSampler
from resilience.rl.observers import observer
from resilience.simulation.slots import Slot

Baseline = Literal["none", "idle", "rule"]
BASELINES: tuple[Baseline, ...] = get_args(Baseline)


class Now(NamedTuple):
    """A slot of a batch, on the device.

    Attributes:
        data: (n_data, batch) from `Simulator.stacked`.
        island: (buses, batch) number of the island of every bus.
        needs: what islands lack and have; None where the band does not ask.
        priced: in which order sources are taken.
    """

    data: torch.Tensor
    island: torch.Tensor
    needs: Needs | None
    priced: PricedBatch


@dataclass(frozen=True)
class Tape:
    """Everything of a batch that does not depend on what is done, on the device.

    Attributes:
        episodes: where it comes from.
        data: (slots, n_data, batch) from `Simulator.stacked`, while all storage has energy to give.
        island: (slots, buses, batch).
        observed: (slots, batch, numbers) the observations without storage.
        needs: what islands lack and have, slot by slot; empty where the band does not ask.
        priced: in which order sources are taken, slot by slot.
    """

    episodes: Episodes
    data: torch.Tensor
    island: torch.Tensor
    observed: torch.Tensor
    needs: list[Needs | None]
    priced: list[PricedBatch]

    @property
    def slots(self) -> int:
        """Slots of an episode."""
        return len(self.data)

    @property
    def n(self) -> int:
        """Episodes in the batch."""
        return self.episodes.n

    def now(self, t: int) -> Now:
        """Slot t while all storage has energy to give."""
        return Now(self.data[t], self.island[t], self.needs[t], self.priced[t])


class BatchEnv:
    """Episodes that are played slot by slot.

    Args:
        sampler: draws the episodes.
        band_name: how outputs become MW.
        baseline: whose cost is subtracted from that of a slot before it is a reward, so that
            rewards tell what was decided from what the day costs anyway.
        device: where tensors live.
        dtype: their number type.
        observer_name: what is observed, see `observers.OBSERVERS`.

    Raises:
        UsageError: a microgrid whose step has no gradient.
    """

    def __init__(
        self,
        sampler: EpisodeSampler,
        band_name: str = "anchors",
        baseline: str = "rule",
        device: str = "cpu",
        dtype: torch.dtype = torch.float32,
        observer_name: str = "full",
    ) -> None:
        setting = sampler.setting
        if not isinstance(setting.simulator, Simulator):
            raise UsageError(
                "learners train at copperplate without line ratings, not "
                f"{setting.microgrid.physics}",
                hint="AC power flow certifies what they do afterwards",
            )
        if baseline not in BASELINES:
            raise UsageError(
                f"baseline {baseline!r} is unknown; allowed: {', '.join(BASELINES)}",
                hint="rule is the default",
            )
        self.sampler = sampler
        self.setting, self.simulator = setting, setting.simulator
        self.band_name, self.baseline, self.observer_name = band_name, baseline, observer_name
        self.band: Band = band(band_name, self.simulator)
        self.device, self.dtype = torch.device(device), dtype
        self._anchors = Anchors(self.simulator)
        self._low = self.tensor(self.simulator.low)
        self._range = self.tensor(np.maximum(self.simulator.high - self.simulator.low, 1e-9))

    def tensor(self, values: Floats) -> torch.Tensor:
        """Values on the device, of the number type."""
        return torch.as_tensor(values, dtype=self.dtype, device=self.device)

    @cached_property
    def size(self) -> int:
        """Numbers of an observation, storage included."""
        return observer(self.observer_name, self.setting).size

    @property
    def units(self) -> int:
        """Storage units, each with one output."""
        return len(self.simulator.units)

    def draw(self, n: int, number: int) -> Tape:
        """Batch `number` of n episodes; it depends on nothing but the sampler and these."""
        return self.tape(self.sampler.draw(n, number))

    def tape(self, episodes: Episodes) -> Tape:
        """A batch, ready to be played as often as one likes."""
        eyes = observer(self.observer_name, episodes.setting)
        full = np.repeat(self.simulator.high, episodes.n, axis=1)
        shape = (episodes.slots, episodes.n, self.size - self.units)
        now, observed = [], torch.empty(shape, dtype=self.dtype, device=self.device)
        for t in range(episodes.slots):
            now.append(self._on_device(episodes.slot(t)))
            observed[t] = self.tensor(eyes.world(episodes.observation(t, full))).T
        data, island, needs, priced = zip(*now, strict=True)
        return Tape(
            episodes,
            torch.stack(data),
            torch.stack(island),
            observed,
            list(needs),
            list(priced),
        )

    def now(self, tape: Tape, t: int, energy: torch.Tensor) -> Now:
        """Slot t with this much stored, (units, batch) MWh: empty storage forms no island."""
        episodes = tape.episodes
        if not episodes.has_energy_islands:
            return tape.now(t)
        stored = energy.detach().cpu().numpy().astype(float)
        usual, slot = episodes.slot(t), episodes.slot(t, stored)
        return tape.now(t) if slot is usual else self._on_device(slot)

    def _on_device(self, slot: Slot) -> Now:
        data = self.tensor(np.require(slot.stacked, requirements="W"))
        island = torch.as_tensor(np.require(slot.island, requirements="W"), device=self.device)
        needs = None
        if isinstance(self.band, AnchorBand):
            needs = self.band.anchors.needs(data, island)
        return Now(data, island, needs, self.simulator.priced(data))

    def observe(self, tape: Tape, t: int, energy: torch.Tensor) -> torch.Tensor:
        """(batch, numbers) what is observed in slot t with this much stored, (units, batch) MWh."""
        return self.with_storage(energy, tape.observed[t])

    def with_storage(self, energy: torch.Tensor, world: torch.Tensor) -> torch.Tensor:
        """(batch, numbers) observations from what is stored and what is observed of the world."""
        return torch.cat([((energy - self._low) / self._range).T, world], 1)

    def power(self, tape: Tape, t: int, energy: torch.Tensor, output: torch.Tensor) -> torch.Tensor:
        """(units, batch) MW that outputs (batch, units) in [-1, 1] ask for."""
        return self._power(self.now(tape, t, energy), energy, output)

    def step(self, tape: Tape, t: int, energy: torch.Tensor, output: torch.Tensor) -> Step:
        """Slot t played with outputs (batch, units) in [-1, 1]."""
        now = self.now(tape, t, energy)
        return self._step(now, energy, self._power(now, energy, output))

    def _power(self, now: Now, energy: torch.Tensor, output: torch.Tensor) -> torch.Tensor:
        return cast(
            "torch.Tensor", self.band.power(output.T, energy, now.data, now.island, now.needs)
        )

    def _step(self, now: Now, energy: torch.Tensor, power: torch.Tensor) -> Step:
        return self.simulator.step(energy, power, now.data, now.island, now.priced)

    def _baseline_power(self, now: Now, energy: torch.Tensor) -> torch.Tensor:
        """(units, batch) MW that the baseline asks for."""
        if self.baseline == "idle":
            return torch.zeros_like(energy)
        anchors = self._anchors.actions(energy, now.data, now.island, now.needs)
        return cast("torch.Tensor", anchors.rule)

    def _wear(self, tape: Tape, t: int, step: Step) -> torch.Tensor:
        """(units, batch) $ of wear of each unit."""
        ops, data = array_ops(step.energy), tape.data[t]
        charging, discharging = (price(ops, data) for price in self.simulator.storage_price)
        return cast("torch.Tensor", charging * step.charge + discharging * step.discharge)

    def credit(self, energy: torch.Tensor) -> torch.Tensor:
        """(batch,) $ that the energy left at the end of an episode is worth."""
        return self.setting.end_value_per_mwh * energy.sum(0)

    def is_last(self, tape: Tape, t: int) -> bool:
        """Whether the episode is truncated after slot t; it never terminates."""
        return t == tape.slots - 1

    def cost(self, tape: Tape, t: int, step: Step) -> torch.Tensor:
        """(batch,) $ of slot t, in the last one less what the energy left is worth."""
        cost: torch.Tensor = step.cost
        return cost - self.credit(step.energy) if self.is_last(tape, t) else cost

    def baseline_cost(self, tape: Tape, start: torch.Tensor) -> torch.Tensor:
        """(slots, batch) $ that the baseline's slots cost, from the same start, (units, batch) MWh.

        No action has a part in it, so it is worked out once per tape and start.
        """
        if self.baseline == "none":
            return torch.zeros((tape.slots, tape.n), dtype=self.dtype, device=self.device)
        energy, costs = start, []
        with torch.no_grad():
            for t in range(tape.slots):
                now = self.now(tape, t, energy)
                step = self._step(now, energy, self._baseline_power(now, energy))
                costs.append(self.cost(tape, t, step))
                energy = step.energy
        return torch.stack(costs)

    def reward(self, tape: Tape, t: int, step: Step, baseline_cost: torch.Tensor) -> torch.Tensor:
        """(batch,) $ saved in slot t against the baseline, `baseline_cost` (slots, batch)."""
        return baseline_cost[t] - self.cost(tape, t, step)

    def agent_rewards(
        self, tape: Tape, t: int, step: Step, baseline_cost: torch.Tensor
    ) -> torch.Tensor:
        """(units, batch) $: the paper's rewards, in which an agent pays for the system and the wear
        of its own unit alone; likewise it has the worth of what its own unit is left with.
        """
        wear = self._wear(tape, t, step)
        cost = step.cost - wear.sum(0) + wear
        if self.is_last(tape, t):
            cost = cost - self.setting.end_value_per_mwh * step.energy
        return baseline_cost[t] - cost

    def largest_power(self) -> torch.Tensor:
        """(units, 1) MW, the most that a unit can charge or discharge."""
        storage = in_roles(self.setting.microgrid.fleets.values(), "storage")
        size = np.concatenate([np.empty(0), *(fleet.size_mw() for fleet in storage)])
        return self.tensor(size[:, None])

    def start(self, n: int) -> torch.Tensor:
        """(units, n) MWh, as the case starts."""
        start_mwh = self.tensor(self.setting.start()[:, :1])
        return start_mwh.repeat(1, n)
