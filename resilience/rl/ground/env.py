"""The training ground: a batch of episodes in torch, in lockstep, differentiable.

An episode ends with its last slot, where it is cut short and not over: the energy left has its
terminal value, and whoever bootstraps does so with that.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Literal, cast, get_args

import numpy as np
import torch

from resilience.dispatch.anchors import Anchors
from resilience.errors import UsageError
from resilience.models.components import in_roles
from resilience.models.simulator import Simulator
from resilience.models.simulator.arrays import Array, array_ops
from resilience.models.simulator.simulator import Step
from resilience.rl.ground.bands import Band, band
from resilience.rl.ground.episodes import Episodes, EpisodeSampler
from resilience.rl.ground.observers import observer
from resilience.rl.ground.tape import Now, Tape, as_tensors, step_of_tensors
from resilience.simulation.slots import Slot

Baseline = Literal["none", "idle", "rule"]
BASELINES: tuple[Baseline, ...] = get_args(Baseline)


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
                "learners train at copperplate without line ratings, commitment, ramps, curves and "
                f"switchable lines; case {setting.case.name!r} at {setting.microgrid.physics} is "
                f"stepped by {type(setting.simulator).__name__}",
                hint="`rule`, `mpc` and `stochastic` act in such a case",
            )
        if setting.simulator.tanks:
            names = ", ".join(setting.simulator.tanks)
            raise UsageError(
                f"learners know no fuel, but there are the tanks {names}",
                hint="`rule`, `mpc` and `stochastic` act in such a case",
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
        self._number = torch.empty(0, dtype=dtype).numpy().dtype
        self._anchors = Anchors(self.simulator)
        self._low = self.tensor(self.simulator.low)
        self._range = self.tensor(np.maximum(self.simulator.high - self.simulator.low, 1e-9))

    def tensor(self, values: np.ndarray) -> torch.Tensor:
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
        shape = (episodes.slots, self.size - self.units, episodes.n)
        plain, observed = [], np.empty(shape, np.float32)
        for t in range(episodes.slots):
            plain.append(self._plain(episodes.slot(t)))
            eyes.world(episodes.observation(t, full), out=observed[t])
        return Tape(episodes, self.tensor(observed).transpose(1, 2), plain, self._to_device)

    def now(self, tape: Tape, t: int, energy: torch.Tensor) -> Now:
        """Slot t with this much stored, (units, batch) MWh: empty storage forms no island."""
        changed = self._without_empty(tape, t, energy)
        return tape.now(t) if changed is None else as_tensors(changed, self._to_device)

    def _without_empty(self, tape: Tape, t: int, energy: torch.Tensor) -> Now | None:
        """Slot t where empty storage changes it, in NumPy."""
        episodes = tape.episodes
        if not episodes.has_energy_islands:
            return None
        stored = energy.detach().cpu().numpy().astype(float)
        usual, slot = episodes.slot(t), episodes.slot(t, stored)
        return None if slot is usual else self._plain(slot)

    def _plain(self, slot: Slot) -> Now:
        data, island = slot.stacked.astype(self._number), np.ascontiguousarray(slot.island)
        ready = self.simulator.ready(data, island)
        return Now(data, island, ready, self.band.slot(data, island, ready.storage))

    def _to_device(self, array: np.ndarray) -> torch.Tensor:
        """An array as it is, on the device."""
        tensor = torch.from_numpy(array)
        return tensor if self.device.type == "cpu" else tensor.to(self.device)

    def observe(self, tape: Tape, t: int, energy: torch.Tensor) -> torch.Tensor:
        """(batch, numbers) what is observed in slot t with this much stored, (units, batch) MWh."""
        return self.with_storage(energy, tape.observed[t])

    def with_storage(self, energy: torch.Tensor, world: torch.Tensor) -> torch.Tensor:
        """(batch, numbers) observations from what is stored and what is observed of the world."""
        return torch.cat([(energy - self._low) / self._range, world.T]).T

    def power(self, tape: Tape, t: int, energy: torch.Tensor, output: torch.Tensor) -> torch.Tensor:
        """(units, batch) MW that outputs (batch, units) in [-1, 1] ask for."""
        band_slot = self.now(tape, t, energy).band
        return cast("torch.Tensor", self.band.power(output.T, energy, band_slot))

    def step(self, tape: Tape, t: int, energy: torch.Tensor, output: torch.Tensor) -> Step:
        """Slot t played with outputs (batch, units) in [-1, 1]."""
        return self._step(
            tape,
            t,
            energy,
            lambda now, stored: self.band.power(_alike(output, stored).T, stored, now.band),
        )

    def played(self, tape: Tape, t: int, energy: torch.Tensor, power: torch.Tensor) -> Step:
        """Slot t played with what is asked for, (units, batch) MW."""
        return self._step(tape, t, energy, lambda _, stored: _alike(power, stored))

    def _step(
        self, tape: Tape, t: int, energy: torch.Tensor, ask: Callable[[Now, Array], Array]
    ) -> Step:
        """Slot t played with what is asked for, from the slot and what is stored: in NumPy where
        nobody wants a gradient.
        """
        if self.device.type != "cpu" or torch.is_grad_enabled():
            now = self.now(tape, t, energy)
            return self.simulator.step_ready(energy, ask(now, energy), now.ready)
        now = self._without_empty(tape, t, energy) or tape.plain[t]
        stored = energy.detach().numpy()
        step = self.simulator.step_ready(stored, ask(now, stored), now.ready)
        return step_of_tensors(step, self._to_device)

    def _baseline_power(self, now: Now, energy: Array) -> Array:
        """(units, batch) MW that the baseline asks for."""
        if self.baseline == "idle":
            return energy * 0.0
        needs = now.band.needs or self._anchors.needs(now.data, now.island, now.band.storage)
        return self._anchors.actions(energy, now.band.storage, needs).rule

    def _wear(self, tape: Tape, t: int, step: Step) -> torch.Tensor:
        """(units, batch) $ of wear of each unit."""
        data = tape.plain[t].data
        ops = array_ops(data)
        charging, discharging = (price(ops, data) for price in self.simulator.storage_price)
        paid = self._to_device(charging) * step.charge
        return paid + self._to_device(discharging) * step.discharge

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
                step = self._step(tape, t, energy, self._baseline_power)
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


def _alike(x: torch.Tensor, array: Array) -> Array:
    """A tensor as it is, or in NumPy where `array` is."""
    return x.detach().numpy() if isinstance(array, np.ndarray) else x
