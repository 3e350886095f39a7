"""Cables, lengths and drawn ways of a network file reach the storm."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import resilience as rs
from resilience.case import Case
from resilience.errors import UsageError
from resilience.fragility.chain import storm
from resilience.fragility.lines.geography import geography

# One bus 2 km north of the first and 3 km east of that: 2 / 110.725 degrees of latitude at 22 N,
# 3 / 103.28 of longitude (WGS 84), and a line that goes around the corner.
BUSES = {1: (120.7, 22.0), 2: (120.72905, 22.01806), 3: (120.75, 22.03)}
CORNER = (120.7, 22.01806)
LINES: tuple[dict[str, Any], ...] = (
    {"from": 1, "to": 2, "type": "ol", "km": 5.004, "geo": [BUSES[1], CORNER, BUSES[2]]},
    {"from": 2, "to": 3, "type": "cs", "km": 2.9, "geo": None},
    {"from": 1, "to": 3, "type": None, "km": 7.31, "geo": None},
)
CASE = """
name = "corner"
[network]
file = "net.json"
[geography]
degrees = true
span_m = 70.0
[time]
start = 2023-10-05T00:00:00
slots = 24
step_min = 60
[storm]
averaging_s = 60
points = [
    [2023-10-04T12:00:00, 21.0, 122.5, 945, 47.0],
    [2023-10-05T12:00:00, 22.1, 120.9, 940, 49.0],
    [2023-10-06T12:00:00, 22.9, 118.5, 960, 41.0],
]
[[grid]]
bus = "1"
import_max_mw = 4.0
import_cost_per_mwh = 70.0
[[load]]
name = "town"
bus = "3"
p_max_mw = 1.7
shed_cost_per_mwh = 900.0
"""


def table(columns: list[str], rows: list[list[Any]]) -> dict[str, str]:
    """A table as pandapower writes it."""
    frame = {"columns": columns, "index": list(range(len(rows))), "data": rows}
    return {"_object": json.dumps(frame)}


def case_of(folder: Path, lines: tuple[dict[str, Any], ...], more: str = "") -> Case:
    """The case on a pandapower network of three buses and these lines."""

    def geo(kind: str, place: Any) -> str | None:
        return place and json.dumps({"type": kind, "coordinates": place})

    ohm = {"r_ohm_per_km": 0.31, "x_ohm_per_km": 0.34, "max_i_ka": 0.4}
    columns = ["from_bus", "to_bus", "type", "length_km", "geo", "in_service", *ohm]
    rows = [
        [row["from"] - 1, row["to"] - 1, row["type"], row["km"], geo("LineString", row["geo"]),
         True, *ohm.values()]
        for row in lines
    ]  # fmt: skip
    buses = [[20.0, geo("Point", place), True] for place in BUSES.values()]
    tables = {"bus": table(["vn_kv", "geo", "in_service"], buses), "line": table(columns, rows)}
    (folder / "net.json").write_text(json.dumps({"_object": tables}), encoding="utf-8")
    (folder / "case.toml").write_text(CASE + more, encoding="utf-8")
    return rs.load_case(folder / "case.toml")


def test_spans_follow_the_drawn_way(tmp_path: Path) -> None:
    """2 km north, then 3 km east: 72 spans of at most 70 m, on the way, as it goes there."""
    place = geography(case_of(tmp_path, LINES))
    spans = place.span_line == 0
    assert spans.sum() == np.ceil(5004 / 70)
    north = np.arange(spans.sum()) + 0.5 < 72 * 2.0 / 5.0
    np.testing.assert_allclose(place.span_lon_deg[spans][north], 120.7, atol=1e-6)
    np.testing.assert_allclose(place.span_lat_deg[spans][~north], 22.01806, atol=1e-5)
    assert (np.diff(place.span_lat_deg[spans][north]) > 0).all()
    np.testing.assert_allclose(place.span_bearing_deg[spans][north], 0.0, atol=1e-6)
    np.testing.assert_allclose(place.span_bearing_deg[spans][~north], 90.0, atol=0.01)
    km_apart = np.diff(place.span_lon_deg[spans][~north]) * 103.28
    np.testing.assert_allclose(km_apart, 5.0 / 72, rtol=2e-3)


def test_a_line_is_as_long_as_its_file_says(tmp_path: Path) -> None:
    """Straight from 1 to 3 it would be 6.13 km."""
    place = geography(case_of(tmp_path, LINES))
    np.testing.assert_allclose(place.length_km, [5.004, 2.9, 7.31])
    straight = place.span_line == 2
    assert straight.sum() == np.ceil(7310 / 70)
    towards = np.polyfit(place.span_lon_deg[straight], place.span_lat_deg[straight], 1)
    assert towards[0] == pytest.approx(0.03 / 0.05, rel=1e-3)


def test_one_length_for_all_lines_is_none(tmp_path: Path) -> None:
    """Converters write 1 km everywhere; ways are as long as they are drawn, or straight."""
    place = geography(case_of(tmp_path, tuple(line | {"km": 1.0} for line in LINES)))
    np.testing.assert_allclose(place.length_km, [5.0, 2.54, 6.13], atol=0.02)


def test_a_cable_of_the_file_does_not_break_in_the_wind(tmp_path: Path) -> None:
    case = case_of(tmp_path, LINES)
    assert storm(case, every_line=True).lines.names == ("1-2", "1-3")
    np.testing.assert_array_equal(case.network.breakpoint, [True, False, True])
    said = (
        '[[line]]\nname = "2-3"\nunderground = false\n[[line]]\nname = "1-3"\nunderground = true\n'
    )
    assert storm(case_of(tmp_path, LINES, said), every_line=True).lines.names == ("1-2", "2-3")
    buried = tuple(line | {"type": "cs"} for line in LINES)
    with pytest.raises(UsageError, match="by the network file"):
        storm(case_of(tmp_path, buried))


@pytest.mark.parametrize(
    "geo", [[BUSES[1]], [[120.7], [120.8]], [["a", "b"], ["c", "d"]], [[120.7, None], [1, 2]], 7]
)
def test_a_way_that_is_none_is_straight(geo: Any, tmp_path: Path) -> None:
    lines = (LINES[0] | {"geo": geo}, *LINES[1:])
    assert case_of(tmp_path, lines).network.courses["1-2"].points == ()


def test_most_lines_of_mv_oberrhein_are_cables(tmp_path: Path) -> None:
    """By pandapower's own table: 171 cables, 10 overhead lines, 105.3 km in service."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore")
        import pandapower.networks as library

        line = library.mv_oberrhein().line
    from resilience.case.starter import new_case_text

    storm_table = CASE[CASE.index("[storm]") : CASE.index("[[grid]]")]
    head = "[geography]\ndegrees = true\n" + storm_table.replace("22.1, 120.9", "48.4, 7.9")
    moved = head.replace("21.0, 122.5", "47.5, 9.5").replace("22.9, 118.5", "49.2, 5.8")
    text = new_case_text("mv_oberrhein").replace("2016-07-12", "2023-10-05") + moved
    (tmp_path / "ober.toml").write_text(text, encoding="utf-8")
    case = rs.load_case(tmp_path / "ober.toml")
    overhead = set(line["name"][line["type"] == "ol"])
    broken = storm(case, every_line=True)
    assert set(broken.lines.names) == overhead
    assert len(overhead) == 10
    assert broken.failed_by[:, -1].sum() > 1.0
    courses = case.network.courses
    assert sum(course.underground for course in courses.values()) == 171
    for name, km in zip(line["name"], line["length_km"], strict=True):
        assert broken.geography.length_km[case.network.line(name)] == km
