"""Random worlds for the simulator, and what must hold of every step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.models.microgrid import Microgrid
from resilience.models.simulator import Step
from resilience.models.simulator.plant import Plant


@dataclass(frozen=True)
class Scene:
    """One slot for a batch of members, each with its own outages."""

    energy: Floats
    action: Floats
    data: Floats
    island: Ints
    named: dict[str, Floats]

    def of(self, *members: int) -> tuple[Floats, Floats, Floats, Ints]:
        """The arguments of a step for some members."""
        at = list(members)
        return self.energy[:, at], self.action[:, at], self.data[:, at], self.island[:, at]

    @property
    def all(self) -> tuple[Floats, Floats, Floats, Ints]:
        """The arguments of a step."""
        return self.energy, self.action, self.data, self.island


def scene(plant: Plant, batch: int, rng: np.random.Generator, reach: float = 1.2) -> Scene:
    """Profiles of one random slot; breakpoints down half of the time; orders beyond the limits."""
    microgrid: Microgrid = plant.microgrid
    case = microgrid.case
    fallible = np.array([name for name, b in zip(
        case.network.line_names, case.network.breakpoint, strict=True) if b])  # fmt: skip
    up = np.ones((len(case.network.line_names), batch), bool)
    for name in fallible:
        up[case.network.line(name)] = rng.random(batch) < 0.5
    slot = int(rng.integers(case.slots))

    def profile(name: str | None) -> Floats:
        return np.full(batch, case.profile(name)[slot])

    situation = microgrid.situation(up, profile)
    named = microgrid.data(situation)
    size = np.array([max(u.p_max_mw, -u.p_min_mw) for u in case.ess])[:, None] * reach
    shape = (len(plant.units), batch)
    energy = rng.uniform(plant.low, plant.high, shape)
    action = rng.uniform(-size, size, shape) if len(size) else np.empty(shape)
    return Scene(energy, action, plant.stacked(named), situation.island, named)


def assert_sound(plant: Any, seen: Scene, step: Step, tolerance: float = 1e-9) -> None:
    """No bound is violated, storage is in one mode, every island's power adds up."""
    band = 1e-12 * (1.0 + np.abs(plant.high))
    assert (step.energy >= plant.low - band).all()
    assert (step.energy <= plant.high + band).all()
    low, high = plant.limits(seen.energy, seen.data)
    net = step.charge - step.discharge
    assert (net >= low - 1e-12).all()
    assert (net <= high + 1e-12).all()
    assert np.minimum(step.charge, step.discharge).max(initial=0.0) == 0.0
    change = plant.gain * step.charge - plant.drain * step.discharge
    np.testing.assert_allclose(step.energy, seen.energy + change, atol=1e-12)
    at = plant.sources - plant.form.n_now
    lower, upper, _, _ = plant.form.numbers(seen.data)
    assert (step.flows >= lower[at] - 1e-9).all()
    assert (step.flows <= upper[at] + 1e-9).all()
    assert (step.spill >= 0.0).all()
    np.testing.assert_allclose(imbalance(plant, seen, step), 0.0, atol=tolerance)


def imbalance(plant: Any, seen: Scene, step: Step) -> Floats:
    """(buses, batch) MW fed less taken, in the row of the island's number."""
    _, _, sides, _ = plant.form.numbers(seen.data)
    fed = -sides[plant.balance_rows]
    np.add.at(fed, plant.bus, plant.sign * step.flows)
    np.add.at(fed, plant.storage_bus, step.discharge - step.charge)
    total = -np.broadcast_to(step.spill, fed.shape).copy()
    members = np.arange(fed.shape[1])
    for bus in range(plant.n_buses):
        total[seen.island[bus], members] += fed[bus]
    return total
