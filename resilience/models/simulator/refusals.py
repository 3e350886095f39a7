"""What a step cannot hold is refused with a hint, all of it at once."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from resilience.errors import UsageError
from resilience.models.structures import Cone, Disc, Largest, Split, Structure

if TYPE_CHECKING:
    from resilience.models.simulator.plant import Plant

STATES = ("ess.energy", "tank.level")
BLOCKS = ("load.on",)
CURVES = ("tank.burn",)
STEPPED: frozenset[type[Structure]] = frozenset({Split, Cone, Disc, Largest})
"""Structures that a step holds."""


def refuse(plant: Plant, *, blocks: bool, ratings: bool) -> None:
    """Raises where the stage needs more than a step holds.

    Args:
        plant: the stage as a step sees it.
        blocks: whether the step sheds blocks.
        ratings: whether line ratings are refused.

    Raises:
        UsageError: it does; everything that is too much is named.
    """
    stage, form = plant.form.stage, plant.form
    allowed = BLOCKS if blocks else ()
    integer = [b.name for b in form.own_blocks if b.n and form.integer[form.own_columns(b)[0]]]
    demands = [f"decide {name!r}" for name in integer if name not in allowed]
    memory = [after.name for _, after in stage.states if after.name not in (*STATES, *integer)]
    demands += [f"remember {name!r}" for name in memory]
    demands += [
        f"hold the {s.title} {s.name!r}" for s in stage.structures if type(s) not in STEPPED
    ]
    demands += [f"follow the curve {b.name!r}" for b in form.own_blocks if b.name in CURVES]
    if ratings and np.isfinite(plant.microgrid.network.rating_mva).any():
        demands.append("hold line ratings")
    if demands:
        without = ["commitment", "ramps", "curves of cost or fuel", "switchable lines"]
        without += ([] if blocks else ["blocks"]) + (["line ratings"] if ratings else [])
        raise UsageError(
            f"the simulator does not {', '.join(demands)}",
            hint=f"it steps cases without {', '.join(without[:-1])} and {without[-1]}",
        )
