"""Cases with thousands of devices or mistakes: the work grows as the file does, not as its square.

Work is counted in calls of functions, which are the same on every machine.
"""

from __future__ import annotations

import cProfile
import pstats
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

import resilience as rs

Text = Callable[[int], str]
"""A table of a case, of its number."""


def loads(k: int) -> str:
    return f'[[load]]\nname = "x{k}"\nbus = "{k % 30 + 2}"\np_max_mw = 0.0001\n'


def unknown_buses(k: int) -> str:
    return f'[[load]]\nname = "x{k}"\nbus = "q{k}"\np_max_mw = 0.0001\n'


def defaulted_buses(k: int) -> str:
    head = '[defaults.load]\nbus = "nowhere"\np_max_mw = 0.2\n' if k == 0 else ""
    return head + f'[[load]]\nname = "x{k}"\n'


def unpriced_grids(k: int) -> str:
    return f'[[grid]]\nname = "g{k}"\nbus = "{k % 30 + 2}"\nimport_max_mw = 2.5\n'


def unknown_lines(k: int) -> str:
    return f'[[line]]\nname = "q{k}"\nbreakpoint = true\n'


def unknown_keys(k: int) -> str:
    return loads(k) + f"colour{k} = 7\n"


def equal_names(k: int) -> str:
    return loads(k).replace(f"x{k}", f"x{k // 2}")


def calls(text: Text, count: int, path: Path) -> int:
    """Calls of functions that it takes to read a case of so many tables."""
    path.write_text('extends = "ieee33"\n' + "".join(map(text, range(count))))
    profile = cProfile.Profile()
    profile.enable()
    with suppress(rs.CaseError):
        rs.load_case(path)
    profile.disable()
    return int(pstats.Stats(profile).total_calls)  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    "text",
    [
        loads,
        unknown_buses,
        defaulted_buses,
        unpriced_grids,
        unknown_lines,
        unknown_keys,
        equal_names,
    ],
)
def test_twice_the_tables_take_twice_the_work(text: Text, tmp_path: Path) -> None:
    calls(text, 2, tmp_path / "first.toml")
    none, once, twice = (calls(text, n, tmp_path / "case.toml") for n in (2, 402, 802))
    assert once > none
    assert twice - none < 2.3 * (once - none)
