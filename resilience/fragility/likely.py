"""The islands that storms are likely to make, counted in sampled scenarios."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.case.schema import GridTable
from resilience.fragility.outages.scenarios import Scenarios
from resilience.models.microgrid import Microgrid

if TYPE_CHECKING:
    from resilience.case import Case


@dataclass(frozen=True)
class Island:
    """Buses that hang together, apart from the grid, at some time of a storm.

    Attributes:
        buses: their names.
        alive: a grid-forming unit stands there.
        probability: that a storm makes this island at some time.
        hours: that it then lasts, on average.
    """

    buses: tuple[str, ...]
    alive: bool
    probability: float
    hours: float


@dataclass(frozen=True)
class Islanding:
    """What a storm leaves at its worst: when the fewest buses hang on the grid.

    Attributes:
        lines: that are down.
        islands: buses of every part, the grid's first, if a bus hangs on it.
        probability: that a storm leaves exactly this.
    """

    lines: tuple[str, ...]
    islands: tuple[tuple[str, ...], ...]
    probability: float


@dataclass(frozen=True, eq=False)
class Likely:
    """What storms do to the feeder.

    Attributes:
        islands: most probable first.
        islandings: most probable first.
        apart: (buses,) probability of being apart from the grid at some time.
        dark: (buses,) probability of having no source at some time.
        dark_by_slot: (buses, slots) probability of having no source in a slot.
    """

    islands: tuple[Island, ...]
    islandings: tuple[Islanding, ...]
    apart: Floats
    dark: Floats
    dark_by_slot: Floats


@dataclass(frozen=True, eq=False)
class Patterns:
    """Different states of the lines, and in which slot of which scenario they are.

    Attributes:
        up: (lines of the case, patterns).
        number: (slots, scenarios) number of the pattern.
        island: (buses of the case, patterns) number of the island of every bus.
        alive, grid: (buses of the case, patterns) whether its island has a source, a grid.
    """

    up: Bools
    number: Ints
    island: Ints
    alive: Bools
    grid: Bools


def likely(case: Case, scenarios: Scenarios, limit: int = 10) -> Likely:
    """Counts islands; probabilities are those of the scenarios, weighted.

    Args:
        case: the case.
        scenarios: over its horizon.
        limit: islands, and islandings, that are kept.
    """
    patterns = patterns_of(case, scenarios)
    weight = scenarios.probability
    apart, dark = (~mask[:, patterns.number] for mask in (patterns.grid, patterns.alive))
    return Likely(
        islands=tuple(_islands(case, patterns, weight))[:limit],
        islandings=tuple(_islandings(case, patterns, weight))[:limit],
        apart=apart.any(axis=1) @ weight,
        dark=dark.any(axis=1) @ weight,
        dark_by_slot=dark @ weight,
    )


def patterns_of(case: Case, scenarios: Scenarios) -> Patterns:
    """The different line states of all slots and scenarios, and the islands of each."""
    scenarios = scenarios.restricted_to(case.network.line_names)
    down = scenarios.down.reshape(len(scenarios.lines), -1)
    _, first, number = np.unique(
        np.packbits(down, axis=0).T, axis=0, return_index=True, return_inverse=True
    )
    names = case.network.line_names
    up = np.ones((len(names), len(first)), bool)
    up[[names.index(line) for line in scenarios.lines]] = ~down[:, first]
    microgrid = _fallible(case, scenarios)
    situation = microgrid.situation(up)
    island = situation.island[microgrid.bus_of]
    sources = np.zeros((int(island.max(initial=0)) + 1, len(first)), bool)
    for bus in microgrid.bus_index(case.tables_of(GridTable)).tolist():
        sources[situation.island[bus], np.arange(len(first))] = True
    return Patterns(
        up, number.reshape(scenarios.slots, scenarios.n), island,
        situation.alive[microgrid.bus_of] > 0, sources[island, np.arange(len(first))],
    )  # fmt: skip


def _fallible(case: Case, scenarios: Scenarios) -> Microgrid:
    """The microgrid at copperplate in which every line of the scenarios can fail."""
    from resilience.case import Outage

    outages = tuple(Outage(line, 0, 1) for line in scenarios.lines)
    return Microgrid.build(case.replace(outages=outages), "copperplate")


def _islands(case: Case, patterns: Patterns, weight: Floats) -> Iterable[Island]:
    """Islands without the grid, by probability."""
    chance: dict[bytes, float] = defaultdict(float)
    slots: dict[bytes, float] = defaultdict(float)
    alive: dict[bytes, bool] = {}
    islands_of: list[list[bytes]] = []  # islands by pattern, each as the bits of its buses
    for p in range(patterns.up.shape[1]):
        islands = []
        for number in np.unique(patterns.island[~patterns.grid[:, p], p]):
            members = patterns.island[:, p] == number
            key = np.packbits(members).tobytes()
            alive[key] = bool(patterns.alive[members, p].any())
            islands.append(key)
        islands_of.append(islands)
    for k in range(patterns.number.shape[1]):
        numbers, counts = np.unique(patterns.number[:, k], return_counts=True)
        spans: dict[bytes, int] = defaultdict(int)
        for p, count in zip(numbers.tolist(), counts.tolist(), strict=True):
            for key in islands_of[p]:
                spans[key] += count
        for key, count in spans.items():
            chance[key] += weight[k]
            slots[key] += weight[k] * count
    for key in sorted(chance, key=lambda key: -chance[key]):
        buses = _named(case, np.unpackbits(np.frombuffer(key, np.uint8)).astype(bool))
        hours = case.step_h * slots[key] / chance[key]
        yield Island(buses, alive[key], float(chance[key]), float(hours))


def _islandings(case: Case, patterns: Patterns, weight: Floats) -> Iterable[Islanding]:
    """States at the worst moment, by probability."""
    connected = patterns.grid.sum(axis=0)[patterns.number]
    worst = patterns.number[connected.argmin(axis=0), np.arange(patterns.number.shape[1])]
    chance = np.bincount(worst, weight, patterns.up.shape[1])
    for p in np.argsort(-chance, kind="stable").tolist():
        if not chance[p]:
            return
        down = np.flatnonzero(~patterns.up[:, p])
        numbers = np.unique(patterns.island[:, p])
        order = sorted(
            numbers, key=lambda i: not patterns.grid[patterns.island[:, p] == i, p].any()
        )
        islands = tuple(_named(case, patterns.island[:, p] == number) for number in order)
        lines = tuple(case.network.line_names[k] for k in down)
        yield Islanding(lines, islands, float(chance[p]))


def _named(case: Case, members: Bools) -> tuple[str, ...]:
    """Names of the buses whose bit is set; packed bits are padded at the end."""
    return tuple(
        name for name, inside in zip(case.network.bus_names, members, strict=False) if inside
    )


def buses_text(names: Iterable[str]) -> str:
    """Names of buses, rows of numbers as spans: `2-5, 19`."""
    texts: list[str] = []
    run: list[int] = []
    numbers = sorted(int(name) for name in names if name.isdecimal())
    words = [name for name in names if not name.isdecimal()]
    for number in [*numbers, None]:
        if run and (number is None or number != run[-1] + 1):
            texts.append(f"{run[0]}-{run[-1]}" if len(run) > 1 else str(run[0]))
            run = []
        if number is not None:
            run.append(number)
    return ", ".join(texts + words)
