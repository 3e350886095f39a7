"""Where a feeder stands: lengths, places, spans."""

from __future__ import annotations

from datetime import datetime

import numpy as np
import pytest

import resilience as rs
from resilience.case import Case
from resilience.case.document import Document
from resilience.case.load import build_case
from resilience.case.schema import GeographyTable
from resilience.errors import CaseError
from resilience.fragility.lines.geography import Geography, geography

ANCHOR = GeographyTable(synthetic=True, anchor_lat_deg=22.0, anchor_lon_deg=120.74)


@pytest.fixture(scope="module")
def feeder() -> Case:
    return rs.load_case("ieee33").replace(geography=ANCHOR)


@pytest.fixture(scope="module")
def place(feeder: Case) -> Geography:
    return geography(feeder)


def test_the_synthetic_feeder_is_as_long_as_its_reactances_say(
    feeder: Case, place: Geography
) -> None:
    length = place.length_km[feeder.network.in_service]
    assert length.sum() == pytest.approx(50.8, abs=0.05)
    assert length.min() == pytest.approx(0.134, abs=5e-4)
    assert length.max() == pytest.approx(4.917, abs=5e-4)
    ohm = feeder.network.x_pu / 0.394 * 12.66**2
    np.testing.assert_allclose(length, ohm[feeder.network.in_service] / 0.35, rtol=1e-5)
    assert place.synthetic


def test_the_impedance_scale_moves_nothing(place: Geography, feeder: Case) -> None:
    plain = dict(feeder.source, network=dict(feeder.source["network"], impedance_scale=1.0))
    other = geography(build_case(Document(feeder.path, plain)))
    np.testing.assert_allclose(other.length_km, place.length_km, rtol=1e-9)


def test_directions_are_those_of_the_drawing(feeder: Case, place: Geography) -> None:
    drawn = np.array([feeder.places[name] for name in feeder.network.bus_names])
    i, j = feeder.network.from_bus, feeder.network.to_bus
    step = drawn[j] - drawn[i]
    expected = np.degrees(np.arctan2(step[:, 0], step[:, 1])) % 360.0
    first = np.searchsorted(place.span_line, np.flatnonzero(feeder.network.in_service))
    away = (place.span_bearing_deg[first] - expected[feeder.network.in_service] + 180) % 360 - 180
    assert np.abs(away).max() < 0.1  # meridians converge by 0.04 degrees over 10 km


def test_turning_the_drawing_turns_every_span_and_no_length(feeder: Case, place: Geography) -> None:
    turned = geography(feeder.replace(geography=ANCHOR.model_copy(update={"turn_deg": 90.0})))
    by = (turned.span_bearing_deg - place.span_bearing_deg) % 360.0
    np.testing.assert_allclose(by, 90.0, atol=0.1)
    used = feeder.network.in_service
    np.testing.assert_allclose(turned.length_km[used], place.length_km[used], rtol=1e-5)


def test_the_anchor_bus_stands_at_the_anchor(feeder: Case) -> None:
    found = geography(feeder.replace(geography=ANCHOR.model_copy(update={"anchor_bus": "18"})))
    at = feeder.network.bus("18")
    assert found.bus_lat_deg[at] == pytest.approx(22.0, abs=1e-9)
    assert found.bus_lon_deg[at] == pytest.approx(120.74, abs=1e-9)


def test_spans_divide_a_line_evenly(feeder: Case, place: Geography) -> None:
    count = np.bincount(place.span_line, minlength=37)
    used = feeder.network.in_service
    np.testing.assert_array_equal(count[used], np.ceil(place.length_km[used] / 0.05 - 1e-6))
    assert not count[~used].any()  # tie lines that nothing closes stand without current
    line = feeder.network.line("16-17")
    spans = np.flatnonzero(place.span_line == line)
    i, j = feeder.network.from_bus[line], feeder.network.to_bus[line]
    middle = (place.bus_lat_deg[i] + place.bus_lat_deg[j]) / 2
    assert place.span_lat_deg[spans].mean() == pytest.approx(middle, abs=1e-6)
    steps = np.diff(place.span_lat_deg[spans])
    np.testing.assert_allclose(steps, steps[0], rtol=1e-3)


def two_buses(**bus: float) -> Case:
    """A line of one degree, from the equator north."""
    document = {
        "time": {"start": datetime(2016, 7, 12), "slots": 2, "step_min": 60},
        "network": {
            "bus": [
                {"name": "a", "vn_kv": 10.0, "lat_deg": 0.0, "lon_deg": 179.9},
                {"name": "b", "vn_kv": 10.0, **bus},
            ],
            "line": [{"from": "a", "to": "b", "r_ohm": 1.0, "x_ohm": 40.0}],
        },
        "grid": [{"bus": "a", "import_max_mw": 1.0, "import_cost_per_mwh": 1.0}],
        "load": [{"name": "l", "bus": "b", "p_max_mw": 1.0, "shed_cost_per_mwh": 9.0}],
    }
    return build_case(Document(None, document))


def test_lengths_are_those_of_the_ellipsoid() -> None:
    """A degree of latitude at the equator is 110.574 km, one of longitude 111.320 km (WGS 84)."""
    north = geography(two_buses(lat_deg=1.0, lon_deg=179.9))
    assert north.length_km[0] == pytest.approx(110.574, abs=2e-3)
    assert north.span_bearing_deg[0] == pytest.approx(0.0, abs=1e-6)
    east = geography(two_buses(lat_deg=0.0, lon_deg=-179.1))  # across the dateline
    assert east.length_km[0] == pytest.approx(111.320, abs=2e-3)
    assert east.span_bearing_deg[0] == pytest.approx(90.0, abs=1e-6)
    assert not east.synthetic


def test_a_feeder_that_stands_nowhere_has_no_geography() -> None:
    with pytest.raises(CaseError, match="33 of 33 buses without coordinates"):
        geography(rs.load_case("ieee33"))
