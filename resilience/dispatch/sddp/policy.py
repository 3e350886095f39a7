"""The dispatcher: what is known of the next hours, and behind it the cuts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.dispatch.memory import Memory
from resilience.dispatch.sddp.blocks import Blocks
from resilience.dispatch.sddp.book import Book, CutSet
from resilience.dispatch.sddp.lookahead import Asked, Lookahead
from resilience.dispatch.sddp.model import Cuts, NoiseOutcomes
from resilience.dispatch.sddp.program import StageProgram
from resilience.errors import UsageError
from resilience.fragility.beliefs.conditional import LineHistory
from resilience.simulation.observation import Observation
from resilience.simulation.world import World

PATHS = 20


class Sddp:
    """Dispatch by stochastic dual dynamic programming.

    The next hours are a fan of sampled outage paths, as they may come given what is known, and the
    value of what is left behind each of them is that of the cuts. Without paths, the present slot
    alone is decided with the cuts behind it: the policy that the training's bound is about, in a
    tenth of the time, but blind to how long a line has been down. Cut sets are trained on demand,
    see `Book`.

    Args:
        world: where it acts.
        book: the cut sets; those of the case and of its own outage process if omitted.
        paths: sampled futures of the next hours; 0: the cuts alone.

    Raises:
        UsageError: more than six lines can fail, there is no storage, or the case has a storm on a
            track, whose hazard no day shares with another.
    """

    def __init__(self, world: World, book: Book | None = None, *, paths: int = PATHS) -> None:
        case = world.microgrid.case
        if case.storm is not None:
            raise UsageError(
                f"sddp learns days that are alike, and case {case.name!r} has the one storm "
                f"{case.storm.name!r}",
                hint="use the dispatcher `stochastic`",
            )
        self.name, self.world = "sddp", world
        self.book = book or Book(case)
        self.fleet, self.memory = self.book.fleet, Memory(world)
        self.lines = [case.network.line(name) for name in self.book.lines]
        self.program = StageProgram(self.fleet.microgrid.stage(case.step_h))
        self.ahead = Lookahead(self.book, paths) if paths else None
        self._midnight, self._end = self.book.ends(world.end_value_per_mwh)

    def cut_set(self, t: int, centre: int) -> CutSet:
        """The cuts of the day of slot t: up to midnight, or to the end of the horizon."""
        clock, left = self.memory.clock(t), self.world.microgrid.case.slots - t
        if left <= self.book.per_day - clock:
            return self.book.cut_set(centre, self._end, clock + left)
        return self.book.cut_set(centre, self._midnight)

    def act(self, seen: Observation) -> Floats:
        """The first slot of each scenario's program."""
        self.memory.update(seen)
        levels, energy = self._levels(seen), self.fleet.summed(seen.energy)
        if self.ahead is None:
            net = self._by_cuts(seen, energy, levels)
        else:
            asked = [self._asked(seen, k, energy[:, k], at) for k, at in enumerate(levels)]
            sets = [self.cut_set(seen.t, int(centre)) for centre in seen.centre]
            each = [self.ahead.decide(*pair) for pair in zip(asked, sets, strict=True)]
            net = np.array(each).T
        return net[self.fleet.member] * self.fleet.share[:, None]

    def _by_cuts(self, seen: Observation, energy: Floats, levels: Sequence[Floats]) -> Floats:
        """(merged units, batch) the present slot of all scenarios, with the cuts of its mode."""
        n, clock, cuts = len(levels), self.memory.clock(seen.t), []
        for k, at in enumerate(levels):
            found = self.cut_set(seen.t, int(seen.centre[k]))
            behind = found.cuts(clock, ~seen.line_up[self.lines, k])
            cuts.append(Cuts(behind.at(at), behind.beta, np.empty((behind.n, 0))))
        microgrid, now = self.fleet.microgrid, np.array([seen.t])
        data = microgrid.data(
            microgrid.situation(seen.line_up, lambda name: seen.forecast(name, now)[0])
        )
        known = NoiseOutcomes(0, np.full(n, 1.0 / n), {k: v[:, :, None] for k, v in data.items()})
        of = np.repeat(np.arange(n), [part.n for part in cuts])
        parts = [(self.program, self.program.numbers(known, 0))]
        blocks = Blocks(parts, np.arange(n), Cuts.joined(cuts), of)
        z = np.array(blocks.decide(energy.T, np.empty((n, 0))))
        charge, discharge = (self.program.columns(f"ess.{way}") for way in ("charge", "discharge"))
        return (z[:, charge] - z[:, discharge]).T

    def _asked(self, seen: Observation, k: int, energy: Floats, levels: Floats) -> Asked:
        clock, down = self.memory.clock(seen.t), ~seen.line_up[self.lines, k]
        known = LineHistory(clock, int(seen.centre[k]), *self._remembered(k, down, clock))
        up, forecast = seen.line_up[:, k], seen.forecast_of(k)
        return Asked(seen.t, self.memory.day(seen.t), known, up, energy, levels, forecast)

    def _remembered(self, k: int, down: Bools, clock: int) -> tuple[Ints, Bools]:
        """Since when each line is down (-1: it is up), and whether it has failed today."""
        names = self.world.scenarios.lines
        since, spent = np.where(down, clock, -1), down.copy()
        for line, name in enumerate(self.book.lines):
            if name in names:
                at = names.index(name)
                since[line], spent[line] = self.memory.since[at, k], self.memory.spent[at, k]
        return since, spent

    def _levels(self, seen: Observation) -> Sequence[Floats]:
        """(levels,) per scenario: what the forecast says of the rest of the day."""
        case, climate, n = self.world.microgrid.case, self.book.climate, seen.energy.shape[1]
        clock = self.memory.clock(seen.t)
        ahead = np.arange(min(self.book.per_day - clock, case.slots - seen.t))
        said = np.array([seen.forecast(name, seen.t + ahead) for name in climate.names])
        said = said.reshape(len(climate.names), len(ahead), n)
        alike = bool((said == said[:, :, :1]).all())
        found = [climate.fitted(said[:, :, k], clock + ahead) for k in range(1 if alike else n)]
        return found * n if alike else found
