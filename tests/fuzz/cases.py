"""Kinds of files that describe a case: TOML, profiles, outages, scenarios, networks, measured."""

from __future__ import annotations

import gzip
import io
import json
import tomllib
from collections.abc import Callable
from datetime import datetime, timedelta
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import tomli_w
from hypothesis import strategies as st

import resilience as rs
from resilience.case import parse_outages
from resilience.case.document import Document
from resilience.case.load import build_case
from resilience.case.measured.series import Measured, read_measured
from resilience.cli.train import _seconds, _seeds, _settings
from resilience.evaluation.compare import parse_error
from resilience.fragility.outages.files import load_scenarios
from resilience.models.program.risk import Risk
from resilience.simulation.forecast import ForecastError
from resilience.text.console import plain_console
from resilience.text.plan import print_case
from tests.fuzz.changes import (
    arrays_changed,
    bytes_changed,
    data_changed,
    parquet_changed,
    table_changed,
    words_changed,
)
from tests.fuzz.full_case import dark_case, stormy_case
from tests.fuzz.kinds import Files, Kind, one_file
from tests.unit.case.valid import VALID

CASE_FILE = "case.toml"


@st.composite
def case_changed(draw: st.DrawFn, sound: dict[str, Any]) -> bytes:
    """A case file with other data, or other bytes."""
    data = draw(data_changed(sound, times=True))
    try:
        text = tomli_w.dumps(data).encode()
    except (TypeError, ValueError, RecursionError, UnicodeEncodeError):
        text = tomli_w.dumps(sound).encode()
        return draw(bytes_changed(text))
    return draw(bytes_changed(text)) if draw(st.integers(0, 4)) == 0 else text


def sound_case(case: rs.Case) -> None:
    """A case whose numbers are numbers, and that can be printed."""
    assert 1 <= case.slots <= 1_000_000
    assert case.window.stop > case.start
    assert all(np.isfinite(values).all() for values in case.profiles.values())
    network = case.network
    for values in (network.r_pu, network.x_pu, network.vn_kv, network.v_min_pu, network.v_max_pu):
        assert np.isfinite(values).all()
    assert (network.vn_kv > 0).all()
    assert (network.r_pu >= 0).all()
    assert (network.rating_mva > 0).all()
    assert all(0 <= outage.first < outage.stop <= case.slots for outage in case.outages)
    print_case(case, plain_console(file=io.StringIO(), width=100))


def load(folder: Path) -> rs.Case:
    return rs.load_case(folder / CASE_FILE)


def case_kind(sound: dict[str, Any]) -> Kind:
    return Kind(
        lambda: {CASE_FILE: tomli_w.dumps(sound).encode()},
        lambda _: case_changed(sound).map(lambda data: {CASE_FILE: data}),
        load,
        sound_case,
        CASE_FILE,
    )


CASES = {"case": case_kind(stormy_case()), "case in the dark": case_kind(dark_case())}

STAMPS = [datetime(2016, 7, 12) + timedelta(minutes=15 * k) for k in range(12)]
COLUMNS = {name: [round(0.3 + k * step, 4) for k in range(12)]
           for name, step in (("homes", 0.05), ("sun", 0.03), ("price", 0.11))}  # fmt: skip
PROFILE_ROWS = zip(STAMPS, *COLUMNS.values(), strict=True)
PROFILE_TEXT = "\n".join(["time,homes,sun,price", *(",".join(map(str, r)) for r in PROFILE_ROWS)])


def with_profiles(name: str) -> bytes:
    data = tomllib.loads(VALID)
    data["profiles"] = {"file": name}
    return tomli_w.dumps(data).encode()


def parquet() -> bytes:
    file = io.BytesIO()
    pq.write_table(pa.table({"time": pa.array(STAMPS, pa.timestamp("ns")), **COLUMNS}), file)
    return file.getvalue()


def packed(data: bytes) -> bytes:
    return gzip.compress(data, mtime=0)


@st.composite
def packed_changed(draw: st.DrawFn) -> bytes:
    """A packed file with other bytes, or of a changed table."""
    if draw(st.booleans()):
        return draw(bytes_changed(packed(PROFILE_TEXT.encode())))
    return packed(draw(table_changed(PROFILE_TEXT)))


def profile_kind(name: str, data: bytes, change: st.SearchStrategy[bytes]) -> Kind:
    return Kind(
        lambda: {CASE_FILE: with_profiles(name), name: data},
        lambda _: change.map(lambda changed: {name: changed}),
        load,
        sound_case,
        name.split(".", maxsplit=1)[0],
    )


CASES |= {
    "profiles.csv": profile_kind("p.csv", PROFILE_TEXT.encode(), table_changed(PROFILE_TEXT)),
    "profiles.csv.gz": profile_kind("p.csv.gz", packed(PROFILE_TEXT.encode()), packed_changed()),
    "profiles.parquet": profile_kind("p.parquet", parquet(), parquet_changed(parquet())),
}

SMALL = VALID.encode()
OUTAGES = (
    "line,start,stop\n1-2,00:15,00:45\n2-3,2016-07-12T00:30,2016-07-12T01:00\n3-4,00:00,d1 00:30\n"
)
OUTAGE_TEXT = "1-2@00:15-00:45, 2-3@d1 00:30-2016-07-12T01:00;3-4@00:00-00:30"
SCENARIOS = (
    "scenario,line,first,stop,weight\n0,1-2,1,3,2.5\n0,2-3,0,2,2.5\n1,3-4,2,4,1.25\n2,,,,0.5\n"
)


