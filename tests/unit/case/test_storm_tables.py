"""`[geography]` and `[storm]`: every mistake is found, all at once, with how to mend it."""

from __future__ import annotations

from pathlib import Path

import pytest

import resilience as rs
from resilience.case import case_text, load_case
from resilience.case.checks.geography import geography_findings
from resilience.case.schema import CurveTable, GeographyTable, LineTable, StormTable
from resilience.errors import CaseError, Mistake
from resilience.fragility.chain import case_track, storm
from resilience.fragility.tracks import one_minute
from tests.unit.case.valid import VALID

PLACES = {"1": (22.00, 120.70), "2": (22.01, 120.71), "3": (22.02, 120.72), "4": (22.03, 120.73)}
STORM = """
[storm]
name = "Test"
averaging_s = 600
utc_offset_h = 8
day = 2023-10-05
laid_on = 2016-07-12
points = [
    [2023-10-04T20:00:00, 22.0, 122.0, 930, 54],
    [2023-10-05T02:00:00, 21.9, 121.3, 930, 54],
    [2023-10-05T08:00:00, 21.9, 120.9, 945, 47],
]
"""


def placed(text: str) -> str:
    for name, (lat, lon) in PLACES.items():
        head = f'[[network.bus]]\nname = "{name}"\n'
        text = text.replace(head, f"{head}lat_deg = {lat}\nlon_deg = {lon}\n", 1)
    return text


def mistakes(text: str, folder: Path) -> tuple[Mistake, ...]:
    path = folder / "case.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(CaseError) as caught:
        load_case(path)
    return caught.value.mistakes


def test_a_case_with_places_and_a_storm_loads_and_is_written_alike(tmp_path: Path) -> None:
    path = tmp_path / "case.toml"
    path.write_text(placed(VALID) + STORM, encoding="utf-8")
    case = load_case(path)
    assert case.storm is not None
    assert case.places["3"] == (120.72, 22.02)
    again = tmp_path / "again.toml"
    again.write_text(case_text(case), encoding="utf-8")
    assert load_case(again).equals(case)
    assert not case.replace(storm=None).equals(case)


def test_every_line_in_service_may_fail_unless_the_case_says_otherwise(tmp_path: Path) -> None:
    path = tmp_path / "case.toml"
    path.write_text(placed(VALID) + STORM, encoding="utf-8")
    case = load_case(path)
    assert case.network.breakpoint.tolist() == [True, True, True, True]  # 4-1 is switchable
    text = placed(VALID) + STORM.replace("[storm]", '[storm]\nlines = "breakpoints"')
    path.write_text(text, encoding="utf-8")
    assert load_case(path).network.breakpoint.tolist() == [True, False, False, False]


@pytest.mark.parametrize(
    ("old", "new", "key", "value", "hint"),
    [
        ("averaging_s = 600\n", "", "averaging_s", "nothing", "CMA over 120"),
        ("averaging_s = 600", "averaging_s = 10", "averaging_s", "10", "seconds, not minutes"),
        ("21.9, 121.3", "21.9, 421.3", "points[2][3]", "longitude 421.3", "west is negative"),
        ("21.9, 121.3", "121.3, 21.9", "points[2][2]", "latitude 121.3", "after the time"),
        ("122.0, 930", "122.0, 93000", "points[1][4]", "93000", "hPa"),
        ("10-05T02", "10-05T09", "points[3][1]", "2023-10-05T08:00:00 after", "sort"),
        ("930, 54]", "930, 154]", "points[1][5]", "vmax_mps 154", "knots"),
        ("2023-10-04T20:00:00", "2023-10-04T20:00:00Z", "points[1][1]", "2023", "utc_offset_h"),
        ("21.9, 120.9", "21.9, -120.9", "points[3]", "from the point before", "a sign"),
        ("21.9, 120.9", "21.9, 134.9", "points[3]", "6 h earlier", "exchanged"),
        ("laid_on = 2016-07-12\n", "", "laid_on", "nothing", "stands on"),
        ("laid_on = 2016-07-12", "laid_on = 2016-07-15", "points", "2016-07-14", "whole days"),
        ('name = "Test"', "correlation = 1.5", "correlation", "1.5", ""),
        ('name = "Test"', "hardenning = 2", "hardenning", "an unknown key", "hardening"),
    ],
)  # fmt: skip
def test_one_mistake_in_a_storm(
    old: str, new: str, key: str, value: str, hint: str, tmp_path: Path
) -> None:
    assert old in STORM
    (found,) = mistakes(placed(VALID) + STORM.replace(old, new, 1), tmp_path)
    assert (found.table, found.key) == ("[storm]", key)
    assert value in found.value
    assert hint in found.hint


def test_knots_for_metres_per_second_are_found_by_the_pressure(tmp_path: Path) -> None:
    knots = STORM.replace(", 54]", ", 105]").replace(", 47]", ", 91]")
    (found,) = mistakes(placed(VALID) + knots, tmp_path)
    assert "knots" in found.hint
    assert found.key == "points"


