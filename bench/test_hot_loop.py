"""What runs most often, for `pytest bench --benchmark-compare` between commits."""

from __future__ import annotations

from itertools import cycle

import numpy as np
from pytest_benchmark.fixture import BenchmarkFixture

from bench.linear import WINDOW, build, relaxed, windows
from resilience.case import load_case
from resilience.models.backends.highs import Highs
from resilience.models.case_program import horizon


def test_build_of_96_slots(benchmark: BenchmarkFixture) -> None:
    benchmark(build, load_case("ieee33"), Highs)


def test_vectors_of_96_slots(benchmark: BenchmarkFixture) -> None:
    program = horizon(load_case("ieee33"))
    benchmark(program.standard.vectors, program.data, program.x0)


def test_resolve_of_8_slots(benchmark: BenchmarkFixture) -> None:
    case = load_case("ieee33")
    day, window = horizon(case), horizon(case.replace(slots=WINDOW)).standard
    starts = cycle(windows(day, window, np.arange(case.slots - WINDOW)))
    solver = Highs(relaxed(window), duals=False)

    def step() -> None:
        data, x0 = next(starts)
        solver.update(window.vectors(data, x0))
        assert solver.solve().status == "optimal"

    benchmark(step)
