"""The cut sets of a case: one per bin of storm peaks, trained when it is first needed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from resilience.arrays import Bools, Floats, rounded
from resilience.case import Case
from resilience.case.schema import LoadTable
from resilience.dispatch.end_value import stored_energy_value
from resilience.dispatch.sddp.cache import cache_folder, digest, load, save
from resilience.dispatch.sddp.chain import ModeChain, storm_chain
from resilience.dispatch.sddp.days import fitted_climate, past_days
from resilience.dispatch.sddp.model import Cuts, Multistage
from resilience.dispatch.sddp.storm import Fleet, day_program, price_profiles
from resilience.dispatch.sddp.training import Begin, Settings, Trained, train
from resilience.errors import FileError, UsageError
from resilience.fragility.outages.bell import Bell, case_bell
from resilience.progress import log

MAX_LINES = 6  # that can fail: modes are their subsets, 64 then
BIN_SLOTS = 8  # of 15 minutes: peaks that one cut set serves, where the case names none
OUTCOMES = 2  # of the noise in every slot
TERMINAL_DIGITS = 7  # in which worths of energy agree that share their cuts
SETTINGS = Settings(iterations=14, paths=2, tidy=7)


@dataclass(frozen=True)
class CutSet:
    """Future costs for one bin of storm peaks.

    Attributes:
        storm_peaks: slots of 15 minutes in which the storm may peak.
        chain: the modes that the cuts belong to.
        multistage: the day that they were trained on.
        trained: the cuts.
    """

    storm_peaks: tuple[int, ...]
    chain: ModeChain
    multistage: Multistage
    trained: Trained

    def cuts(self, t: int, down: Bools) -> Cuts:
        """The future cost behind slot t of the day while these lines are down, (lines,)."""
        return self.trained.cuts[t][self.chain.mode(t, down)]


class Book:
    """Cut sets of a case, made on demand and kept on disk.

    Args:
        case: the case; test days are left out of what load and PV are learnt from.
        bell: the outage process that the cuts are for; the case's own if omitted.
        outcomes: of the noise in every slot.
        settings: of the training.
        cache: folder of the files; True: the user's, see `cache_folder`; False: none is kept.

    Raises:
        UsageError: more than six lines can fail, or there is no storage.
    """

    def __init__(
        self,
        case: Case,
        bell: Bell | None = None,
        *,
        outcomes: int = OUTCOMES,
        settings: Settings = SETTINGS,
        cache: Path | bool = True,
    ) -> None:
        self.case, self.bell, self.settings = case, bell or case_bell(case), settings
        self.folder = cache_folder() if cache is True else (cache or None)
        marked = zip(case.network.line_names, case.network.breakpoint, strict=True)
        self.lines = tuple(name for name, breaks in marked if breaks)
        _check_case(case, self.lines)
        self.per_day = case.window.slots_per_day
        self.fleet = Fleet.of_case(case)
        self.climate = fitted_climate(past_days(case), outcomes)
        offset = case.window.slots_before_start
        self.prices = price_profiles(case, self.climate.names, self.per_day, offset)
        self.start: Floats = self.fleet.microgrid.start()["ess.energy"]
        self._cut_sets: dict[tuple[object, ...], CutSet] = {}

    def storm_peaks(self, forecast: int) -> tuple[int, ...]:
        """Peaks that are possible with one forecast, -1 for none: those near the forecast's bin."""
        usual, error = self.bell.centre_slots(), self.bell.centre_error_slots
        if forecast < 0:
            return tuple(usual.tolist())
        if error == 0 and forecast in self.bell.centres:
            return (forecast,)
        low = forecast // BIN_SLOTS * BIN_SLOTS
        near = usual[(usual >= low - error) & (usual < low + BIN_SLOTS + error)]
        return tuple(near.tolist()) or tuple(range(low, low + BIN_SLOTS))

    def ends(self, end_value_per_mwh: float) -> tuple[Floats, Floats]:
        """(merged units,) $ per MWh stored at a midnight within the horizon, and at its end.

        From prices alone, see `stored_energy_value`; the mean over midnights.
        """
        worth = stored_energy_value(self.case, end_value_per_mwh)
        first_units = [int(np.argmax(self.fleet.member == k)) for k in range(self.fleet.n)]
        unit_worth = worth[first_units]
        first = self.case.window.slots_before_start
        midnights = np.arange(self.per_day - first, self.case.slots, self.per_day)
        at_midnight = unit_worth[:, midnights if len(midnights) else [-1]]
        return at_midnight.mean(axis=1), unit_worth[:, -1]

    def cut_set(self, storm_peak: int, terminal: Floats, stop: int | None = None) -> CutSet:
        """The cuts of a day.

        Args:
            storm_peak: slot of 15 minutes at which the hazard is forecast to peak; -1: unknown.
            terminal: (merged units,) $ per MWh stored at the end.
            stop: number of slots; a whole day if omitted.
        """
        peaks, stop = self.storm_peaks(storm_peak), stop or self.per_day
        terminal = rounded(terminal, TERMINAL_DIGITS)
        key = (peaks, tuple(terminal.tolist()), stop)
        if key not in self._cut_sets:
            chain = storm_chain(self.bell, len(self.lines), np.array(peaks), self.per_day)
            multistage = day_program(
                self.fleet, self.lines, chain, self.climate, self.prices, terminal, stop
            )
            self._cut_sets[key] = CutSet(peaks, chain, multistage, self._trained(multistage))
        return self._cut_sets[key]

    @property
    def probes(self) -> Sequence[Begin]:
        """The case's own start, on every day that was learnt from."""
        return [(self.start, levels) for levels in self.climate.levels]

    def _trained(self, multistage: Multistage) -> Trained:
        if self.folder is None:
            return train(multistage, self._begin, self.probes, self.settings)
        facts = [*self.fleet.band, self.start, self.climate.levels]
        key = digest(multistage, facts, self.settings)
        path = self.folder / f"{key[:32]}.npz"
        trained = load(path, key)
        if trained is None:
            trained = train(multistage, self._begin, self.probes, self.settings)
            try:
                save(path, key, trained)
            except FileError as error:  # the cuts are there for this run all the same
                log.info(f"cuts are not kept: {error.message}")
        return trained

    def _begin(self, rng: np.random.Generator, last: Floats | None) -> Begin:
        """A day that was learnt from; energy anywhere in the band, or as the last path ended."""
        levels = self.climate.levels[rng.integers(len(self.climate.levels))]
        drawn, carried = rng.uniform(*self.fleet.band), rng.random() < 0.5
        return (last if carried and last is not None else drawn), levels


