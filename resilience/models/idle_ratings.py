"""Ratings that nothing can reach: without them more buses act as one, and nothing is decided anew.

What a line can be asked to carry at copperplate is what devices on either side of it can give and
take (`resilience.models.network.limits`). Where that is less than its rating in every slot of the
horizon, whatever is decided and whatever is out, the rating holds by itself.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from resilience.models.microgrid import Microgrid
from resilience.models.network.graph import merge
from resilience.models.wiring import flow_limits


def without_idle_ratings(microgrid: Microgrid) -> Microgrid:
    """The same microgrid without such ratings, buses joined anew.

    It is the same for the load and PV that its case states, and not for others.

    Args:
        microgrid: at copperplate.
    """
    case, network = microgrid.case, microgrid.network
    fleets = list(microgrid.fleets.values())
    none = np.zeros(len(network.line_names), bool)
    limits = flow_limits(case, network, fleets, None, none, none, losses=False)
    profiles = limits.values(case.profile, case.slots)
    most_mva = np.maximum(limits.forth @ profiles, limits.back @ profiles).max(axis=1, initial=0.0)
    rating = np.where(most_mva <= network.rating_mva, np.inf, network.rating_mva)
    merged, bus_of = merge(replace(network, rating_mva=rating), microgrid.fallible)
    remains = np.isin(network.line_names, merged.line_names)
    return replace(
        microgrid,
        network=merged,
        bus_of=bus_of[microgrid.bus_of],
        lines_of=microgrid.lines_of[remains],
        fallible=microgrid.fallible[remains],
    )