@cache
def small_case() -> rs.Case:
    """The case that outages and scenarios are of."""
    return build_case(Document(None, tomllib.loads(VALID)))


def sound_outages(outages: Any) -> None:
    assert all(0 <= outage.first < outage.stop <= 4 for outage in outages)
    assert all(small_case().network.has_line(outage.line) for outage in outages)


def sound_scenarios(scenarios: rs.Scenarios) -> None:
    assert scenarios.slots == 4
    assert len(set(scenarios.lines)) == len(scenarios.lines)
    assert np.isclose(scenarios.probability.sum(), 1.0)
    assert scenarios.down.dtype == bool
    assert isinstance(scenarios.process, str)
    scenarios.events()
    scenarios.chosen([0])


def scenario_arrays() -> dict[str, np.ndarray]:
    down = np.zeros((2, 4, 3), bool)
    down[0, 1:3, 0] = down[1, 2:, 1] = True
    about = {"lines": ["1-2", "2-3"], "seed": 5, "process": "by hand"}
    return {
        "down": np.packbits(down, axis=None),
        "shape": np.array(down.shape),
        "probability": np.array([0.5, 0.2, 0.3]),
        "about": np.array(json.dumps(about)),
        "centre": np.array([[30, 40, 50]]),
    }


def npz(arrays: dict[str, np.ndarray]) -> bytes:
    file = io.BytesIO()
    np.savez(file, **arrays)  # type: ignore[arg-type]
    return file.getvalue()


CASES |= {
    "outages.csv": Kind(
        lambda: {"outages.csv": OUTAGES.encode()},
        lambda _: table_changed(OUTAGES).map(lambda data: {"outages.csv": data}),
        lambda folder: parse_outages(folder / "outages.csv", small_case()),
        sound_outages,
        "outages.csv",
    ),
    "scenarios.csv": Kind(
        lambda: {"scenarios.csv": SCENARIOS.encode()},
        lambda _: table_changed(SCENARIOS).map(lambda data: {"scenarios.csv": data}),
        lambda folder: load_scenarios(folder / "scenarios.csv", small_case()),
        sound_scenarios,
        "scenarios.csv",
    ),
    "scenarios.npz": Kind(
        lambda: {"scenarios.npz": npz(scenario_arrays())},
        lambda _: arrays_changed(scenario_arrays(), "about").map(
            lambda data: {"scenarios.npz": data}
        ),
        lambda folder: load_scenarios(folder / "scenarios.npz", small_case()),
        sound_scenarios,
        "scenarios.npz",
    ),
}


OPTIONS: dict[str, tuple[str, Callable[[str], Any]]] = {
    "forecast error": ("0.025,0.97", parse_error),
    "risk": ("cvar:0.95:0.5", Risk.parse),
    "seeds": ("0, 1,22", _seeds),
    "budget": ("120.5s", _seconds),
    "setting": ("hidden=[64, 64]", lambda text: _settings([text])),
}
"""How an option is written, and who reads it."""


def sound_option(option: Any) -> None:
    if isinstance(option, list):
        assert all(0 <= seed < 10**19 for seed in option)
    elif isinstance(option, float):
        assert 0.0 < option < 1e6
    elif isinstance(option, Risk):
        assert 0.0 <= option.weight <= 1.0
        assert 0.0 <= option.alpha < 1.0
    elif isinstance(option, ForecastError):
        assert 0.0 <= option.sigma <= 1.0
        assert 0.0 <= option.correlation < 1.0


def words_kind(text: str, read: Callable[[str], Any], sound: Callable[[Any], object]) -> Kind:
    return Kind(
        lambda: {"words": text.encode()},
        one_file("words", lambda data: words_changed(data.decode())),
        lambda folder: read((folder / "words").read_bytes().decode("utf-8", "replace")),
        sound,
    )


CASES["outages in words"] = words_kind(
    OUTAGE_TEXT, lambda text: parse_outages(text, small_case()), sound_outages
)
CASES |= {
    f"{name} in words": words_kind(text, read, sound_option)
    for name, (text, read) in OPTIONS.items()
}


def sound_measured(measured: Measured) -> None:
    for values in measured.mw.values():
        assert np.isfinite(values).all()
        assert (values >= 0).all()
    assert len(measured.times) == len(measured.mw["load"])


def measured_kind(texts: tuple[str, ...], area: str | None, separator: str) -> Kind:
    names = [f"m{k}.csv" for k in range(len(texts))]

    def changes(files: Files) -> st.SearchStrategy[Files]:
        return st.sampled_from(names).flatmap(
            lambda name: table_changed(files[name].decode(), separator).map(lambda d: {name: d})
        )

    return Kind(
        lambda: {name: text.encode() for name, text in zip(names, texts, strict=True)},
        changes,
        lambda folder: read_measured([folder / name for name in names], area=area),
        sound_measured,
    )


def measured_kinds() -> dict[str, Kind]:
    from tests.unit.case.test_measured import SHAPES, areas

    return {
        f"measured, {shape}": measured_kind(texts, areas(shape), "\t" if shape == "bulk" else ",")
        for shape, texts in SHAPES.items()
        if shape != "mixed"
    }


CASES |= measured_kinds()
