"""Lines and winds by span for the tests of this folder."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from resilience.fragility.lines.curves import Curve
from resilience.fragility.lines.spans import Series, SpannedLines, SpanWind

WEAK = Curve("weak", "lognormal", {"median_mps": 45.0, "beta": 0.2}, 3.0, 10.0, "land", "test")


def poles(
    counts: Sequence[int], correlation: float = 0.3, curve: Curve = WEAK, **more: Any
) -> SpannedLines:
    """Lines of so many spans with a pole each."""
    at = np.repeat(np.arange(len(counts)), counts)
    names = tuple(f"{k + 1}-{k + 2}" for k in range(len(counts)))
    return SpannedLines(names, at, (Series(curve, np.ones(len(at))),), correlation, **more)


def gusts(speed: ArrayLike, direction: ArrayLike | None = None) -> SpanWind:
    toward = None if direction is None else np.asarray(direction, float)
    return SpanWind(np.asarray(speed, float), 3.0, 10.0, "land", toward)


def passing(lines: SpannedLines, peak: float = 40.0, slots: int = 48, seed: int = 0) -> SpanWind:
    """A storm that passes in the middle, at different spans at different times and strengths."""
    rng = np.random.default_rng(seed)
    spans = len(lines.span_line)
    middle = slots / 2 + rng.uniform(-3.0, 3.0, (spans, 1))
    top = peak * (1.0 + 0.05 * rng.standard_normal((spans, 1)))
    return gusts(top * np.exp(-(((np.arange(slots) - middle) / (slots / 5.0)) ** 2)))
