"""What terminals and notebooks show of a result: one line, a small table, or the printed report.

Results stand below the text that describes them. So they name the module that does, which is
imported when something is shown, as a kind of device names the module of its equations.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any, TextIO

VIEWS = "resilience.text.brief"
"""Has `one_line`, `as_html` and `printed`."""


class Shown:
    """A result that can be looked at."""

    def __repr__(self) -> str:
        return str(import_module(VIEWS).one_line(self))

    def _repr_html_(self) -> str:
        """A table for notebooks; whatever comes from files is escaped."""
        return str(import_module(VIEWS).as_html(self))

    def print(
        self, *, file: TextIO | None = None, width: int | None = None, **options: Any
    ) -> None:
        """Prints the report that the command line prints.

        Args:
            file: where to; standard output if omitted.
            width: letters of a line; those of the terminal if omitted.
            options: of the report; `with_schedule=True` adds what every unit does by the hour.

        Raises:
            UsageError: there is no report of such a thing.
        """
        import_module(VIEWS).printed(self, file, width, options)
