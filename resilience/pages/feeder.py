"""The map of a page: the feeder with what happens in every slot, as plain data."""

from __future__ import annotations

from typing import Any

import numpy as np

from resilience.arrays import Floats
from resilience.case import Case
from resilience.case.schema import GridTable
from resilience.pages.document import plain
from resilience.plots.feeder.layout import Layout
from resilience.plots.feeder.view import FeederMap
from resilience.tolerances import DRAWN_TOLERANCE_MW

MAX_NUMBERS = 250_000
"""Of what changes from slot to slot; of longer plans only some slots are drawn."""


def map_data(view: FeederMap) -> dict[str, Any]:
    """A map with its slots.

    Args:
        view: the feeder through the slots of a plan.
    """
    rows = 3 * len(view.colour) + 2 * len(view.flow_mw) + 2 * len(view.devices)
    every = max(-(-rows * view.slots // MAX_NUMBERS), 1)
    shown = slice(0, None, every)
    network = view.case.network
    feeder = feeder_data(view.case, view.places)
    for line, rating in zip(feeder["lines"], network.rating_mva, strict=True):
        line["rating_mva"] = float(rating) if np.isfinite(rating) else None
    feeder["devices"] = [
        {
            "name": device.name,
            "kind": device.kind,
            "colour": device.colour,
            "bus": device.bus,
            "storage": device.is_storage,
        }
        for device in view.devices
    ]
    feeder["every"] = every
    feeder["first"] = 0 if view.down_chance is None else int(view.down_chance.sum(0).argmax())
    feeder["frames"] = {
        "state": plain(view.line_state[:, shown]),
        "flow": _rows(view.flow_mw[:, shown]),
        "chance": None if view.down_chance is None else plain(view.down_chance[:, shown]),
        "voltage": None if view.voltage_pu is None else plain(view.voltage_pu[:, shown]),
        "colour": plain(view.colour[:, shown]),
        "demand": plain(view.demand_mw[:, shown]),
        "shed": _rows(np.where(view.shed_mw > DRAWN_TOLERANCE_MW, view.shed_mw, np.nan)[:, shown]),
        "power": plain(view.power_mw[:, shown]),
        "soc": _rows(view.soc[:, shown]),
    }
    feeder["largest"] = {"flow": _largest(view.flow_mw), "shed": _largest(view.shed_mw)}
    feeder["band"] = [float(network.v_min_pu.min()), float(network.v_max_pu.max())]
    return feeder


def feeder_data(case: Case, places: Layout) -> dict[str, Any]:
    """Buses and lines of a case where they are drawn."""
    network = case.network
    grids = {network.bus(grid.bus) for grid in case.tables_of(GridTable)}
    ends = zip(network.line_names, network.from_bus.tolist(), network.to_bus.tolist(), strict=True)
    return {
        "buses": [
            {"name": name, "x": round(float(x), 4), "y": round(float(y), 4), "grid": k in grids}
            for k, (name, x, y) in enumerate(
                zip(network.bus_names, places.x, places.y, strict=True)
            )
        ],
        "lines": [{"name": name, "a": a, "b": b} for name, a, b in ends],
        "note": _note(places),
    }


def _note(places: Layout) -> str:
    if places.is_computed:
        return "A diagram: the network states no coordinates."
    return "Places as the network's source states them."


def _rows(values: Floats) -> list[Any]:
    """Rows as lists; one without any number is None."""
    lists = plain(values)
    is_empty: list[bool] = np.asarray(np.isnan(values).all(axis=1)).tolist()
    return [None if empty else row for row, empty in zip(lists, is_empty, strict=True)]


def _largest(values: Floats) -> float:
    return float(np.nanmax(np.abs(values), initial=0.0)) if values.size else 0.0
