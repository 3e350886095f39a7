"""From winds at spans to outages: a storm over 37 lines of 20 to 100 poles, a day of 96 slots."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bench.row import Row, below, timed
from resilience.fragility.lines.damage import hazard
from resilience.fragility.lines.spans import (
    SpannedLines,
    SpanWind,
    failure_probability,
    poles_in_series,
)
from resilience.fragility.outages.reduction import reduced
from resilience.fragility.outages.repair import Repair
from resilience.fragility.outages.storms import Sampling, effective_size, sample_storms

LINES, SLOTS, SCENARIOS = 37, 96, 10_000


def hazards() -> Iterator[Row]:
    lines = feeder()
    crews = Repair("lognormal", (6.0, 0.5), crews=6)
    for gust, name in ((40.0, "strong"), (60.0, "extreme")):
        wind = passing(lines, gust)
        seconds, storms = timed(sample_storms, lines, wind, SCENARIOS, 0)
        failed = storms.down.any(axis=1)
        exact = failure_probability(lines, wind)
        error = np.sqrt(exact * (1.0 - exact) / SCENARIOS)
        assert (np.abs(failed.mean(axis=1) - exact) < 5.0 * error + 1e-6).all()
        note = f"{failed.sum(axis=0).mean():.1f} lines out, mean"
        yield below(f"hazard, 10,000 scenarios, {name} storm", seconds, 2.0, "s", note)
    seconds, _ = timed(lambda: sample_storms(lines, wind, SCENARIOS, 0, repair=crews))
    yield below("hazard, 10,000 scenarios, extreme storm, 6 crews", seconds, 2.0, "s")
    rare = passing(lines, 25.0)
    aimed = Sampling(shift=-1.5)
    seconds, rare_storms = timed(lambda: sample_storms(lines, rare, SCENARIOS, 0, sampling=aimed))
    note = f"importance sampling, worth {effective_size(rare_storms):.0f} equally likely ones"
    yield below("hazard, 10,000 scenarios, rare failures", seconds, 2.0, "s", note)
    some = sample_storms(lines, passing(lines, 40.0), 1000, 0)
    seconds, few = timed(reduced, some, 50)
    yield below(
        "hazard, 1,000 scenarios reduced to 50", seconds, 1.0, "s", few.process.split("; ")[1]
    )
    seconds, _ = timed(hazard, lines, wind)
    yield below("hazard, probability per line and slot, exact", seconds, 1.0, "s")
    seconds, _ = timed(failure_probability, lines, wind)
    yield below("hazard, probability per line, exact", 1e3 * seconds, 100.0, "ms")


def feeder(correlation: float = 0.3) -> SpannedLines:
    rng = np.random.default_rng(1)
    spans = rng.integers(20, 101, LINES)
    names = [f"{k + 1}-{k + 2}" for k in range(LINES)]
    return poles_in_series(names, np.repeat(np.arange(LINES), spans), correlation=correlation)


def passing(lines: SpannedLines, gust_mps: float) -> SpanWind:
    """A storm that passes at noon, a little sooner and stronger at some spans than at others."""
    rng = np.random.default_rng(2)
    spans = len(lines.span_line)
    peak = gust_mps * (1.0 + 0.02 * rng.standard_normal(spans))
    noon = SLOTS / 2 + rng.uniform(-2.0, 2.0, spans)
    away = np.abs(np.arange(SLOTS) - noon[:, None])
    return SpanWind(peak[:, None] / (1.0 + away / 12.0), 3.0, 10.0, "land")
