"""Scenarios: which line or unit is down when, in many possible futures, and how likely each is.

A unit is a generator, a storage, a plant or a grid connection of the case; it has a row like a line
has, under its name. A name that a line has means the line.

Saved, a .npz file keeps everything, and a .csv file is for people and other tools; `files.py` reads
both. A CSV file has a row per outage with the columns scenario, line, first, stop (slots from 0;
stop is the first slot in which the line, or unit, is back) and weight. A row with a scenario only
is a scenario without outage; so is every number below the highest that has no row.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.errors import UsageError
from resilience.files import replacing_file
from resilience.shown import Shown

COLUMNS = ("scenario", "line", "first", "stop")


@dataclass(frozen=True, eq=False, repr=False)
class Scenarios(Shown):
    """Outage paths.

    Attributes:
        lines: names of the lines that can fail, and of the units.
        down: (lines, slots, scenarios) True where one is down.
        probability: (scenarios,) weights, adding up to 1.
        centre: (days, scenarios) slot of 15 minutes of the day in which the hazard peaks, as
            forecast at midnight; None where the process has no such thing.
        seed: what the draws were made from; None for a list or a file.
        process: the process and its settings, in words and numbers.
        represents: the many scenarios that these few stand for; None: they stand for themselves.

    Raises:
        UsageError: shapes that do not match, or weights that are no probabilities.
    """

    lines: tuple[str, ...]
    down: Bools
    probability: Floats
    centre: Ints | None = None
    seed: int | None = None
    process: str = ""
    represents: Scenarios | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        slots = self.down.shape[1] if self.down.ndim == 3 else 0
        shape = (len(self.lines), slots, *self.probability.shape[:1])
        if self.down.shape != shape or self.probability.ndim != 1:
            raise UsageError(
                f"outages have the shape {self.down.shape}; allowed: {shape}",
                hint="axes are lines, slots, scenarios",
            )
        if len(set(self.lines)) < len(self.lines):
            raise UsageError(
                "a line or unit is there twice; allowed: every one once", "leave one out"
            )
        if self.centre is not None and not self._has_sound_centre(self.centre):
            raise UsageError(
                f"centres of the shape {self.centre.shape}; allowed: whole numbers, 0 to 95, of "
                f"(days, {self.n})",
                hint="they are slots of 15 minutes of the day",
            )
        if not (self.probability >= 0).all() or not np.isclose(self.probability.sum(), 1.0):
            raise UsageError(
                f"probabilities add up to {self.probability.sum():g}; allowed: 1, none negative",
                hint="divide the weights by their sum",
            )

    def _has_sound_centre(self, centre: Ints) -> bool:
        is_whole = centre.dtype.kind in "iu" and centre.ndim == 2 and centre.shape[1] == self.n
        return is_whole and bool(((centre >= 0) & (centre < 96)).all())

    @property
    def n(self) -> int:
        """Number of scenarios."""
        return len(self.probability)

    @property
    def slots(self) -> int:
        """Number of slots."""
        return int(self.down.shape[1])

    def line_up(self, names: Sequence[str]) -> Bools:
        """(names, slots, scenarios) False where one is down; what cannot fail is up."""
        up = np.ones((len(names), self.slots, self.n), bool)
        for k, line in enumerate(self.lines):
            if line in names:
                up[list(names).index(line)] = ~self.down[k]
        return up

    def status(self, elements: Sequence[str]) -> Bools:
        """(elements, slots, scenarios) False where one is down, of the `elements` of a case.

        Raises:
            UsageError: something fails that is none of them.
        """
        if unknown := set(self.lines).difference(elements):
            raise UsageError(
                f"{sorted(unknown)[0]!r} of the scenarios cannot fail in the case; allowed: its "
                "lines, and units that say how they fail, or that an outage hits",
                hint="`microgrid_with_fallible_lines` makes a case of which it is an element",
            )
        return self.line_up(elements)

    def restricted_to(self, names: Collection[str]) -> Scenarios:
        """The same scenarios, only the rows of some names: the lines of a network, say."""
        rows = [k for k, name in enumerate(self.lines) if name in names]
        if len(rows) == len(self.lines):
            return self
        return replace(
            self, lines=tuple(self.lines[k] for k in rows), down=self.down[rows], represents=None
        )

    def chosen(self, index: Ints | Sequence[int]) -> Scenarios:
        """Some of the scenarios, their weights scaled to add up to 1."""
        weight = self.probability[index]
        centre = None if self.centre is None else self.centre[:, index]
        down = self.down[:, :, index]
        return Scenarios(self.lines, down, weight / weight.sum(), centre, self.seed, self.process)

    def events(self) -> list[tuple[int, str, int, int]]:
        """Every outage as (scenario, line, first slot, stop slot), in that order."""
        padded = np.pad(self.down.astype(np.int8), ((0, 0), (1, 1), (0, 0)))
        change = np.diff(padded, axis=1)
        begin = np.argwhere(change.transpose(2, 0, 1) == 1)
        end = np.argwhere(change.transpose(2, 0, 1) == -1)
        return [
            (int(s), self.lines[k], int(first), int(stop))
            for (s, k, first), stop in zip(begin, end[:, 2], strict=True)
        ]

    def save(self, path: str | Path) -> None:
        """Writes a .npz file, or a .csv file.

        What was drawn from what, and what few scenarios stand for, is in the former only.

        Raises:
            UsageError: another suffix.
        """
        path = Path(path)
        check_suffix(path)
        with replacing_file(path) as fresh:
            if path.suffix == ".csv":
                _write_csv(self, fresh)
            else:
                _write_npz(self, fresh)


def check_suffix(path: Path) -> None:
    """Refuses a file whose suffix says nothing known.

    Raises:
        UsageError: the suffix is neither .npz nor .csv.
    """
    if path.suffix not in (".npz", ".csv"):
        raise UsageError(
            f"scenarios cannot be kept in {path.name!r}; allowed suffixes: .npz, .csv",
            hint="npz keeps everything, csv is for people and other tools",
        )


def _write_csv(scenarios: Scenarios, path: Path) -> None:
    rows: dict[int, list[tuple[int, str, int | str, int | str]]] = {
        k: [] for k in range(scenarios.n)
    }
    for event in scenarios.events():
        rows[event[0]].append(event)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow((*COLUMNS, "weight"))
        for k, weight in enumerate(scenarios.probability):
            writer.writerows((*row, float(weight)) for row in rows[k] or [(k, "", "", "")])


def _write_npz(scenarios: Scenarios, path: Path) -> None:
    about = {name: getattr(scenarios, name) for name in ("lines", "seed", "process")}
    arrays: dict[str, Any] = _arrays(scenarios) | {"about": json.dumps(about)}
    if scenarios.represents is not None:
        everything = scenarios.represents
        process = json.dumps({**about, "process": everything.process})
        arrays |= {f"all_{key}": value for key, value in _arrays(everything).items()}
        arrays["all_about"] = process
    with path.open("wb") as binary:
        np.savez_compressed(binary, **arrays)


def _arrays(scenarios: Scenarios) -> dict[str, Any]:
    """What of scenarios is numbers, outages as bits."""
    arrays = {
        "down": np.packbits(scenarios.down, axis=None),
        "shape": scenarios.down.shape,
        "probability": scenarios.probability,
    }
    return arrays if scenarios.centre is None else arrays | {"centre": scenarios.centre}
