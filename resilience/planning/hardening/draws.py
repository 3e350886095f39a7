"""Storms with every line as it is, and as it would be with each way of strengthening it.

All random numbers are drawn before it is known what breaks, and strength moves the capacities of
its own line alone. So the same storms can be met by any set of strengthened lines, and where crews
are as many as needed, what becomes of a line depends on that line alone: with the options of a
line known each, those of any set are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from resilience.arrays import Bools
from resilience.fragility.lines.strength import lines_of
from resilience.fragility.outages.scenarios import Scenarios
from resilience.fragility.outages.storms import Sampling, sample_storms
from resilience.fragility.outages.units import with_units
from resilience.planning.hardening.season import SEEDS_OF_STORMS, Season

UNBREAKABLE = 1e6
"""Times as strong: no storm on earth breaks it."""


@dataclass(frozen=True)
class StrengthOption:
    """One way of strengthening a line.

    Attributes:
        line: its name.
        factor: by which the speeds are multiplied that it stands; infinite: it goes underground.
        cost: $ to build it.
        life_years: how long it lasts.
    """

    line: str
    factor: float
    cost: float
    life_years: float = 40.0

    @property
    def label(self) -> str:
        """`12-13 x1.5`, or `12-13 underground`."""
        word = f"x{self.factor:g}" if np.isfinite(self.factor) else "underground"
        return f"{self.line} {word}"


@dataclass(frozen=True, eq=False)
class StrengthDraws:
    """Storms, and what each option would make of its line in them.

    Attributes:
        scenarios: with every line as it is.
        strong: (options, slots, scenarios) True where the line of an option would be down with it.
    """

    scenarios: Scenarios
    strong: Bools


def drawn_with(
    season: Season,
    chosen: Sequence[StrengthOption],
    n: int,
    seed: int,
    shift: float = 0.0,
    *,
    crews: bool = True,
) -> Scenarios:
    """`n` storms met by lines of which some are strengthened; the same ones for any choice.

    Args:
        season: the storms, as they come.
        chosen: options, one a line.
        n: how many, of all storms together.
        seed: of the draw.
        shift: of the common strength; see `storms.Sampling`.
        crews: those of the case; otherwise as many as needed.

    Raises:
        UsageError: as `sample_storms`.
    """
    factors = {option.line: min(option.factor, UNBREAKABLE) for option in chosen}
    draws = []
    for k, (storm, count) in enumerate(zip(season.storms, season.split(n).tolist(), strict=True)):
        lines, repair = storm.lines, storm.repair
        if factors:
            lines = lines_of(storm.case, lines.names, lines.span_line, lines.bearing_deg, factors)
        scenarios = sample_storms(
            lines, list(storm.winds), count, seed + SEEDS_OF_STORMS * k,
            repair=repair if crews else replace(repair, crews=None),
            timing=storm.timing, sampling=Sampling(shift=shift),
        )  # fmt: skip
        draws.append(scenarios)
    return with_units(season.storms[0].case, season.joined(draws), seed)


def draw_options(
    season: Season, options: Sequence[StrengthOption], n: int, seed: int, shift: float = 0.0
) -> StrengthDraws:
    """`n` storms with as many crews as needed, and the status of every option's line in them.

    Raises:
        UsageError: as `sample_storms`.
    """
    bare = drawn_with(season, (), n, seed, shift, crews=False)
    strong = np.zeros((len(options), bare.slots, n), bool)
    by_line: dict[str, list[int]] = {}
    for k, option in enumerate(options):
        by_line.setdefault(option.line, []).append(k)
    # Lines do not touch each other: the first options of all lines are drawn at once, and so on.
    for number in range(max(map(len, by_line.values()), default=0)):
        layer = [members[number] for members in by_line.values() if len(members) > number]
        scenarios = drawn_with(season, [options[k] for k in layer], n, seed, shift, crews=False)
        rows = {name: row for row, name in enumerate(scenarios.lines)}
        strong[layer] = scenarios.down[[rows[options[k].line] for k in layer]]
    return StrengthDraws(bare, strong)


def status_with(
    draws: StrengthDraws, options: Sequence[StrengthOption], chosen: Mapping[int, bool] | Bools
) -> Scenarios:
    """The storms with chosen options (options,) built, crews as many as needed."""
    down, names = draws.scenarios.down.copy(), list(draws.scenarios.lines)
    for k in np.flatnonzero(np.asarray(chosen)):
        down[names.index(options[int(k)].line)] = draws.strong[k]
    return replace(draws.scenarios, down=down)
