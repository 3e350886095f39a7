r"""The paper's recourse, its eqs. (20) and (21), read for islands.

In an island without the grid, generators run as if there were neither PV nor storage, whatever
these do, and one share of every load is shed:

$$ p_k = \min\Big\{\sum_k \overline{P}_k, \sum_l d_l\Big\} \frac{\overline{P}_k}{\sum_k
\overline{P}_k}, \qquad \alpha = \frac{\sum_l d_l + \sum_j p^\text{ESS}_j - \sum_i a_i - \sum_k
p_k}{\sum_l d_l} $$

The paper leaves open what a share outside [0, 1] means. Here it is clipped: below 0 the surplus of
PV is curtailed, then discharging is cut back; above 1 charging is. With a grid the equations would
run generators all day at 0.5 beside a grid at 0.3, so there they stand still, the grid takes
whatever is left, surplus PV too, and only beyond its limits generators and shedding help.
"""

from __future__ import annotations

import numpy as np

from resilience.arrays import Bools, Ints
from resilience.errors import UsageError
from resilience.models.simulator.arrays import Array, ArrayOps
from resilience.models.simulator.plant import Plant

TIERS = ("pv.p", "grid.export", "grid.import", "generator.p", "load.shed")


def check_paper(plant: Plant) -> None:
    """Refuses what the two equations say nothing of.

    Raises:
        UsageError: another kind of source than the paper's, or a block.
    """
    unknown = sorted(set(plant.kinds) - set(TIERS))
    if unknown:
        raise UsageError(
            f"the paper's recourse does not know {', '.join(unknown)}; allowed: {', '.join(TIERS)}",
            hint="use recourse='economic'",
        )
    if plant.tanks:
        raise UsageError(
            f"the paper's recourse knows no tanks, but there is {', '.join(plant.tanks)}",
            hint="use recourse='economic'",
        )
    blocks = [load.name for load in plant.microgrid.case.load if load.block]
    if blocks:
        raise UsageError(
            f"the paper's recourse sheds a share of every load, but {', '.join(blocks)} can only "
            "be shed whole",
            hint="use recourse='economic', or leave `block` out",
        )


def paper_tiers(plant: Plant) -> tuple[Ints, Bools]:
    """The tiers of the paper, of which none is a block; prices are only paid."""
    tier = np.array([TIERS.index(kind) for kind in plant.kinds], np.intp)
    return tier, np.zeros(len(TIERS), bool)


def paper_fill(ops: ArrayOps, need: Array, room: Array, load: Array) -> tuple[list[Array], Array]:
    """Draws from the tiers by the two equations; see the module's docstring.

    Args:
        ops: operations for the kind of array.
        need: (buses, batch) MW missing, in the row of the island's number.
        room: (tiers, buses, batch) MW that each tier can give there.
        load: (buses, batch) demand of the islands, MW.

    Returns:
        (tiers) of (buses, batch), MW drawn from every tier; and the need that remains (negative: a
        surplus), (buses, batch).
    """
    export, grid_import, generator = (
        TIERS.index(kind) for kind in ("grid.export", "grid.import", "generator.p")
    )
    connected = room[export] + room[grid_import] > 0
    zero = load * 0.0
    # Generators first, whatever PV and storage do; with a grid they come in their turn.
    up_front = ops.where(connected, zero, ops.minimum(room[generator], load))
    need = need - up_front
    drawn = []
    for k in range(len(TIERS)):
        allowed = ops.where(connected, room[k], zero) if k == generator else room[k]
        mw = ops.positive_up_to(need, allowed)
        need = need - mw
        drawn.append(mw + up_front if k == generator else mw)
    return drawn, need
