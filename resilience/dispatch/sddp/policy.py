"""The dispatcher: what is known of the next hours, and behind it the cuts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from resilience.arrays import Floats
from resilience.dispatch.memory import Memory
from resilience.dispatch.sddp.blocks import Blocks
from resilience.dispatch.sddp.book import Book, CutSet
from resilience.dispatch.sddp.lookahead import Lookahead, LookaheadRequest
from resilience.dispatch.sddp.model import Cuts, NoiseOutcomes
from resilience.dispatch.sddp.program import StageProgram
from resilience.errors import UsageError
from resilience.models.simulator import MilpSimulator
from resilience.simulation.observation import Observation
from resilience.simulation.setting import CASE, Setting

PATHS = 20


class Sddp:
    """Dispatch by stochastic dual dynamic programming.

    The next hours are a fan of sampled outage paths, as they may come given what is known, and the
    value of what remains behind each of them is that of the cuts. Without paths, the present slot
    alone is decided with the cuts behind it: the policy that the training's bound is about, in a
    tenth of the time, but blind to how long a line has been down. Cut sets are trained on demand,
    see `Book`.

    Args:
        setting: where it acts.
        book: the cut sets; those of the case and of its own outage process if omitted.
        paths: sampled futures of the next hours; 0: the cuts alone.

    Raises:
        UsageError: more than six lines can fail, there is no storage, units are committed or lines
            switched, or the case has a storm on a track, whose hazard no day shares with another.
    """

    def __init__(self, setting: Setting, book: Book | None = None, *, paths: int = PATHS) -> None:
        case = setting.case
        if case.storm is not None or case.blackout is not None:
            once = "a blackout" if case.storm is None else f"the one storm {case.storm.name!r}"
            raise UsageError(
                f"sddp learns days that are alike, and case {case.name!r} has {once}",
                hint="use the dispatcher `stochastic`",
            )
        if isinstance(setting.simulator, MilpSimulator):
            raise UsageError(
                "sddp carries stored energy and fuel alone; allowed: cases without commitment, "
                "ramps, curves and switchable lines",
                hint="use the dispatcher `mpc` or `stochastic`",
            )
        if setting.believed != CASE:
            raise UsageError(
                "sddp learns the case's own process; allowed: a comparison that believes in `case`",
                hint="use the dispatcher `stochastic`, or --believe case",
            )
        self.name, self.setting = "sddp", setting
        self.book = book or Book(case)
        self.fleet = self.book.fleet
        self.memory = Memory(setting, overnight=self.book.bell.overnight)
        self.lines = [case.network.line(name) for name in self.book.lines]
        names = setting.lines
        self._remembered = np.array(
            [names.index(name) if name in names else -1 for name in self.book.lines], np.intp
        )
        self.program = StageProgram(self.fleet.microgrid.stage(case.step_h, may_spill=True))
        self.lookahead = Lookahead(self.book, paths) if paths else None
        self._midnight, self._end = self.book.ends(setting.end_value_per_mwh)

    def cut_set(self, t: int, storm_peak: int) -> CutSet:
        """The cuts of the day of slot t: up to midnight, or to the end of the horizon."""
        clock, remaining = self.memory.clock(t), self.setting.case.slots - t
        if remaining <= self.book.per_day - clock:
            return self.book.cut_set(storm_peak, self._end, clock + remaining)
        return self.book.cut_set(storm_peak, self._midnight)

    def act(self, observation: Observation) -> Floats:
        """The first slot of each scenario's program."""
        self.memory.update(observation)
        levels, energy = self._levels(observation), self.fleet.summed(observation.energy)
        if self.lookahead is None:
            net = self._by_cuts(observation, energy, levels)
        else:
            cut_sets = [self.cut_set(observation.t, int(peak)) for peak in observation.centre]
            decisions = [
                self.lookahead.decide(self._request(observation, k, energy[:, k], levels[k]), cuts)
                for k, cuts in enumerate(cut_sets)
            ]
            net = np.array(decisions).T
        return net[self.fleet.member] * self.fleet.share[:, None]

    def _by_cuts(
        self, observation: Observation, energy: Floats, levels: Sequence[Floats]
    ) -> Floats:
        """(merged units, batch) the present slot of all scenarios, with the cuts of its mode."""
        t, n = observation.t, len(levels)
        clock, scenario_cuts = self.memory.clock(t), []
        for k, scenario_levels in enumerate(levels):
            cut_set = self.cut_set(t, int(observation.centre[k]))
            cuts = cut_set.cuts(clock, ~observation.line_up[self.lines, k])
            constants = cuts.constants(scenario_levels)
            scenario_cuts.append(Cuts(constants, cuts.beta, np.empty((cuts.n, 0))))
        microgrid, now = self.fleet.microgrid, np.array([t])
        situation = microgrid.situation(
            observation.line_up, lambda name: observation.forecast(name, now)[0]
        )
        data = microgrid.data(situation)
        present = NoiseOutcomes(0, np.full(n, 1.0 / n), {k: v[:, :, None] for k, v in data.items()})
        numbered = [(self.program, self.program.numbers(present, 0))]
        cut_owner = np.repeat(np.arange(n), [cuts.n for cuts in scenario_cuts])
        blocks = Blocks(numbered, np.arange(n), Cuts.joined(scenario_cuts), cut_owner)
        z = np.array(blocks.decide(energy.T, np.empty((n, 0))))
        charge, discharge = (self.program.columns(f"ess.{way}") for way in ("charge", "discharge"))
        return (z[:, charge] - z[:, discharge]).T

    def _request(
        self, observation: Observation, k: int, energy: Floats, levels: Floats
    ) -> LookaheadRequest:
        history = self.memory.history(observation, k).of_lines(self._remembered)
        return LookaheadRequest(
            t=observation.t,
            history=history,
            up=observation.line_up[:, k],
            energy=energy,
            levels=levels,
            forecast=observation.forecast_of(k),
        )

    def _levels(self, observation: Observation) -> Sequence[Floats]:
        """(levels,) per scenario: what the forecast says of the rest of the day."""
        case, climate = self.setting.case, self.book.climate
        n, clock = observation.energy.shape[1], self.memory.clock(observation.t)
        ahead = np.arange(min(self.book.per_day - clock, case.slots - observation.t))
        slots = observation.t + ahead
        forecast = np.array([observation.forecast(name, slots) for name in climate.names])
        forecast = forecast.reshape(len(climate.names), len(ahead), n)
        if (forecast == forecast[:, :, :1]).all():  # one fit serves all
            return [climate.fitted(forecast[:, :, 0], clock + ahead)] * n
        return [climate.fitted(forecast[:, :, k], clock + ahead) for k in range(n)]
