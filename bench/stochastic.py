"""Two-stage programs: 16 slots before the event in common, 32 of recourse for every scenario.

The grid, at a time-of-use tariff, fails at a random time for a random length; on 33 buses three
random lines fail as well.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from datetime import datetime

import numpy as np

from bench.row import Row, below, timed
from resilience.case import Case, load_case
from resilience.fragility.outages.scenarios import Scenarios
from resilience.planning.scenarios.program import (
    DistinctScenarios,
    ScenarioProgram,
    scenario_program,
)
from resilience.planning.two_stage.lshaped import DecompositionOptions, TwoStageSolution, lshaped
from resilience.simulation.world import microgrid_with_fallible_lines

COMMON, RECOURSE = 16, 32
GAP = 1e-4
FAILED_LINES = 3


def programs() -> Iterator[Row]:
    dear = load_case("ieee33-tou")
    case = load_case("ieee33-grid").replace(
        start=datetime(2016, 7, 12, 10),
        slots=COMMON + RECOURSE,
        outages=(),
        grid=dear.grid,
        load=dear.load,
        terminal_value_per_mwh=dear.terminal_value_per_mwh,
    )
    yield _row("stochastic, single bus, 1000 scenarios", case, "copperplate", 1000, 0, 6.0)
    yield _row("stochastic, 33 buses, 200 scenarios", case, "lindistflow", 200, FAILED_LINES, 30.0)


def outages(case: Case, n: int, more: int, seed: int = 0) -> Scenarios:
    """`n` scenarios: line 1-2 fails in one of the slots after the common ones, for 8 to 24."""
    rng = np.random.default_rng(seed)
    network = case.network
    closed = [n for n, on in zip(network.line_names, network.in_service, strict=True) if on]
    closed.remove("1-2")
    down = np.zeros((1 + len(closed), case.slots, n), bool)
    for k in range(n):
        for line in (0, *(1 + rng.choice(len(closed), more, replace=False))):
            first = rng.integers(COMMON, case.slots - 8)
            down[line, first : first + rng.integers(8, 25), k] = True
    chance = rng.random(n) + 0.5
    return Scenarios(("1-2", *closed), down, chance / chance.sum(), seed=seed)


def _row(name: str, case: Case, physics: str, n: int, more: int, limit_s: float) -> Row:
    scenarios = outages(case, n, more)

    def solve() -> tuple[ScenarioProgram, TwoStageSolution]:
        microgrid = microgrid_with_fallible_lines(case, scenarios, physics)
        program = scenario_program(
            microgrid, DistinctScenarios.among(scenarios, case), common_slots=COMMON
        )
        options = DecompositionOptions(
            gap=GAP, workers=os.cpu_count() or 1, start=program.mean_states()
        )
        return program, lshaped(program.two_stage, options)

    seconds, (program, solution) = timed(solve)
    assert solution.status == "optimal"
    gap = (solution.objective - solution.bound) / abs(solution.objective)
    note = f"{program.distinct.n} different, {solution.iterations} rounds, gap {gap:.1e}"
    return below(name, seconds, limit_s, "s", note)
