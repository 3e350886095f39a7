"""Dispatchers over the sixteen test days: how long they take, and how well they decide."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bench.row import Row, below, timed
from resilience.case import load_case
from resilience.case.days import held_out
from resilience.dispatch.registry import DISPATCHERS
from resilience.evaluation.compare import compare
from resilience.fragility.draw import sample_bell
from resilience.fragility.outages.bell import case_bell
from resilience.models.microgrid import Microgrid
from resilience.simulation.simulate import simulate
from resilience.simulation.trajectory import Trajectory
from resilience.simulation.world import World

DAYS, DRAWS = 16, 8
PAPER_S = 3632  # what the paper reports for its MINLP over these days
MAX_OVER_BOUND_PERCENT, MAX_SHED_SHARE = 0.5, 0.1  # shed: of what mpc-blind sheds
MIN_SCORES = {"stochastic": 0.76, "mpc": 0.64, "sddp": 0.68}


def deciding() -> Iterator[Row]:
    for case, name, limit_s in (
        ("ieee33", "mpc-blind", 5.0),
        ("ieee33", "mpc", 10.0),
        ("ieee33-tou", "stochastic", None),
    ):
        seconds, trajectory = timed(_run, case, name)
        decisions = trajectory.cost.shape[0]
        decision_ms = 1e3 * trajectory.seconds / decisions
        if limit_s is None:
            note = f"{case}, {decisions:,} decisions"
            yield below(f"{name}, a decision", decision_ms, 20.0, "ms", note)
        else:
            note = f"{decision_ms:.2f} ms a decision; the paper's MINLP took {PAPER_S:,} s"
            yield below(f"{name} on {case}, {DAYS} days", seconds, limit_s, "s", note)


def _run(case_name: str, method: str) -> Trajectory:
    """One storm path over the test days, building included."""
    case = held_out(load_case(case_name), DAYS)
    storms = sample_bell(case, case_bell(case), 1, 0)
    world = World.build(Microgrid.build(case, "copperplate"), storms)
    return simulate(world, DISPATCHERS[method](world.setting))


def quality() -> Iterator[Row]:
    """The setting of the published prototypes: the forecast is exact, the centre known."""
    for end_value in (0.1, 0.28):
        yield from _on_grid(end_value)
        yield from _on_tou(end_value)


def _on_grid(end_value: float) -> Iterator[Row]:
    report = compare("ieee33-grid", ["stochastic"], days=DAYS, draws=DRAWS,
                     end_value_per_mwh=end_value, workers=2)  # fmt: skip
    over = 100.0 * float(np.mean(report.objective["stochastic"] / report.bound - 1.0))
    name = f"stochastic over the bound, ieee33-grid, end {end_value:g}"
    yield below(name, over, MAX_OVER_BOUND_PERCENT, "%", f"{DAYS} days x {DRAWS} draws")


def _on_tou(end_value: float) -> Iterator[Row]:
    methods = [*MIN_SCORES, "mpc-blind"]
    report = compare("ieee33-tou", methods, days=DAYS, draws=DRAWS,
                     end_value_per_mwh=end_value, workers=2)  # fmt: skip
    frame = report.frame()
    shed = frame["shed_mwh_per_day"]
    for method, min_score in MIN_SCORES.items():
        score = float(frame.loc[method, "score"])
        little = bool(shed[method] <= MAX_SHED_SHARE * shed["mpc-blind"])
        note = f"sheds {shed[method]:.4f} MWh a day, mpc-blind {shed['mpc-blind']:.3f}"
        name = f"score of {method}, ieee33-tou, end {end_value:g}"
        yield Row(name, f"{score:.3f}", f">= {min_score:g}", score >= min_score and little, note)