def test_knots_are_told_by_one_minute_winds(tmp_path: Path) -> None:
    """85 m/s at 930 hPa, where 1.4 * 113.4 + 15 = 173.8 kt, 89.4 m/s: 85 / 0.93 are 91.4."""
    text = placed(VALID) + STORM.replace(", 54]", ", 85]").replace("945, 47]", "930, 85]")
    (tmp_path / "case.toml").write_text(text.replace("averaging_s = 600", "averaging_s = 60"))
    assert load_case(tmp_path / "case.toml").storm is not None
    (found,) = mistakes(text, tmp_path)
    assert found.key == "points"
    assert found.value.startswith("85 m/s at 930 hPa in points[")


def test_a_slip_is_found_beside_other_mistakes(tmp_path: Path) -> None:
    bad = STORM.replace("21.9, 120.9", "21.9, -120.9").replace("930, 54", "93000, 54", 1)
    bad = bad.replace("21.9, 121.3, 930, 54", "21.9, 121.3, 930, 105").replace("945, 47", "945, 91")
    found = mistakes(placed(VALID) + bad.replace("averaging_s = 600\n", ""), tmp_path)
    assert [one.key for one in found] == ["averaging_s", "points[1][4]", "points[3]", "points"]


def test_points_are_as_free_as_rows_of_a_file(tmp_path: Path) -> None:
    """Longitudes count on from 180, and what no point says is filled from its neighbours."""
    path = tmp_path / "case.toml"
    text = placed(VALID).replace("lon_deg = 120.7", "lon_deg = 179.7")
    moved = STORM.replace(" 122.0, 930, 54", " 181.0, 930, 54")
    moved = moved.replace("121.3, 930, 54", "180.2, nan, nan").replace("120.9, 945", "179.4, 940")
    path.write_text(text + moved, encoding="utf-8")
    track = case_track(load_case(path))
    assert track.lon == pytest.approx([-179.0, -179.8, 179.4])
    assert track.pressure_hpa == pytest.approx([930.0, 935.0, 940.0])
    assert track.vmax_mps == pytest.approx([54.0, 50.5, 47.0])
    (far,) = mistakes(text + moved.replace("181.0", "400.0"), tmp_path)
    assert (far.key, far.allowed) == ("points[1][3]", "-180 to 360")
    nothing = STORM.replace("930, 54", "nan, nan").replace("945, 47", "nan, nan")
    (none,) = mistakes(placed(VALID) + nothing, tmp_path)
    assert (none.key, none.value) == ("points", "neither pressure nor wind in any point")


def test_all_mistakes_come_in_one_list(tmp_path: Path) -> None:
    text = (
        placed(VALID).replace("lat_deg = 22.01\n", "").replace("lon_deg = 120.73", "lon_deg = 540")
    )
    bad = STORM.replace("averaging_s = 600\n", "").replace("10-05T02", "10-05T09")
    found = mistakes(text + bad, tmp_path)
    said = {(one.table, one.key) for one in found}
    assert said == {
        ("[[network.bus]] 4", "lon_deg"),
        ("[[network.bus]] 2", "lat_deg"),
        ("[geography]", ""),
        ("[storm]", "averaging_s"),
        ("[storm]", "points[3][1]"),
    }
    missing = next(one for one in found if one.table == "[geography]")
    assert missing.value == "1 of 3 buses without coordinates: 2"  # of those that can be read


def test_a_synthetic_geography_needs_an_anchor_and_a_drawing() -> None:
    case = rs.load_case("ieee33")
    with pytest.raises(CaseError) as caught:
        case.replace(geography=GeographyTable(synthetic=True, anchor_bus="34"))
    assert {one.key for one in caught.value.mistakes} == {
        "anchor_lat_deg",
        "anchor_lon_deg",
        "anchor_bus",
    }
    with pytest.raises(CaseError, match="33 of 33 buses without coordinates: 1, 2, 3"):
        case.replace(geography=GeographyTable())
    with pytest.raises(CaseError, match="one of the two"):
        case.replace(geography=GeographyTable(synthetic=True, degrees=True))


def test_a_drawing_is_no_map() -> None:
    case = rs.load_case("ieee33")
    places = dict.fromkeys(case.network.bus_names, (500.0, 22.0))
    asked = GeographyTable(degrees=True)
    (found,) = geography_findings(asked, case.network, places, inline=False, grid_bus="1")
    assert found[0] == "degrees"
    assert "33 buses beyond 180 degrees" in found[1]
    with pytest.raises(CaseError, match="too long for the reactance"):
        case.replace(geography=asked)


