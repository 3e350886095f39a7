"""`hazard`: what a storm on its track does to the lines of a feeder, and the islands that follow.

A saved one is a folder that appears whole or not at all; what is in it is `FILES`.
"""

from __future__ import annotations

import csv
from dataclasses import asdict, dataclass
from datetime import datetime, timedelta
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from resilience.arrays import Floats
from resilience.case import Case, load_case
from resilience.case.schema import LoadTable
from resilience.earth.sphere import seen_from
from resilience.fragility import chain
from resilience.fragility.assumptions import assumptions
from resilience.fragility.chain import Storm, slot_times
from resilience.fragility.likely import Likely, likely
from resilience.fragility.outages.scenarios import Scenarios
from resilience.fragility.tracks import interpolated
from resilience.results import HAZARD, replacing, write_readme, write_summary
from resilience.shown import Shown

FILES = {
    "hazard.json": "what `--json` prints",
    "hazard.csv": "probability that a line which stood fails in a slot: a row per slot, a column "
    "per line",
    "failed_by.csv": "probability that it has failed by the end of a slot, none mended; likewise",
    "wind.csv": "m/s, strongest wind along each line in a slot, averaged as its curves want it",
    "lines.csv": "a row per line: km, spans, m/s of its strongest wind, probability that it fails "
    "and its standard error, when it most likely does, hours that it is down on average, and where "
    "it is down at all",
    "loads.csv": "a row per load: MW at its peak, whether it is critical, and without any source "
    "the probability, the mean hours and the mean MWh (dark_...)",
    "outages.npz": "the storms drawn: which line is down when; see resilience.Scenarios",
}
"""What is in every file of a saved hazard."""


