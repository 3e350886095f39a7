"""Feeders are drawn where their source puts them, or as a diagram that hangs together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import resilience as rs
from resilience.case.schema import GeographyTable
from resilience.plots.feeder.layout import layout


@pytest.mark.parametrize("name", ["large", "ieee14", "analytic/two-islands"])
def test_a_diagram_has_a_place_for_every_bus(name: str) -> None:
    case = rs.load_case(name)
    places = layout(case)
    assert places.is_computed
    spots = set(zip(places.x.tolist(), places.y.tolist(), strict=True))
    assert len(spots) == len(case.network.bus_names)
    assert max(places.x.max(), places.y.max()) == 1.0
    assert min(places.x.min(), places.y.min()) == 0.0


def test_lines_of_a_tree_go_one_step_away_from_the_grid() -> None:
    case = rs.load_case("large")
    network, places = case.network, layout(case)
    closed = np.flatnonzero(network.in_service)
    step = np.abs(places.x[network.to_bus[closed]] - places.x[network.from_bus[closed]])
    assert places.x[network.bus(case.grid[0].bus)] == 0.0
    np.testing.assert_allclose(step, step[0])


def test_places_of_the_source_keep_their_shape() -> None:
    case = rs.load_case("ieee33")
    places = layout(case)
    x, y = np.array([case.places[name] for name in case.network.bus_names]).T
    assert not places.is_computed
    scale = max(np.ptp(x), np.ptp(y))
    np.testing.assert_allclose(np.diff(places.x), np.diff(x) / scale)
    np.testing.assert_allclose(np.diff(places.y), np.diff(y) / scale)


def test_degrees_are_as_wide_as_they_are_there() -> None:
    """At 60° north a degree of longitude is half as long as one of latitude."""
    drawn = rs.load_case("ieee33")
    north = {name: (x, 60.0 + 1e-6 * y) for name, (x, y) in drawn.places.items()}
    case = replace(drawn, geography=GeographyTable(degrees=True), places=north)
    places = layout(case)
    x, y = np.array(list(north.values())).T
    ratio = (np.ptp(places.x) / np.ptp(places.y)) / (np.ptp(x) / np.ptp(y))
    assert ratio == pytest.approx(0.5, rel=1e-5)
