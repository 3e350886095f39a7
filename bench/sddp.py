"""Stochastic dual dynamic programming: one storm centre from scratch, and decisions with it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bench.row import Row, below, timed
from resilience.case import load_case
from resilience.case.days import held_out
from resilience.dispatch.sddp.book import Book
from resilience.dispatch.sddp.policy import PATHS, Sddp
from resilience.fragility.draw import sample_bell
from resilience.fragility.outages.bell import Bell
from resilience.models.microgrid import Microgrid
from resilience.simulation.simulate import simulate
from resilience.simulation.world import World
from resilience.testing.policies import simulated_costs

CASE, CENTRE, DRAWS, SIMULATED = "ieee33-tou", 56, 8, 200
MAX_BUILD_S = 10.0


def training() -> Iterator[Row]:
    case = held_out(load_case(CASE), 1)
    bell = Bell(centres=(CENTRE,))
    world = World.build(Microgrid.build(case, "copperplate"), sample_bell(case, bell, DRAWS, 0))
    book = Book(case, bell, cache=False)
    _, end = book.ends(world.end_value_per_mwh)
    seconds, cuts = timed(book.cut_set, CENTRE, end)
    begin = book.start, book.climate.levels.mean(axis=0)
    bound = cuts.trained.root.value(*begin)
    rng = np.random.default_rng(0)
    costs = simulated_costs(cuts.multistage, cuts.trained, begin, SIMULATED, rng)
    error = costs.std() / np.sqrt(SIMULATED)
    note = f"bound {bound:.2f} $, {SIMULATED} simulated days {costs.mean():.2f} ± {error:.2f} $"
    yield below(f"sddp, one storm centre of {CASE}", seconds, MAX_BUILD_S, "s", note)
    for paths, name in ((0, "cuts alone"), (PATHS, f"{PATHS} paths and cuts")):
        trajectory = simulate(world, Sddp(world.setting, book, paths=paths))
        decision_ms = 1e3 * trajectory.seconds / trajectory.cost.size
        measured = f"{decision_ms:.3g} ms"
        yield Row(f"sddp, a decision, {name}", measured, "", None, f"{DRAWS} at a time")
