"""From a number in [-1, 1] per unit to MW: how it is done decides more than the algorithm.

- `AffineBand` is the paper's mask, its eq. (18): the whole range that a unit has now, efficiencies
  included.
- `AnchorBand` puts -1 on serving all that helps, 0 on what the rule does, and +1 on charging fully,
  straight lines between: what the recourse makes a kink of is an end of the band or its middle, and
  a network hits it by saturating.
"""

from __future__ import annotations

from typing import Literal, Protocol, get_args

import numpy as np

from resilience.dispatch.anchors import Anchors, Needs
from resilience.errors import UsageError
from resilience.models.simulator.arrays import Array, array_ops
from resilience.models.simulator.plant import Plant

BandName = Literal["anchors", "affine"]
BANDS: tuple[BandName, ...] = get_args(BandName)


class Band(Protocol):
    """What turns outputs into power."""

    def power(
        self, output: Array, energy: Array, data: Array, island: Array, needs: Needs | None = None
    ) -> Array:
        """(units, batch) MW, charging positive, within what every unit can do now.

        Args:
            output: (units, batch) in [-1, 1].
            energy: (units, batch) MWh.
            data: (n_data, batch) from `stacked`.
            island: (buses, batch) number of the island of every bus.
            needs: of the islands, where they are known already.
        """


class AffineBand:
    """The paper's mask.

    Args:
        plant: the stage as a step sees it.
    """

    def __init__(self, plant: Plant) -> None:
        self.plant = plant

    def power(
        self, output: Array, energy: Array, data: Array, island: Array, needs: Needs | None = None
    ) -> Array:
        """See `Band.power`."""
        low, high = self.plant.limits(energy, data)
        return low + (high - low) * (output * 0.5 + 0.5)


class AnchorBand:
    """Between serving, the rule and charging.

    Args:
        plant: the stage as a step sees it.
        level: state of charge of the rule.
    """

    def __init__(self, plant: Plant, level: float = 0.9) -> None:
        self.anchors = Anchors(plant, level)

    def power(
        self, output: Array, energy: Array, data: Array, island: Array, needs: Needs | None = None
    ) -> Array:
        """See `Band.power`."""
        ops = array_ops(energy)
        low, high, serve, _, rule = self.anchors.actions(energy, data, island, needs)
        middle = ops.maximum(ops.minimum(rule, high), low)
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
