"""The data of every slot in all scenarios, worked out for many slots at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.models.microgrid import Microgrid
from resilience.models.network.situation import Situation, reached
from resilience.models.simulator import MilpSimulator, NetworkSimulator, Simulator

Stepper = Simulator | NetworkSimulator | MilpSimulator

NODES = 4096  # slots times scenarios that are worked out together


@dataclass(frozen=True)
class Slot:
    """One slot in every scenario.

    Attributes:
        data: the data of every component by name, (labels, scenarios).
        stacked: the same as the simulator takes it, (n_data, scenarios).
        island: (buses of the merged graph, scenarios) number of each bus's island.
    """

    data: dict[str, Floats]
    stacked: Floats
    island: Ints


def stretch_data(
    microgrid: Microgrid,
    line_up: Bools,
    profile: Callable[[str | None, Ints], Floats],
    slots: Ints,
    energy: Floats | None = None,
    *,
    with_before: bool = False,
) -> tuple[dict[str, Floats], Situation]:
    """The data of some slots in all scenarios, (labels, slots * scenarios) by name, slot by slot.

    Args:
        microgrid: the microgrid.
        line_up: as in `Slots`.
        profile: likewise.
        slots: which.
        energy: (units, slots, scenarios) MWh stored at the start of each, where it is known: what
            only storage forms is dark then where that has nothing to give.
        with_before: whether the data depend on which lines were up the slot before.
    """
    lines, _, n = line_up.shape
    profiles: dict[str | None, Floats] = {}

    def flat(name: str | None) -> Floats:
        if name not in profiles:
            profiles[name] = profile(name, slots).ravel()
        return profiles[name]

    status = line_up[:, slots].reshape(lines, len(slots) * n)
    before = up_before(line_up, slots).reshape(status.shape) if with_before else None
    if energy is not None and microgrid.energised is not None:
        energy = energy.reshape(len(energy), len(slots) * n)
        situation = microgrid.situation(status, flat, before=before, energy=energy)
    else:
        situation = microgrid.situation(status, flat, before=before)
    return microgrid.data(situation), situation


def up_before(line_up: Bools, slots: Ints) -> Bools:
    """(lines, slots, scenarios) status one slot before each of `slots`; all up at the start.

    Args:
        line_up: (lines, slots of the horizon, scenarios) False where a line is down.
        slots: which.
    """
    return np.where(slots[None, :, None] > 0, line_up[:, slots - 1], True)


class Slots:
    """Slots of a world by their number; those of a stretch of time are kept until the next.

    A situation costs as much for one node as for thousands, so a stretch has as many slots as make
    `NODES` nodes with the scenarios.

    Args:
        microgrid: the microgrid.
        simulator: what steps it.
        line_up: (elements of the case, slots, scenarios) False where a line or unit is down.
        profile: (len(slots), scenarios) what a profile really is, by its name and slots.
        length: slots of a stretch; by the number of scenarios if omitted.
    """

    def __init__(
        self,
        microgrid: Microgrid,
        simulator: Stepper,
        line_up: Bools,
        profile: Callable[[str | None, Ints], Floats],
        length: int | None = None,
    ) -> None:
        self.microgrid, self.simulator = microgrid, simulator
        self.line_up, self.profile = line_up, profile
        self.with_before = simulator.needs_outage_begins
        self.length = length or max(NODES // max(line_up.shape[2], 1), 1)
        self.number, self.stretch = -1, list[Slot]()

    def __getitem__(self, t: int) -> Slot:
        number, place = divmod(t, self.length)
        if number != self.number:
            self.number, self.stretch = number, self._stretch(number * self.length)
        return self.stretch[place]

    def with_energy(self, t: int, energy: Floats) -> Slot:
        """Slot t where `energy` (units, scenarios), MWh, is stored at its start.

        A storage without energy to give forms no island; see `Microgrid.situation`.
        """
        slot = self[t]
        if self.microgrid.energised is None:
            return slot
        now, microgrid = np.array([t]), self.microgrid
        situation = microgrid.situation(
            self.line_up[:, t],
            lambda name: self.profile(name, now)[0],
            before=up_before(self.line_up, now)[:, 0] if self.with_before else None,
            energy=energy,
        )
        usual, now_forming = microgrid.forming_in(situation), situation.forming_now
        alive, alive_now = (
            reached(slot.island, np.broadcast_to(forms, slot.island.shape))
            for forms in (usual, now_forming)
            if forms is not None
        )
        if (alive == alive_now).all():
            return slot
        data = microgrid.data(situation)
        wide = {k: np.broadcast_to(v, (len(v), energy.shape[1])) for k, v in data.items()}
        return Slot(wide, self.simulator.stacked(wide), slot.island)

    def _stretch(self, first: int) -> list[Slot]:
        """The slots from `first` on, as many as a stretch has."""
        _, horizon, n = self.line_up.shape
        slots = np.arange(first, min(first + self.length, horizon))
        data, situation = stretch_data(
            self.microgrid, self.line_up, self.profile, slots, with_before=self.with_before
        )

        def apart(array: np.ndarray) -> np.ndarray:
            """(slots, labels, scenarios), a view."""
            wide = np.broadcast_to(array, (len(array), len(slots) * n))
            return wide.reshape(len(array), len(slots), n).swapaxes(0, 1)

        named = {name: apart(values) for name, values in data.items()}
        stacked, island = (
            self.simulator.stacked(named),
            np.ascontiguousarray(apart(situation.island)),
        )
        return [
            Slot({name: values[k] for name, values in named.items()}, stacked[k], island[k])
            for k in range(len(slots))
        ]