def test_names_that_nothing_has_are_refused_together() -> None:
    case = rs.load_case("ieee33_koinu")
    assert isinstance(case.storm, StormTable)
    wrong = {
        "pole": "polle",
        "conductor": "wire",
        "wind": "holland1900",
        "asymmetry": "some",
        "inflow": "much",
        "roughness": "tchazards",
        "rmw": "vickery",
        "curves": {"mine": CurveTable(median_mps=50, averaging_s=3)},
    }
    lines = [*case.line, LineTable(name="2-3", pole="towr")]
    with pytest.raises(CaseError) as caught:
        storm(case.replace(storm=case.storm.model_copy(update=wrong), line=lines))
    found = {(one.table, one.key): one for one in caught.value.mistakes}
    assert found.keys() == {
        ("[storm.curves.mine]", ""),
        ("[[line]] 2-3", "pole"),
        ("[storm]", "inland_km"),
        *(("[storm]", key) for key in wrong if key not in ("curves", "roughness")),
    }
    assert found["[storm]", "pole"].hint == "did you mean pole?"
    assert "mine" in found["[storm]", "conductor"].allowed
    assert "beta" in found["[storm.curves.mine]", ""].value


def test_curves_over_different_winds_do_not_mix() -> None:
    case = rs.load_case("ieee33_koinu")
    assert case.storm is not None
    storm_table = case.storm.model_copy(update={"conductor": "erad-line"})
    with pytest.raises(CaseError, match="curves over a 3 s mean at 10 m over land"):
        storm(case.replace(storm=storm_table))


def test_a_priority_of_a_line_that_is_not_there_is_refused(tmp_path: Path) -> None:
    text = placed(VALID) + STORM + '[storm.repair]\npriority = { "1-2" = 1, "2-9" = 2 }\n'
    (found,) = mistakes(text, tmp_path)
    assert (found.table, found.key, found.value) == ("[storm.repair]", "priority", '"2-9"')


def test_lines_and_curves_of_a_case_survive_writing(tmp_path: Path) -> None:
    head = '[[line]]\nname = "1-2"\n'
    text = placed(VALID).replace(head, f"{head}pole = 'gantry'\nhardening = 1.2\nspan_m = 900\n")
    path = tmp_path / "case.toml"
    curve = "[storm.curves.gantry]\nmedian_mps = 62.0\nbeta = 0.2\naveraging_s = 3\n"
    path.write_text(text + STORM + curve, encoding="utf-8")
    case = load_case(path)
    assert case.line[0].span_m == 900
    again = tmp_path / "again.toml"
    again.write_text(case_text(case), encoding="utf-8")
    assert load_case(again).equals(case)
    assert not case.replace(line=case.line[1:]).equals(case)


def test_a_storm_of_another_day_misses_the_horizon() -> None:
    case = rs.load_case("ieee33_koinu")
    assert case.storm is not None
    moved = case.storm.model_copy(update={"day": None, "laid_on": None, "points": ()})
    with pytest.raises(rs.UsageError, match="misses the horizon"):
        storm(case.replace(storm=moved), case_track(case))


@pytest.mark.parametrize(
    ("points", "hint"),
    [
        # Metres per second made of metres per second, as if they were knots: 54 becomes 27.8.
        (STORM.replace(", 54]", ", 27.8]").replace(", 47]", ", 24.2]"), "nan where"),
        (STORM.replace(", 54]", ", 0]").replace(", 47]", ", 0]"), "nan where"),
    ],
)
def test_winds_too_weak_for_their_pressures_are_a_slip(
    points: str, hint: str, tmp_path: Path
) -> None:
    """930 hPa at 22 N 122 E go with 113.4 kt, 54.3 m/s over ten minutes; 0.55 of it are 29.8."""
    (found,) = mistakes(placed(VALID) + points, tmp_path)
    assert found.key == "points"
    assert found.allowed == "30 m/s or more there; 54 is usual"
    assert hint in found.hint
    weak = STORM.replace(", 54]", ", 33]").replace(", 47]", ", 29]")
    (tmp_path / "case.toml").write_text(placed(VALID) + weak, encoding="utf-8")
    assert load_case(tmp_path / "case.toml").storm is not None


def test_points_are_one_agencys_where_the_case_says_so(tmp_path: Path) -> None:
    """RSMC Tokyo reports 0.60 v + 23.3 kt: 54 m/s are (104.97 - 23.3) / 0.6 = 136.1 kt."""
    path = tmp_path / "case.toml"
    stated = STORM.replace("averaging_s = 600", 'agency = "tokyo"')
    path.write_text(placed(VALID) + stated, encoding="utf-8")
    track = case_track(load_case(path))
    assert (track.averaging_s, track.agency) == (600.0, "tokyo")
    assert one_minute(track).vmax_mps[0] == pytest.approx(136.1 * 0.514444, rel=1e-3)
    plain = placed(VALID) + STORM
    path.write_text(plain, encoding="utf-8")
    assert one_minute(case_track(load_case(path))).vmax_mps[0] == pytest.approx(54.0 / 0.93)
    for wrong, key in (
        (stated.replace("tokyo", "jma"), "agency"),
        (stated.replace("tokyo", "cma") + "averaging_s = 600\n", "averaging_s"),
    ):
        (found,) = mistakes(placed(VALID) + wrong, tmp_path)
        assert found.key == key
