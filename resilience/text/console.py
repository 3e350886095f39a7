"""Where reports are printed: names and numbers are printed to the letter."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console


def plain_console(**options: Any) -> Console:
    """A console that takes what is in brackets or between colons for what it is: part of a name.

    Args:
        options: of rich's `Console`, as `file` and `width`.

    In a notebook rich would show a report twice, the second time as text with codes of colours;
    the same text as on a terminal is printed instead.
    """
    from rich.console import Console

    return Console(markup=False, emoji=False, **{"force_jupyter": False, **options})
