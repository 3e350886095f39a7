"""Judging what is built: what sets of options cost in storms, and what each option is worth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from resilience.arrays import Bools, Floats
from resilience.case import Case
from resilience.models.microgrid import Physics
from resilience.planning.hardening.draws import StrengthDraws, StrengthOption, drawn_with
from resilience.planning.hardening.evaluation import StormOutcomes, outcomes_of
from resilience.planning.hardening.finished import Finished
from resilience.planning.hardening.options import strengths
from resilience.planning.hardening.program import Option
from resilience.planning.hardening.search import HardeningSearch
from resilience.planning.hardening.season import Season
from resilience.planning.hardening.sites import with_built
from resilience.progress import meter


@dataclass(frozen=True)
class Judge:
    """Tells what storms cost with something built, each set once.

    Attributes:
        case: in the steps of the plan.
        season: the storms.
        options: what could be built.
        physics: of the storms.
        shift: of their draws.
        finished: where outcomes are kept.
    """

    case: Case
    season: Season
    options: tuple[Option, ...]
    physics: Physics
    shift: float
    finished: Finished
    _known: dict[tuple[bytes, int, int, bool], StormOutcomes] = field(default_factory=dict)

    def outcomes(self, chosen: Bools, n: int, seed: int, *, crews: bool = True) -> StormOutcomes:
        """`n` storms of a draw, with options (options,) built."""
        key = chosen.tobytes(), n, seed, crews
        if key not in self._known:
            facts = [chosen, n, seed, crews]
            outcomes = self.finished.outcomes(facts, lambda: self._judged(chosen, n, seed, crews))
            stratum = self.season.storm_of(n) if len(self.season.storms) > 1 else None
            self._known[key] = replace(outcomes, stratum=stratum)
        return self._known[key]

    def _judged(self, chosen: Bools, n: int, seed: int, crews: bool) -> StormOutcomes:
        built = [self.options[k] for k in np.flatnonzero(chosen)]
        lines = strengths(built)
        others = [option for option in built if not isinstance(option, StrengthOption)]
        scenarios = drawn_with(self.season, lines, n, seed, self.shift, crews=crews)
        return outcomes_of(with_built(self.case, others), scenarios, self.physics)

    def all_outcomes(
        self, sets: Mapping[str, Bools], draws: Sequence[tuple[int, int]]
    ) -> list[dict[str, StormOutcomes]]:
        """By draw (storms, seed), what every set costs, by name."""
        by_draw: list[dict[str, StormOutcomes]] = [{} for _ in draws]
        with meter("judging", len(sets) * len(draws)) as progress:
            for name, chosen in sets.items():
                for outcomes, (n, seed) in zip(by_draw, draws, strict=True):
                    outcomes[name] = self.outcomes(chosen, n, seed)
                    progress.advance(1)
        return by_draw


def chances(options: Sequence[Option], draws: StrengthDraws) -> Floats:
    """(options,) probability that the line of each is down at all, as it is; NaN of all else."""
    ever = draws.scenarios.down.any(axis=1) @ draws.scenarios.probability
    chance = dict(zip(draws.scenarios.lines, ever.tolist(), strict=True))
    return np.array([chance[o.line] if isinstance(o, StrengthOption) else np.nan for o in options])


def strongest(options: Sequence[Option]) -> Bools:
    """(options,) the strongest of every line, all units, and all ties."""
    best = {option.line: option for option in sorted(strengths(options), key=lambda o: o.factor)}
    return np.array([not isinstance(o, StrengthOption) or best[o.line] is o for o in options])


def worth(search: HardeningSearch, chosen: Bools) -> tuple[Floats, Floats]:
    """(options,) $ that each saves alone, and beside what is chosen; NaN: it cannot be added."""
    nothing = np.zeros(len(chosen), bool)
    first, value = search.additions(nothing), search.value(chosen)
    alone = np.where(np.isfinite(first), search.value(nothing) - first, np.nan)
    after = search.additions(chosen)
    beside = np.where(np.isfinite(after), value - after, np.nan)
    for k in np.flatnonzero(chosen):
        without = chosen.copy()
        without[k] = False
        beside[k] = search.value(without) - value
    return alone, beside
