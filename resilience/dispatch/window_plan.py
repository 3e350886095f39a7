"""The plan behind a decision: what the paths of a window do after it, on average."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.models.components import Role, in_roles

if TYPE_CHECKING:
    from resilience.models.microgrid import Microgrid
    from resilience.models.program.standard import Standard


@dataclass(frozen=True, eq=False)
class WindowPlan:
    """What is planned for the present slot and those behind it.

    Powers are means over a step, and over the paths by their probability.

    Attributes:
        first: (steps,) slot of the horizon in which each step begins.
        stop: (steps,) first slot behind it.
        units: names of the storage.
        energy_mwh: (units, steps) stored at the end, mean of the paths.
        lowest_mwh, highest_mwh: (steps,) all storage together at the end, on the path that has
            least and most of it.
        storage_mw: (units, steps) fed in, negative while charging.
        generator_mw, weather_mw, grid_mw, shed_mw: (steps,) of all generators, plants, connections
            to the grid and loads.
        probability: (paths,) of every path.
    """

    first: Ints
    stop: Ints
    units: tuple[str, ...]
    energy_mwh: Floats
    lowest_mwh: Floats
    highest_mwh: Floats
    storage_mw: Floats
    generator_mw: Floats
    weather_mw: Floats
    grid_mw: Floats
    shed_mw: Floats
    probability: Floats


@runtime_checkable
class Planning(Protocol):
    """A dispatcher that plans ahead, and can say what."""

    def latest_plan(self) -> WindowPlan | None:
        """The plan behind the decision that it made last; None before the first one."""


def window_plan(
    standard: Standard,
    microgrid: Microgrid,
    spans: tuple[Ints, Ints],
    probability: Floats,
    data: Mapping[str, Floats],
    z: Floats,
) -> WindowPlan:
    """The plan of a point of a window's program.

    Args:
        standard: the program: a first node common to all paths, then one path after another.
        microgrid: that it is of.
        spans: (steps,) slot of the horizon in which each step begins, and slots that it takes.
        probability: (paths,) of every path.
        data: of the program, (labels, nodes) by name.
        z: (columns,) its solution.
    """
    fleets = microgrid.fleets.values()
    begins, width = spans
    stops = np.minimum(begins + width, microgrid.case.slots)
    inside = begins < microgrid.case.slots
    # Of a step that passes the end of the horizon its data have only the part before it.
    stretch = width[inside] / (stops - begins)[inside]
    places = _nodes(len(begins), len(probability))

    def mean(values: Floats) -> Floats:
        """(rows, steps) of values (rows, nodes)."""
        return values[:, places] @ probability

    def values(name: str) -> Floats:
        columns = z[standard.columns(name)] if standard.has(name) else data[name]
        return np.broadcast_to(columns, (len(columns), standard.tree.n))

    def total(role: Role) -> Floats:
        power = np.zeros((1, standard.tree.n))
        for fleet in in_roles(fleets, role):
            power = power + fleet.power(values).sum(0)
        return mean(power)[0, inside] * stretch

    energy = values("ess.energy")
    stored = energy.sum(0)[places]  # (steps, paths)
    shed = np.zeros((1, standard.tree.n))
    for fleet in in_roles(fleets, "load"):
        shed = shed + values(fleet.shed).sum(0)
    storage = values("ess.discharge") - values("ess.charge")
    return WindowPlan(
        first=begins[inside],
        stop=stops[inside],
        units=tuple(standard.labels("ess.energy")),
        energy_mwh=mean(energy)[:, inside],
        lowest_mwh=stored.min(axis=1)[inside],
        highest_mwh=stored.max(axis=1)[inside],
        storage_mw=mean(storage)[:, inside] * stretch,
        generator_mw=total("dispatchable"),
        weather_mw=total("weather"),
        grid_mw=total("exchange"),
        shed_mw=mean(shed)[0, inside] * stretch,
        probability=probability,
    )


def _nodes(steps: int, paths: int) -> Ints:
    """(steps, paths) node of every step on every path."""
    nodes = np.zeros((steps, paths), np.intp)
    nodes[1:] = 1 + np.arange(paths * (steps - 1)).reshape(paths, steps - 1).T
    return nodes
