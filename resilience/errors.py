"""Every error this package raises on purpose.

```
ResilienceError            catch this one to catch them all
├── CaseError              a case file with mistakes: all of them, as `mistakes`
├── UsageError             a call or command that cannot mean anything (unknown name, option)
├── FileError              a file that the system will not write or read, and the remedy
├── InfeasibleError        no plan satisfies the case; the message names what conflicts
└── SolverError            a solver failed, or returned no usable answer
    └── CertificateError   an answer contradicts itself: no cost, bound or row of it is shown
```

A message reads: subject, value found, what is allowed; then `hint:` with the remedy.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

MAX_MESSAGE = 20_000
"""Characters of a message: a list of all mistakes stays whole, an argument without end does not."""


class ResilienceError(Exception):
    """Base of all errors of the package.

    Attributes:
        message: subject, value found, what is allowed; what is too long to read loses its middle.
        hint: the remedy; empty where there is none.
    """

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message, hint)
        half = MAX_MESSAGE // 2
        is_long = len(message) > MAX_MESSAGE
        self.message = f"{message[:half]} ... {message[-half:]}" if is_long else message
        self.hint = hint

    def __str__(self) -> str:
        return f"{self.message}\nhint: {self.hint}" if self.hint else self.message


class UsageError(ResilienceError):
    """A call or a command that cannot mean anything."""


class FileError(ResilienceError):
    """A file that the system will not write or read: no permission, a full disk, a long name."""


class InfeasibleError(ResilienceError):
    """No plan satisfies the case. The message names the rows and slots in conflict."""


class SolverError(ResilienceError):
    """A solver failed, or stopped without a usable answer."""


class CertificateError(SolverError):
    """An answer that contradicts itself: the fault is the program's or the solver's.

    A bound above the objective, costs that do not add up, a row that does not hold: see
    `resilience.models.program.gate`.
    """


def shortened(text: str, limit: int = 60) -> str:
    """A text for messages, cut to `limit` characters."""
    return text if len(text) <= limit else text[: limit - 4] + " ..."


@dataclass(frozen=True)
class Mistake:
    """One mistake in a case file.

    Attributes:
        file: in which it stands.
        table: the table's title: `[[ess]] ess2`.
        key: of the table.
        value: what was found there, as text for people, like all that follows.
        allowed: what may stand there.
        hint: what to do about it.
    """

    file: str
    table: str
    key: str
    value: str
    allowed: str
    hint: str

    def __str__(self) -> str:
        where = " ".join(shortened(text, MAX_SHOWN) for text in (self.table, self.key) if text)
        return (
            f"{self.file}: {where}\n"
            f"  found:   {shortened(self.value, MAX_SHOWN)}\n"
            f"  allowed: {self.allowed}\n"
            f"  hint: {self.hint}"
        )


MAX_SHOWN = 1000
"""Characters of a value in a message."""
MAX_LISTED = 100
"""Mistakes in a message; `CaseError.mistakes` has all."""
MAX_COMPARED = 200
"""Characters of a name, and names, beyond which only names that begin alike are compared."""


def did_you_mean(name: str, allowed: Iterable[str], *, max_listed: int = 8) -> str:
    """A hint that offers the nearest allowed names, or else the first few."""
    names = list(allowed)
    text = name.casefold()
    folded = {candidate.casefold(): candidate for candidate in names}
    likely = [key for key in folded if len(names) <= MAX_COMPARED or key[:1] == text[:1]]
    likely = likely if len(text) <= MAX_COMPARED else []
    close = difflib.get_close_matches(text, likely, n=3, cutoff=0.6)
    if close:
        return "did you mean " + " or ".join(folded[match] for match in close) + "?"
    if not names:
        return "there are none"
    more = f", ... ({len(names)} in all)" if len(names) > max_listed else ""
    return "known are " + ", ".join(names[:max_listed]) + more


def check_range(
    name: str, value: float, low: float, high: float, *, hint: str = "", below: bool = False
) -> None:
    """Refuses a number that lies outside a range, and tells where it looks like percent.

    Args:
        name: of the number, for the message.
        value: the number.
        low: least that is allowed.
        high: most that is allowed.
        hint: what to do about it.
        below: whether the number must stay below `high`.

    Raises:
        UsageError: it lies outside, or is none.
    """
    if low <= value <= high and not (below and value == high):
        return
    allowed = f"{low:g} up to, but not, {high:g}" if below else f"{low:g} to {high:g}"
    percent = "probably percent; divide by 100" if high == 1.0 and 1.0 < value <= 100.0 else ""
    text = "; ".join(words for words in (percent, hint) if words)
    raise UsageError(f"{name} {value:g}; allowed: {allowed}", hint=text)


def together(*steps: Callable[[], Any]) -> list[Any]:
    """Takes every step, also after one that finds mistakes, and returns what they return.

    Raises:
        CaseError: all mistakes of all steps.
        UsageError: the first of the steps, where none finds mistakes in a case.
    """
    results, errors, misuses = [], list[CaseError](), list[UsageError]()
    for step in steps:
        try:
            results.append(step())
        except CaseError as error:
            errors.append(error)
        except UsageError as error:
            misuses.append(error)
    if len(errors) == 1:
        raise errors[0]
    if errors:
        raise CaseError(mistake for error in errors for mistake in error.mistakes)
    if misuses:
        raise misuses[0]
    return results


class CaseError(ResilienceError):
    """A case file, or another file that goes with it, with mistakes.

    Args:
        mistakes: every one of them.
        subject: what has them.

    Attributes:
        mistakes: every one of them, each once.
    """

    def __init__(self, mistakes: Iterable[Mistake], subject: str = "the case") -> None:
        self.mistakes: tuple[Mistake, ...] = tuple(dict.fromkeys(mistakes))
        count = len(self.mistakes)
        super().__init__(f"{count} mistake{'s' if count != 1 else ''} in {subject}")
        self.args = (self.mistakes, subject)

    def __str__(self) -> str:
        more = len(self.mistakes) - MAX_LISTED
        rest_of_them = [f"and {more} more; mend these first"] if more > 0 else []
        listed = map(str, self.mistakes[:MAX_LISTED])
        return "\n\n".join([f"{self.message}:", *listed, *rest_of_them])
