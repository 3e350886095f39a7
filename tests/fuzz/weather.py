"""Kinds of files that tracks and networks come in."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st

import resilience as rs
from resilience.case import new_case_text
from resilience.fragility.tracks import Track, read_track
from tests.fuzz.cases import sound_case
from tests.fuzz.changes import bytes_changed, data_changed, table_changed, words_changed
from tests.fuzz.kinds import Files, Kind
from tests.unit.fragility.tracks.test_readers import CMA, HURDAT2, IBTRACS, PLAIN
from tests.unit.fragility.tracks.test_unread import A_DECK, B_DECK, F_DECK

TRACK = "track.txt"


def sound_track(track: Track) -> None:
    assert (np.diff(track.time) > np.timedelta64(0)).all()
    for values in (track.lat, track.lon, track.vmax_mps, track.pressure_hpa, track.rmw_km):
        assert np.isfinite(values).all()
    assert (np.abs(track.lat) <= 90.0).all()
    assert (np.abs(track.lon) <= 180.0).all()
    assert ((track.vmax_mps >= 0.0) & (track.vmax_mps < 150.0)).all()


def track_kind(text: str, storm: str | None, change: st.SearchStrategy[bytes]) -> Kind:
    return Kind(
        lambda: {TRACK: text.encode()},
        lambda _: change.map(lambda data: {TRACK: data}),
        lambda folder: read_track(folder / TRACK, storm=storm),
        sound_track,
        TRACK,
    )


WEATHER = {
    "track, IBTrACS": track_kind(IBTRACS, "KOINU", table_changed(IBTRACS)),
    "track, HURDAT2": track_kind(HURDAT2, "HARVEY", table_changed(HURDAT2)),
    "track, CMA": track_kind(CMA, "1409", words_changed(CMA)),
    "track, CSV": track_kind(PLAIN, None, table_changed(PLAIN)),
}


def no_track(track: Track) -> None:
    raise AssertionError(f"read as a track of {len(track.time)} points")


def unread_kind(text: str) -> Kind:
    return Kind(
        lambda: {TRACK: text.encode()},
        lambda _: table_changed(text).map(lambda data: {TRACK: data}),
        lambda folder: read_track(folder / TRACK),
        no_track,
        TRACK,
        unchanged="refused",
    )


WEATHER |= {"track, ATCF": unread_kind(A_DECK + B_DECK), "track, ATCF fixes": unread_kind(F_DECK)}

MATPOWER = """\
function mpc = feeder
mpc.version = '2';
mpc.baseMVA = 10;
mpc.bus = [
  1 3 0 0 0 0 1 1 0 11 1 1.1 0.9;
  2 1 0.4 0.1 0 0 1 1 0 11 1 1.1 0.9; % a comment
  3 1 0.3 0.2 0 0 1 1 0 11 1 1.1 0.9;
];
mpc.gen = [
  1 0 0 10 -10 1 100 1 10 0;
  3 0 0 1 -1 1 100 1 1.5 0;
];
mpc.branch = [
  1 2 0.01 0.02 0 5 0 0 0 0 1 -360 360;
  2 3 0.02 0.03 0 0 0 0 0 0 1 -360 360;
];
mpc.genfuel = {
  'ng';
  'solar'; % a comment
};
Vbase = mpc.bus(1, BASE_KV) * 1e3;
Sbase = mpc.baseMVA * 1e6;
mpc.branch(:, [BR_R BR_X]) = mpc.branch(:, [BR_R BR_X]) / (11^2 / 10) * 2;
"""


def read_network(folder: Path, name: str) -> rs.Case:
    """A starter case of a network file, and the case that it is."""
    path = folder / "made.toml"
    path.write_text(new_case_text(str(folder / name)), encoding="utf-8")
    return rs.load_case(path)


@cache
def pandapower_file() -> dict[str, Any]:
    """Data of a file of pandapower, its tables unpacked."""
    import pandapower as pp
    from pandapower.networks import example_simple

    net = example_simple()
    pp.create_storage(net, 6, 0.2, max_e_mwh=0.8)
    net.storage["efficiency_percent"] = 0.95
    data: dict[str, Any] = json.loads(pp.to_json(net))
    for table in data["_object"].values():
        if isinstance(table, dict) and isinstance(table.get("_object"), str):
            table["_object"] = json.loads(table["_object"])
    data["_object"] |= GEODATA
    return data


def frame(columns: list[str], rows: list[list[Any]]) -> dict[str, Any]:
    body = {"columns": columns, "index": list(range(len(rows))), "data": rows}
    return {"_module": "pandas.core.frame", "_class": "DataFrame", "_object": body}


GEODATA = {
    "bus_geodata": frame(["x", "y"], [[110.4, 21.2], [110.5, 21.3]]),
    "line_geodata": frame(["coords"], [[[[110.4, 21.2], [110.5, 21.3]]]]),
}
"""Tables of files before pandapower 3."""


TABLES = (
    "bus", "line", "load", "sgen", "gen", "ext_grid", "switch", "trafo", "shunt", "storage",
    "bus_geodata", "line_geodata",
)  # fmt: skip


@st.composite
def pandapower_changed(draw: st.DrawFn) -> bytes:
    """A file of pandapower with other data in its tables, or other bytes."""
    data = pandapower_file()
    tables = {name: data["_object"][name] for name in TABLES}
    name = draw(st.sampled_from(TABLES))
    changed = {**tables, name: draw(data_changed(tables[name]))}
    if draw(st.integers(0, 5)) == 0:
        changed = draw(data_changed(changed))
    entries = {**data["_object"], **changed} if isinstance(changed, dict) else changed
    text = json.dumps({**data, "_object": entries}, default=str).encode()
    return draw(bytes_changed(text)) if draw(st.integers(0, 5)) == 0 else text


def pandapower_base() -> Files:
    return {"net.json": json.dumps(pandapower_file()).encode()}


WEATHER |= {
    "MATPOWER": Kind(
        lambda: {"net.m": MATPOWER.encode()},
        lambda _: words_changed(MATPOWER).map(lambda data: {"net.m": data}),
        lambda folder: read_network(folder, "net.m"),
        sound_case,
    ),
    "pandapower": Kind(
        pandapower_base,
        lambda _: pandapower_changed().map(lambda data: {"net.json": data}),
        lambda folder: read_network(folder, "net.json"),
        sound_case,
        slow=True,
    ),
}
