"""The storms that what is built is planned for: that of the case, or a catalogue with rates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.case import Case
from resilience.case.schema import CatalogueTable
from resilience.errors import UsageError
from resilience.fragility.chain import Storm, case_track, file_track, slot_times, storm
from resilience.fragility.coverage import nearest_time
from resilience.fragility.lines.geography import geography
from resilience.fragility.outages.scenarios import Scenarios
from resilience.fragility.tracks.track import Track

SEEDS_OF_STORMS = 1_000_003
"""Apart are the seeds of the storms of a catalogue."""
DAY = np.timedelta64(1, "D")


@dataclass(frozen=True)
class Season:
    """Storms over the horizon of a case, each for itself.

    Attributes:
        storms: each over the same horizon and the same lines.
        share: (storms,) of all storms that come, each is like.
    """

    storms: tuple[Storm, ...]
    share: Floats

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the storms."""
        return tuple(member.track.name for member in self.storms)

    @property
    def lines(self) -> tuple[str, ...]:
        """Lines that the storms may break."""
        return self.storms[0].lines.names

    def split(self, n: int) -> Ints:
        """(storms,) how many of `n` draws each storm has, as many as any other.

        Raises:
            UsageError: fewer draws than storms.
        """
        count = len(self.storms)
        if n < count:
            raise UsageError(
                f"{n} storms; allowed: {count} or more, one for each of the catalogue",
                hint="a hundred of each say how each of them ends",
            )
        return n // count + (np.arange(count) < n % count)

    def storm_of(self, n: int) -> Ints:
        """(draws,) which storm each of `n` draws is of."""
        return np.repeat(np.arange(len(self.storms)), self.split(n))

    def joined(self, draws: Sequence[Scenarios]) -> Scenarios:
        """The draws of all storms, storm by storm, weighted by how often each comes."""
        if len(draws) == 1:
            return draws[0]
        weights = [
            share * scenarios.probability
            for share, scenarios in zip(self.share, draws, strict=True)
        ]
        return replace(
            draws[0],
            down=np.concatenate([scenarios.down for scenarios in draws], axis=2),
            probability=np.concatenate(weights),
            process=f"{len(draws)} storms: {', '.join(self.names)}",
        )


def season_of(case: Case) -> Season:
    """The storm of a case, or those of its `[[plan.storm]]`.

    A storm of the catalogue is laid on the horizon by whole days, so that it is nearest to the
    feeder on the day on which the case's own storm is, or else in the middle of the horizon.

    Raises:
        CaseError, UsageError: as `chain.storm`, or a file with mistakes.
    """
    catalogue = () if case.plan is None else case.plan.storm
    if not catalogue:
        return Season((storm(case),), np.ones(1))
    storms = tuple(storm(case, _laid_on(case, entry)) for entry in catalogue)
    per_year = np.array([entry.per_year for entry in catalogue])
    return Season(storms, per_year / per_year.sum())


def _laid_on(case: Case, entry: CatalogueTable) -> Track | None:
    """The track of a storm of the catalogue, in the days of the case; None: the case's own."""
    if entry.file is None:
        return None
    track = file_track(
        case, entry.file, storm=entry.storm, averaging_s=entry.averaging_s, agency=entry.agency
    )
    place, times = geography(case), slot_times(case)
    when = times[len(times) // 2]
    if case.storm is not None and case.storm.points:
        when = nearest_time(case_track(case), place)
    days = np.round((when - nearest_time(track, place)) / DAY).astype(int)
    return replace(track, time=track.time + days * DAY)
