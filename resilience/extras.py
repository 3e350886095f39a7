"""Packages that only some commands need: what to install where they are missing."""

from __future__ import annotations

from importlib.util import find_spec

from resilience.errors import UsageError


def need(extra: str, subject: str, *packages: str) -> None:
    """Refuses to begin without the packages of an extra.

    Args:
        extra: its name in `pyproject.toml`.
        subject: who needs them.
        packages: as they are imported.

    Raises:
        UsageError: one of them is missing; the extra is named.
    """
    if missing := [name for name in packages if find_spec(name) is None]:
        raise UsageError(
            f"{subject} needs {', '.join(missing)}, not installed here",
            hint=f"pip install 'resilience[{extra}]'",
        )
