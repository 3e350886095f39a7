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


def below(name: str, value: float, most: float, unit: str, note: str = "") -> Row:
    return Row(name, f"{value:.3g} {unit}", f"< {most:g} {unit}", value < most, note)


def ratio(name: str, slow: list[float], fast: list[float], least: float | None) -> Row:
    """Of the medians, in seconds, of two things measured alternately."""
    a, b = float(np.median(slow)), float(np.median(fast))
    met = None if least is None else a / b >= least
    target = "" if least is None else f">= {least:g}x"
    return Row(name, f"{a / b:.1f}x", target, met, f"{1e3 * a:.3g} ms against {1e3 * b:.3g} ms")


def skipped(name: str, why: str) -> Row:
    return Row(name, "skipped", "", None, why)


def timed(call: Callable[..., T], *arguments: Any) -> tuple[float, T]:
    """Seconds, and what the call returned."""
    began = time.perf_counter()
    found = call(*arguments)
    return time.perf_counter() - began, found
