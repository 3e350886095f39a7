"""From the storm of a case to outages: track, wind at every span, lines, repair, scenarios.

Each arrow is a function of its own module; here a case's tables `[storm]` and `[geography]` choose
among them. A track file takes the place of the storm's own points, and a case without a storm meets
it with the defaults of the table.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import timedelta
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from resilience.arrays import Bools, Floats, Ints
from resilience.case.networks.read import cables
from resilience.case.schema import StormTable
from resilience.errors import CaseError, Mistake, UsageError, together
from resilience.fragility.coverage import check_ends, check_overlap
from resilience.fragility.lines.curves import Curve
from resilience.fragility.lines.damage import Timing, failed_by, hazard
from resilience.fragility.lines.geography import Geography, geography
from resilience.fragility.lines.spans import SpannedLines, SpanWind, calm, span_speed
from resilience.fragility.lines.strength import (
    check_names,
    lines_of,
    storm_curve,
)
from resilience.fragility.outages.crews import case_repair
from resilience.fragility.outages.repair import Repair
from resilience.fragility.outages.scenarios import Scenarios
from resilience.fragility.outages.storms import Sampling, sample_storms
from resilience.fragility.outages.units import with_units
from resilience.fragility.tracks import Track, ensemble, interpolated, read_track, track_of
from resilience.fragility.wind import Wind, wind
from resilience.tolerances import SLOT_TOLERANCE

if TYPE_CHECKING:
    from resilience.case import Case

FINEST_MIN = 5.0  # a slot's wind is the strongest of moments no farther apart


@dataclass(frozen=True, eq=False)
class Storm:
    """A storm over the horizon of a case.

    Attributes:
        case: the case.
        geography: where its lines are.
        track: of the storm, at its own times, UTC.
        members: tracks that are equally likely; `track` alone where it is certain.
        lines: those that the storm may break, in the order of the network.
        winds: (spans, slots) of every member, as the lines' curves want it.
        timing: how winds add up.
        repair: how lines are mended.
    """

    case: Case
    geography: Geography
    track: Track
    members: tuple[Track, ...]
    lines: SpannedLines
    winds: tuple[SpanWind, ...]
    timing: Timing
    repair: Repair

    @cached_property
    def _failed(self) -> tuple[Floats, Floats]:
        """`failed_by`, and (members, lines) the same of every member at the end."""
        by_slot = np.zeros((len(self.lines.names), self.case.slots))
        at_end = np.zeros((len(self.winds), len(self.lines.names)))
        for k, member in enumerate(self.winds):
            of_member = failed_by(self.lines, member, self.timing)
            by_slot += of_member / len(self.winds)
            at_end[k] = of_member[:, -1]
        return by_slot, at_end

    @property
    def failed_by(self) -> Floats:
        """(lines, slots) probability that a line has failed by the end of a slot, none mended."""
        return self._failed[0]

    @property
    def member_failures(self) -> Floats:
        """(members, lines) probability that a line has failed by the end, given the member."""
        return self._failed[1]

    @cached_property
    def hazard(self) -> Floats:
        """(lines, slots) probability that a line that stood until then fails in a slot."""
        if len(self.winds) == 1:
            return hazard(self.lines, self.winds[0], self.timing)
        before = np.pad(self.failed_by, ((0, 0), (1, 0)))[:, :-1]
        chance = np.zeros_like(before)
        return np.divide(self.failed_by - before, 1.0 - before, out=chance, where=before < 1.0)

    @cached_property
    def strongest_mps(self) -> Floats:
        """(lines, slots) strongest wind that a curve sees along each line, the mean of members."""
        mean = np.zeros((len(self.lines.names), self.case.slots))
        for member in self.winds:
            strongest = np.zeros_like(mean)
            np.maximum.at(strongest, self.lines.span_line, span_speed(self.lines, member))
            mean += strongest / len(self.winds)
        return mean

    def calm(self, wind: SpanWind) -> Bools:
        """(lines, slots) True where crews may work in the wind of a member."""
        return calm(self.lines, wind, self.repair.wind_limit_mps)

    def scenarios(self, n: int, seed: int, shift: float = 0.0) -> Scenarios:
        """`n` outage paths; see `storms.sample_storms` for the `shift` of the common factor."""
        return sample_storms(
            self.lines, list(self.winds), n, seed, repair=self.repair, timing=self.timing,
            sampling=Sampling(shift=shift),
        )  # fmt: skip


def storm(
    case: Case, track: Track | Callable[[], Track] | None = None, *, every_line: bool = False
) -> Storm:
    """The storm of a case, over its horizon.

    Args:
        case: the case.
        track: a storm in place of the points of the case's `[storm]`, or what reads it.
        every_line: every line in service but cables, whatever the case says that the storm may
            break.

    Raises:
        CaseError: names that no curve or field has, buses without coordinates, or a track with
            mistakes, or none; all of them are listed.
        UsageError: a track that lies outside the horizon.
    """
    table = case.storm or StormTable()
    _, repair, place, storm_track = together(
        lambda: check_names(case),
        lambda: case_repair(case),
        lambda: geography(case),
        lambda: case_track(case) if track is None else track() if callable(track) else track,
    )
    times = slot_times(case)
    check_overlap(case, storm_track, place, times)
    members = _members(storm_track, table, case)
    names, span_line, spans = _spans(case, place, every_line)
    bearing = place.span_bearing_deg[spans] if table.by_angle else None
    lines = lines_of(case, names, span_line, bearing)
    places = place.span_lat_deg[spans], place.span_lon_deg[spans]
    curve = storm_curve(case)
    winds = tuple(_wind(member, case, places, curve, table, bearing) for member in members)
    check_ends(case, storm_track, times, np.mean([member.speed_mps for member in winds], axis=0))
    chosen = {name: rank for name, rank in repair.priority.items() if name in names}
    repair = replace(repair, priority=chosen)
    timing = Timing(table.mode, case.step_h)
    return Storm(case, place, storm_track, members, lines, winds, timing, repair)


def storm_scenarios(
    case: Case,
    n: int,
    seed: int,
    track: Track | Callable[[], Track] | None = None,
    shift: float = 0.0,
) -> Scenarios:
    """`n` outage paths of the storm of a case, or of another on its feeder.

    Raises:
        CaseError, UsageError: as `storm`.
    """
    return with_units(case, storm(case, track).scenarios(n, seed, shift), seed)


def case_track(case: Case) -> Track:
    """The track that a case states.

    Raises:
        CaseError: points with mistakes, or none.
    """
    table = case.storm
    if table is None or not table.points:
        file, allowed = case.file_name, "points, or a track file"
        hint = "--track FILE reads IBTrACS, HURDAT2, CMA and plain CSV files"
        raise CaseError([Mistake(file, "[storm]", "points", "nothing", allowed, hint)])
    offset = timedelta(hours=table.utc_offset_h)
    time, lat, lon, pressure, vmax = zip(*table.points, strict=True)
    columns: dict[str, Sequence[object]] = {
        "time": [moment - offset for moment in time],
        "lat": lat,
        "lon": lon,
        "pressure_hpa": pressure,
        "vmax_mps": vmax,
    }
    if table.rmw_km is not None:
        columns["rmw_km"] = [table.rmw_km] * len(time)
    return track_of(
        columns, averaging_s=table.averaging_s, agency=table.agency,
        name=table.name, source=table.source,
        basin=table.basin, penv_hpa=table.penv_hpa, rmw=table.rmw, file=case.name,
    )  # fmt: skip


def reader(
    case: Case,
    path: str | Path | None,
    *,
    storm: str | None = None,
    averaging_s: float | None = None,
    agency: str | None = None,
) -> Callable[[], Track] | None:
    """What reads the track in a file, or None without one, for `storm`.

    Raises:
        UsageError: no file, and something said of it.
    """
    if path is not None:
        return lambda: file_track(case, path, storm=storm, averaging_s=averaging_s, agency=agency)
    if (storm, averaging_s, agency) != (None, None, None):
        raise UsageError(
            "the name, averaging time or agency of a storm in a track file, and no file",
            hint="add --track FILE",
        )
    return None


def file_track(
    case: Case,
    path: str | Path,
    *,
    storm: str | None = None,
    averaging_s: float | None = None,
    agency: str | None = None,
) -> Track:
    """The track in a file; what it leaves open is filled as the case's `[storm]` says.

    Args:
        case: the case.
        path: of the file.
        storm: which one, of several.
        averaging_s: of its winds, where it does not say.
        agency: whose winds, of several in the file, or where it does not say.

    Raises:
        CaseError, UsageError: as `tracks.read_track`.
    """
    table = case.storm or StormTable()
    track = read_track(
        path, storm=storm, averaging_s=averaging_s, agency=agency,
        basin=table.basin or None, penv_hpa=table.penv_hpa, rmw=table.rmw,
    )  # fmt: skip
    return track if track.name else replace(track, name=Path(path).stem)


def slot_times(case: Case) -> NDArray[np.datetime64]:
    """(slots * moments,) UTC of the storm at moments within the slots, evenly spaced, rising."""
    table = case.storm or StormTable()
    per_slot = int(np.ceil(case.step_min / FINEST_MIN - SLOT_TOLERANCE))
    first = np.datetime64(table.utc(case.start), "ms")
    middle = (np.arange(case.slots * per_slot) + 0.5) * case.step_min / per_slot
    return (first + np.round(middle * 60_000).astype("timedelta64[ms]")).astype("datetime64[s]")


def _members(track: Track, table: StormTable, case: Case) -> tuple[Track, ...]:
    """The tracks that are equally likely."""
    errors = table.forecast
    if errors.members == 1:
        return (track,)
    issued = table.utc(case.start)
    if errors.issued is not None:
        issued = errors.issued - timedelta(hours=table.utc_offset_h)
    return ensemble(
        track, errors.members, np.random.default_rng(errors.seed), issued=issued,
        along_km_per_day=errors.along_km_per_day, cross_km_per_day=errors.cross_km_per_day,
        intensity_mps=errors.intensity_mps,
    )  # fmt: skip


def _spans(case: Case, place: Geography, every_line: bool) -> tuple[tuple[str, ...], Ints, Ints]:
    """Names of lines, the line of every span of theirs, and the number of that span."""
    network = case.network
    may = network.in_service if every_line or case.storm is None else network.breakpoint
    stands = np.bincount(place.span_line, minlength=len(may)) > 0
    chosen = np.flatnonzero(may & stands & ~cables(network, case.line))
    if not len(chosen):
        raise UsageError(
            f"case {case.name!r} has no line that a storm may break",
            hint='set lines = "all" in [storm], or mark lines with `breakpoint = true`; cables do '
            "not count, by `underground` of [[line]] or by the network file",
        )
    spans = np.flatnonzero(np.isin(place.span_line, chosen))
    names = tuple(network.line_names[k] for k in chosen)
    return names, np.searchsorted(chosen, place.span_line[spans]), spans


def _wind(
    track: Track,
    case: Case,
    places: tuple[Floats, Floats],
    curve: Curve,
    table: StormTable,
    bearing_deg: Floats | None,
) -> SpanWind:
    """The wind in every slot at its hardest moment for each span, as a curve wants it."""
    # A wind field takes its translation from the moment before: the first one needs one, too.
    times = slot_times(case)
    moment_s = round(60.0 * case.step_min * case.slots / len(times))
    earlier = times[:1] - np.timedelta64(moment_s, "s")
    track = interpolated(track, np.concatenate([earlier, times]))
    blown: Wind = wind(
        track, *places, model=table.wind, asymmetry=table.asymmetry, inflow=table.inflow
    ).to(
        averaging_s=curve.averaging_s, height_m=curve.height_m, exposure=curve.exposure,
        roughness=table.roughness, inland_km=table.inland_km,
    )  # fmt: skip
    shape = (len(places[0]), case.slots, -1)
    speed = blown.speed_mps[:, 1:].reshape(shape)
    direction = blown.direction_deg[:, 1:].reshape(shape)
    felt = speed
    if bearing_deg is not None:
        felt = speed * np.abs(np.sin(np.radians(direction - bearing_deg[:, None, None])))
    top = felt.argmax(axis=2)[:, :, None]
    return SpanWind(
        np.take_along_axis(speed, top, axis=2)[:, :, 0],
        blown.averaging_s, blown.height_m, blown.exposure,
        np.take_along_axis(direction, top, axis=2)[:, :, 0],
        None if bearing_deg is None else speed.max(axis=2),
    )  # fmt: skip
