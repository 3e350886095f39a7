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

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any


class ResilienceError(Exception):
    """Base of all errors of the package.

    Attributes:
        message: subject, value found, what is allowed.
        hint: the remedy; empty where there is none.
    """

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message, hint)
        self.message = message
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
        where = " ".join(text for text in (self.table, self.key) if text)
        return (
            f"{self.file}: {where}\n"
            f"  found:   {self.value}\n"
            f"  allowed: {self.allowed}\n"
            f"  hint: {self.hint}"
        )


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
        return "\n\n".join([f"{self.message}:", *map(str, self.mistakes)])
