"""Make cases/profiles/simbench_jul_aug.csv.gz from the tables in the simbench package.

Run from anywhere, no network needed:  pip install -e ".[data]" && python scripts/make_profiles.py

The result is the same byte for byte on every run, so a change of it shows in `git diff`.
"""

import gzip
import io
from importlib.util import find_spec
from pathlib import Path

import pandas as pd

TABLES = Path("networks") / "1-complete_data-mixed-all-0-sw"
TARGET = Path(__file__).parents[1] / "cases" / "profiles" / "simbench_jul_aug.csv.gz"

PV = [f"PV{i}" for i in range(1, 9)]
# No two of these correlate by more than 0.84 in July and August, and every one is plausible as a
# load of 0.2 to 1.2 MW: whole low-voltage feeders (lv_*) and the larger customers.
LOAD = [
    "lv_rural1",  # village with farms
    "lv_semiurb4",  # suburb with shops
    "lv_semiurb5",  # suburb, mostly homes
    "H0-H",  # households, large aggregate
    "G0-M",  # commerce in general
    "G2-A",  # commerce with an evening peak
    "G3-H",  # commerce around the clock, large
    "G3-M",  # commerce around the clock
    "G4-M",  # shops
    "WB-H",  # large customer on working days
    "L0-A",  # farm
    "L2-M",  # farm, medium voltage
]


def table(name: str, columns: dict[str, str]) -> pd.DataFrame:
    """Read July and August 2016 of a SimBench table; `columns` maps its names to ours."""
    spec = find_spec("simbench")
    if spec is None or not spec.submodule_search_locations:
        raise SystemExit('error: simbench is not installed\nhint: pip install -e ".[data]"')
    path = Path(spec.submodule_search_locations[0]) / TABLES / f"{name}.csv"
    frame = pd.read_csv(path, sep=";", usecols=["time", *columns])
    frame.index = pd.DatetimeIndex(pd.to_datetime(frame.pop("time"), format="%d.%m.%Y %H:%M"))
    return frame[frame.index.month.isin([7, 8])].rename(columns=columns)


def extract() -> pd.DataFrame:
    """Return the twenty columns, each scaled to a maximum of 1 over the two months."""
    solar = table("RESProfile", {name: name for name in PV})[PV]
    load = table("LoadProfile", {f"{name}_pload": name for name in LOAD})[LOAD]
    frame = pd.concat([solar, load], axis=1)
    expected = pd.date_range("2016-07-01", "2016-08-31 23:45", freq="15min")
    if not frame.index.equals(expected) or not (frame >= 0).all(axis=None):
        raise SystemExit("error: the SimBench tables have gaps, NaN or negative values")
    return frame / frame.max()


def write(frame: pd.DataFrame, path: Path) -> None:
    """Write the frame as gzipped CSV without a time stamp or file name in the header."""
    frame.index = pd.Index(frame.index.strftime("%Y-%m-%dT%H:%M:%S"), name="time")
    text = frame.to_csv(float_format="%.4f", lineterminator="\n")
    buffer = io.BytesIO()
    with gzip.GzipFile(filename="", mode="wb", compresslevel=9, fileobj=buffer, mtime=0) as file:
        file.write(text.encode())
    path.write_bytes(buffer.getvalue())


if __name__ == "__main__":
    write(extract(), TARGET)
    print(f"wrote {TARGET} ({TARGET.stat().st_size / 1000:.0f} kB)")
