"""What a step cannot hold is refused with a hint, all of it at once."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from resilience.errors import UsageError
from resilience.models.structures import Cone, Disc, Largest, Split, Structure

if TYPE_CHECKING:
    from resilience.models.microgrid import Microgrid
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


def needs_milp(microgrid: Microgrid, dt: float, *, blocks: bool) -> bool:
    """Whether a step has to hold commitment, ramps, curves, switches, or blocks.

    Args:
        microgrid: the microgrid.
        dt: length of a step, h.
        blocks: whether blocks are stepped without.
    """
    stage = microgrid.stage(dt, energy_known=True)
    columns = zip(stage.variables, stage.integer, strict=True)
    there = [(block.name, is_integer) for block, is_integer in columns if block.n]
    choices = {name for name, is_integer in there if is_integer} - set(BLOCKS if blocks else ())
    states = {after.name for _, after in stage.states if after.n} - set(STATES)
    curves = {name for name, _ in there} & set(CURVES)
    return bool(choices | states | curves) or any(type(s) not in STEPPED for s in stage.structures)


def refuse_endless(microgrid: Microgrid) -> None:
    """Raises where a unit may have to burn on although its tank is empty.

    Raises:
        UsageError: units with a tank that cannot go down at will; all are named.
    """
    slow = [
        unit.name
        for unit in microgrid.case.generator
        if unit.tank is not None and (unit.min_up_h or unit.ramp_down_mw_per_h is not None)
    ]
    if slow:
        raise UsageError(
            f"the simulator does not step {', '.join(slow)}: a tank, and min_up_h or "
            "ramp_down_mw_per_h",
            hint="a unit that must run on may have no fuel to; drop the tank or the limit, or plan "
            "with `solve`",
        )