@dataclass(frozen=True, eq=False, repr=False)
class Hazard(Shown):
    """A storm's hazard on a feeder.

    Attributes:
        storm: track, wind, lines.
        scenarios: sampled storms with repair.
        likely: islands counted in them.
    """

    storm: Storm
    scenarios: Scenarios
    likely: Likely

    @cached_property
    def distance_km(self) -> Floats:
        """(moments,) from the eye to the middle of the feeder, at `chain.slot_times`."""
        place, case = self.storm.geography, self.storm.case
        eye = interpolated(self.storm.track, slot_times(case))
        lat, lon = place.middle
        away = seen_from((eye.lat, eye.lon), ([lat], [lon]))[0][0] / 1000.0
        return np.where(eye.present, away, np.inf)

    @property
    def closest(self) -> tuple[float, datetime] | None:
        """km of the eye from the feeder when it is closest within the horizon, and when."""
        case = self.storm.case
        moment = int(self.distance_km.argmin())
        if not np.isfinite(self.distance_km[moment]):
            return None
        share = (moment + 0.5) * case.slots / len(self.distance_km)
        when = case.start + timedelta(minutes=share * case.step_min)
        return float(self.distance_km[moment]), when

    @property
    def noise(self) -> float:
        """Standard error of the expected number of failed lines, as members are drawn; 0 of one."""
        return float(standard_error(self.storm.member_failures.sum(axis=1)))

    @cached_property
    def lines(self) -> list[dict[str, Any]]:
        """A row per line; probabilities are exact given the tracks, hours are of sampled storms."""
        here, case = self.storm, self.storm.case
        wind, failed = here.strongest_mps, here.failed_by[:, -1]
        spans = np.bincount(here.lines.span_line, minlength=len(here.lines.names))
        down, weight = self.scenarios.down, self.scenarios.probability
        mean_down = down.sum(axis=1) @ weight * case.step_h
        ever = down.any(axis=1) @ weight
        noise = standard_error(here.member_failures)
        rows = []
        for k, name in enumerate(here.lines.names):
            begins = np.diff(here.failed_by[k], prepend=0.0)
            line = case.network.line(name)
            rows.append(
                {
                    "line": name,
                    "from_bus": case.network.bus_names[case.network.from_bus[line]],
                    "to_bus": case.network.bus_names[case.network.to_bus[line]],
                    "length_km": float(here.geography.length_km[line]),
                    "spans": int(spans[k]),
                    "strongest_wind_mps": float(wind[k].max(initial=0.0)),
                    "failure_probability": float(failed[k]),
                    "standard_error": float(noise[k]),
                    "likeliest": case.slot_label(int(begins.argmax())) if failed[k] else None,
                    "hours_down": float(mean_down[k]),
                    "hours_if_down": float(mean_down[k] / ever[k]) if ever[k] else None,
                }
            )
        return rows

    @cached_property
    def loads(self) -> list[dict[str, Any]]:
        """A row per load, of the sampled storms: how likely and how long it has no source."""
        case, network = self.storm.case, self.storm.case.network
        rows = []
        for load in case.tables_of(LoadTable):
            bus = network.bus(load.bus)
            dark = self.likely.dark_by_slot[bus]
            demand_mw = load.p_max_mw * case.profile(load.profile)
            rows.append(
                {
                    "load": load.name,
                    "bus": load.bus,
                    "p_max_mw": load.p_max_mw,
                    "critical": load.critical,
                    "dark_chance": float(self.likely.dark[bus]),
                    "dark_hours": float(dark.sum() * case.step_h),
                    "dark_mwh": float(dark @ demand_mw * case.step_h),
                }
            )
        return rows

    def summary(self) -> dict[str, Any]:
        """Everything as plain data, slots from the start of the horizon."""
        here, case, closest = self.storm, self.storm.case, self.closest
        wind = here.winds[0]
        east_km, north_km = here.geography.bus_km
        down = self.scenarios.down.sum(axis=0) @ self.scenarios.probability
        return {
            "case": case.name,
            "geography": here.geography.about,
            "synthetic": here.geography.synthetic,
            "storm": here.track.name,
            "source": here.track.source,
            "filled": dict(here.track.filled),
            "members": len(here.members),
            **assumptions(here),
            "start": case.start.isoformat(),
            "step_min": case.step_min,
            "closest_km": closest and closest[0],
            "closest_at": closest and closest[1].isoformat(),
            "wind": f"{wind.averaging_s:g} s mean at {wind.height_m:g} m over {wind.exposure}",
            "strongest_wind_mps": float(here.strongest_mps.max(initial=0.0)),
            "expected_lines_down": float(here.failed_by[:, -1].sum()),
            "expected_lines_down_standard_error": self.noise,
            "lines": self.lines,
            "hazard": dict(zip(here.lines.names, here.hazard.tolist(), strict=True)),
            "failed_by": dict(zip(here.lines.names, here.failed_by.tolist(), strict=True)),
            "wind_mps": dict(zip(here.lines.names, here.strongest_mps.tolist(), strict=True)),
            "lines_down": down.tolist(),
            "scenarios": self.scenarios.n,
            "seed": self.scenarios.seed,
            "process": self.scenarios.process,
            "loads": self.loads,
            "islands": [asdict(island) for island in self.likely.islands],
            "islandings": [asdict(islanding) for islanding in self.likely.islandings],
            "buses": {
                name: {
                    "apart": apart, "dark": dark, "dark_hours": hours, "east_km": x, "north_km": y
                }
                for name, apart, dark, hours, x, y in zip(
                    case.network.bus_names, self.likely.apart.tolist(), self.likely.dark.tolist(),
                    (case.step_h * self.likely.dark_by_slot.sum(axis=1)).tolist(),
                    east_km.tolist(), north_km.tolist(), strict=True,
                )
            },
        }  # fmt: skip

    def save(self, folder: str | Path) -> Path:
        """Writes the folder; an earlier one is replaced, anything else is refused.

        Raises:
            UsageError: the folder holds something else.
            FileError: the system refuses, as where a disk is full.
        """
        with replacing(Path(folder), HAZARD) as target:
            write_summary(target, HAZARD, self.summary())
            here = self.storm
            series = {
                "hazard": here.hazard,
                "failed_by": here.failed_by,
                "wind": here.strongest_mps,
            }
            for name, values in series.items():
                self._series(target / f"{name}.csv", values)
            for name, rows in (("lines", self.lines), ("loads", self.loads)):
                _rows(target / f"{name}.csv", rows)
            self.scenarios.save(target / "outages.npz")
            write_readme(target, HAZARD, FILES)
        return Path(folder)

    def _series(self, path: Path, values: Floats) -> None:
        case = self.storm.case
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(["time", *self.storm.lines.names])
            for t in range(case.slots):
                when = case.window.time(t).isoformat()
                writer.writerow([when, *(f"{value:.9g}" for value in values[:, t])])


def standard_error(values: Floats) -> Floats:
    """(...) of the mean of equally likely draws (draws, ...); 0 where there is one draw."""
    draws = len(values)
    return values.std(axis=0, ddof=1) / np.sqrt(draws) if draws > 1 else np.zeros(values.shape[1:])


def _rows(path: Path, rows: list[dict[str, Any]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]) if rows else [])
        writer.writeheader()
        writer.writerows(rows)


def hazard(
    case: Case | str | Path,
    track: str | Path | None = None,
    *,
    storm: str | None = None,
    averaging_s: float | None = None,
    agency: str | None = None,
    n: int = 1000,
    seed: int = 0,
) -> Hazard:
    """What a storm does to every line of a feeder that is in service.

    Args:
        case: a case, its file, or the name of an installed one.
        track: file of the storm; the case's own if omitted.
        storm: which one, of several in the file.
        averaging_s: of the file's winds, where it does not say.
        agency: whose winds, of several in the file, or where it does not say.
        n: storms drawn, for islands.
        seed: of these.

    Raises:
        CaseError: mistakes in the case, its geography or the track; all of them are listed.
        UsageError: as `chain.storm`, or something said of a track file that is not given.
    """
    case = case if isinstance(case, Case) else load_case(case)
    read = chain.reader(case, track, storm=storm, averaging_s=averaging_s, agency=agency)
    case_storm = chain.storm(case, read, every_line=True)
    drawn = case_storm.scenarios(n, seed)
    return Hazard(case_storm, drawn, likely(case, drawn))
