"""How the time of building a program and of `lp` grows with the feeder: LinDistFlow, 24 hours."""

from __future__ import annotations

import importlib.util
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from bench.feeders import SLOTS, feeders
from bench.linear import build
from bench.row import Row, skipped, timed
from resilience.models.backends.highs import Highs
from resilience.models.case_program import horizon
from resilience.models.methods.answer import MethodOptions
from resilience.models.methods.linear import lp

MAX_EXPONENT = 1.3


def growing() -> Iterator[Row]:
    if importlib.util.find_spec("simbench") is None:
        yield skipped("growth", 'needs SimBench: pip install -e ".[data]"')
        return
    sizes, builds, solves = [], [], []
    with tempfile.TemporaryDirectory() as folder:
        cases = feeders(Path(folder))
    for case in cases:
        sizes.append(len(case.network.bus_names))
        turns = [timed(build, case, Highs) for _ in range(3)]
        builds.append(min(seconds for seconds, _ in turns))
        solves.append(timed(lp, horizon(case), MethodOptions())[0])
    for name, spent, most in (("build", builds, None), ("lp", solves, MAX_EXPONENT)):
        exponent = np.polyfit(np.log(sizes), np.log(spent), 1)[0]
        note = ", ".join(f"{n} buses {t:.2g} s" for n, t in zip(sizes, spent, strict=True))
        target, met = ("", None) if most is None else (f"<= n^{most:g}", bool(exponent <= most))
        yield Row(f"{name} time, {SLOTS} slots", f"n^{exponent:.2f}", target, met, note)
