"""What of a network file a case does not model, to be told wherever the case is read."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

_MAX_PLACES = 5


@dataclass(frozen=True)
class Omission:
    """One kind of thing in a network file that a case has not, or has otherwise.

    Attributes:
        element: what it is, in the singular: `shunt`.
        places: names of the buses, branches or devices where it is; none where `element` says all.
        size: how much it is in all: `19 Mvar`; empty where that says nothing.
        instead: what the case has in its place: `constant power`; empty for nothing.
    """

    element: str
    places: tuple[str, ...]
    size: str = ""
    instead: str = ""

    def __str__(self) -> str:
        if not self.places:
            return self.element
        count = len(self.places)
        words = f"{count} {self.element if count == 1 else plural(self.element)}"
        if self.size:
            words += f" of {self.size}" + (" in all" if count > 1 else "")
        more = ", ..." if count > _MAX_PLACES else ""
        words += f" ({', '.join(self.places[:_MAX_PLACES])}{more})"
        return words + (f", here {self.instead}" if self.instead else "")


def plural(noun: str) -> str:
    """The plural of a noun and what may follow it: `loads at scaling 0`; `-ing` has none."""
    noun, *after = re.split(r"(?= (?:at|beyond|of|shorted|that|without) )", noun, maxsplit=1)
    return "".join([_plural(noun), *after])


def _plural(noun: str) -> str:
    if noun.endswith("ing"):
        return noun
    ending = "es" if noun.endswith(("s", "x", "ch", "sh")) else "s"
    return f"{noun[:-1]}ies" if noun.endswith("y") and noun[-2] not in "aeiou" else noun + ending


def omission_text(omissions: Iterable[Omission]) -> str:
    """All of them in one line: `3 taps (1-2, 2-3, 2-4); 1 shunt of 19 Mvar (9)`."""
    return "; ".join(map(str, omissions))


def amount(values: Iterable[float], unit: str) -> str:
    """The sum of sizes with its unit, empty where it comes to nothing."""
    total = sum(abs(value) for value in values)
    return f"{total:.4g} {unit}" if total > 0 else ""


def omission(
    element: str, places: Sequence[tuple[str, float]], unit: str = "", instead: str = ""
) -> list[Omission]:
    """`[omission]`, or nothing where there are no places.

    Args:
        element: what it is, in the singular.
        places: where, and how much of it.
        unit: of the size; without one, none is told.
        instead: what the case has in its place.
    """
    if not places:
        return []
    size = amount((value for _, value in places), unit) if unit else ""
    return [Omission(element, tuple(place for place, _ in places), size, instead)]