def _check_case(case: Case, lines: Sequence[str]) -> None:
    if len(lines) > MAX_LINES:
        raise UsageError(
            f"sddp: case {case.name!r} has {len(lines)} breakpoints; allowed: up to {MAX_LINES}",
            hint="`stochastic` samples outages instead of listing their combinations",
        )
    if case.fallible_units:
        names = ", ".join(case.fallible_units)
        raise UsageError(
            f"sddp: in case {case.name!r} {names} may fail; allowed: lines that do, its modes know "
            "no units",
            hint="use the dispatcher `stochastic`",
        )
    cold = [load.name for load in case.tables_of(LoadTable) if load.cold_load_share]
    if cold:
        raise UsageError(
            f"sddp: {', '.join(cold)} of case {case.name!r} return with a surplus; allowed: loads "
            "without cold_load_share, its cuts know no backlog",
            hint="`mpc` and `stochastic` carry it",
        )
    if case.tank:
        names = ", ".join(tank.name for tank in case.tank)
        raise UsageError(
            f"sddp: case {case.name!r} has the tanks {names}; allowed: none, its cuts know no fuel",
            hint="`mpc` and `stochastic` carry fuel",
        )
    if not case.ess:
        raise UsageError(
            f"sddp: case {case.name!r} has no storage; allowed: one unit or more",
            hint="without storage nothing is carried into the future; use `idle`",
        )
