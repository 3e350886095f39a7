"""From a number in [-1, 1] per unit to MW: how it is done decides more than the algorithm.

- `AffineBand` is the paper's mask, its eq. (18): the whole range that a unit has now, efficiencies
  included.
- `AnchorBand` puts -1 on serving all that helps, 0 on what the rule does, and +1 on charging fully,
  straight lines between: what the recourse makes a kink of is an end of the band or its middle, and
  a network hits it by saturating.
"""

from __future__ import annotations

from typing import Literal, NamedTuple, Protocol, get_args

import numpy as np

from resilience.dispatch.anchors import Anchors, Needs
from resilience.errors import UsageError
from resilience.models.simulator.arrays import Array, array_ops
from resilience.models.simulator.plant import Plant, StorageSlot

BandName = Literal["anchors", "affine"]
BANDS: tuple[BandName, ...] = get_args(BandName)


class BandSlot(NamedTuple):
    """What a band needs to know of a slot, whatever is stored.

    Attributes:
        storage: what it is to storage.
        needs: of the islands; None where the band does not ask.
    """

    storage: StorageSlot
    needs: Needs | None


class Band(Protocol):
    """What turns outputs into power.

    Attributes:
        first_output: where a network that follows the simulator's gradient begins: where what it
            does makes a difference. Who explores needs none.
    """

    first_output: float

    def slot(self, data: Array, island: Array, storage: StorageSlot | None = None) -> BandSlot:
        """What the band needs to know of a slot.

        Args:
            data: (n_data, batch) from `stacked`.
            island: (buses, batch) number of the island of every bus.
            storage: from `Plant.storage_slot`; worked out if omitted.
        """

    def power(self, output: Array, energy: Array, slot: BandSlot) -> Array:
        """(units, batch) MW, charging positive, within what every unit can do now.

        Args:
            output: (units, batch) in [-1, 1].
            energy: (units, batch) MWh.
            slot: from `slot`.
        """


class AffineBand:
    """The paper's mask.

    Args:
        plant: the stage as a step sees it.
    """

    first_output = 0.0

    def __init__(self, plant: Plant) -> None:
        self.plant = plant

    def slot(self, data: Array, island: Array, storage: StorageSlot | None = None) -> BandSlot:
        """See `Band.slot`."""
        return BandSlot(storage or self.plant.storage_slot(data, island), None)

    def power(self, output: Array, energy: Array, slot: BandSlot) -> Array:
        """See `Band.power`."""
        take, give = self.plant.possible(array_ops(energy), energy, slot.storage.power_limits)
        return (take + give) * (output * 0.5 + 0.5) - give


class AnchorBand:
    """Between serving, the rule and charging.

    A full battery does the same for any output of 0 and more, and the rule keeps it full: a network
    that begins there has no gradient, and may never learn to serve. So it begins below.

    Args:
        plant: the stage as a step sees it.
        level: state of charge of the rule.
    """

    first_output = -0.45

    def __init__(self, plant: Plant, level: float = 0.9) -> None:
        self.plant, self.anchors = plant, Anchors(plant, level)

    def slot(self, data: Array, island: Array, storage: StorageSlot | None = None) -> BandSlot:
        """See `Band.slot`."""
        storage = storage or self.plant.storage_slot(data, island)
        return BandSlot(storage, self.anchors.needs(data, island, storage))

    def power(self, output: Array, energy: Array, slot: BandSlot) -> Array:
        """See `Band.power`."""
        assert slot.needs is not None
        ops = array_ops(energy)
        low, high, serve, _, rule = self.anchors.actions(energy, slot.storage, slot.needs)
        middle = ops.within(rule, low, high)
        return middle + output * ops.where(output >= 0.0, high - middle, middle - serve)


def band(name: str, plant: Plant) -> Band:
    """A band by its name.

    Raises:
        UsageError: there is none of this name.
    """
    if name not in BANDS:
        raise UsageError(
            f"band {name!r} is unknown; allowed: {', '.join(BANDS)}",
            hint="anchors is the default, affine is the paper's",
        )
    return AnchorBand(plant) if name == "anchors" else AffineBand(plant)


def clipped(output: Array) -> Array:
    """Outputs within [-1, 1]: what noise was added to."""
    return output.clip(-1.0, 1.0) if isinstance(output, np.ndarray) else output.clamp(-1.0, 1.0)
