"""The lines that storms may break."""

from __future__ import annotations

from typing import TYPE_CHECKING

from resilience.errors import UsageError

if TYPE_CHECKING:
    from resilience.case import Case


def breakpoints(case: Case) -> tuple[str, ...]:
    """Lines that storms may break, in the order of the network.

    Raises:
        UsageError: the case marks none.
    """
    network = case.network
    names = tuple(n for n, b in zip(network.line_names, network.breakpoint, strict=True) if b)
    if not names:
        raise UsageError(
            f"case {case.name!r} has no breakpoint", hint="mark lines with `breakpoint = true`"
        )
    return names
