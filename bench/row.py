"""One line of the table, and how things are timed."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

T = TypeVar("T")


@dataclass(frozen=True)
class Row:
    """What was measured and what it must reach; `met` is None where there is no target."""

    name: str
    measured: str
    target: str
    met: bool | None
    note: str = ""


def below(name: str, value: float, limit: float, unit: str, note: str = "") -> Row:
    return Row(name, f"{value:.3g} {unit}", f"< {limit:g} {unit}", value < limit, note)


def ratio(name: str, slow: list[float], fast: list[float], min_ratio: float | None) -> Row:
    """Of the medians, in seconds, of two things measured alternately."""
    slow_s, fast_s = float(np.median(slow)), float(np.median(fast))
    times = slow_s / fast_s
    met = None if min_ratio is None else times >= min_ratio
    target = "" if min_ratio is None else f">= {min_ratio:g}x"
    note = f"{1e3 * slow_s:.3g} ms against {1e3 * fast_s:.3g} ms"
    return Row(name, f"{times:.1f}x", target, met, note)


def skipped(name: str, why: str) -> Row:
    return Row(name, "skipped", "", None, why)


def timed(call: Callable[..., T], *arguments: Any, **options: Any) -> tuple[float, T]:
    """Seconds, and what the call returned."""
    began = time.perf_counter()
    result = call(*arguments, **options)
    return time.perf_counter() - began, result
