"""Bounds and objectives against independent oracles, over the range that a case may state.

`RESILIENCE_RANDOM_CASES=500` asks for that many cases of each kind, for maintainers.
"""

from __future__ import annotations

import os
from collections.abc import Iterable

import numpy as np
import pytest

from resilience.dispatch.registry import DISPATCHERS
from resilience.errors import InfeasibleError, UsageError
from resilience.evaluation.clairvoyant import clairvoyant
from resilience.fragility.outages.scenarios import Scenarios
from resilience.models.case_program import status
from resilience.models.microgrid import Microgrid, Physics
from resilience.simulation.simulate import simulate
from resilience.simulation.world import World
from resilience.testing import small_case
from tests.known.solving import solved
from tests.property.oracles import Document, Scene, ac_point, linear_optimum, random_document

MORE = int(os.environ.get("RESILIENCE_RANDOM_CASES", "60"))
SCALES_MW = (0.15, 1.0, 18.0, 1e-3)
GAP = 1e-5
SPILLED = (104, 232, 282)
"""A sun that nobody can turn down is too much, and paid for what it brings."""
TWO_MODES_IN_AC = 108
"""Its storage keeps to one mode in the cone relaxation, and burns in two in the AC equations."""


def seeds(few: int, *more: int) -> Iterable[object]:
    """A few in every run, the others with the slow tests."""
    others = [seed for seed in range(few, MORE) if seed not in more]
    slow = [pytest.param(seed, marks=pytest.mark.exhaustive) for seed in others]
    return [*range(few), *more, *slow]


def drawn(seed: int, *, ac: bool) -> tuple[Document, float]:
    """A document and the size of its powers."""
    rng = np.random.default_rng([seed, int(ac)])
    scale = SCALES_MW[seed % len(SCALES_MW)]
    return random_document(rng, ac=ac, scale=scale), scale


@pytest.mark.parametrize("physics", ["copperplate", "lindistflow"])
@pytest.mark.parametrize("seed", seeds(24))
def test_a_linear_plan_and_its_bound_are_the_oracles_optimum(seed: int, physics: Physics) -> None:
    document, scale = drawn(seed, ac=False)
    voltages = physics == "lindistflow"
    if voltages:
        # A rating is a disc there, of which a linear oracle knows nothing.
        tables = [{**table, "rating_mva": np.inf} for table in document["line_tables"]]
        document = {**document, "line_tables": tables}
        for table in tables:
            del table["rating_mva"]
    optimum = linear_optimum(document, voltages=voltages, scale=scale)
    case, dust = small_case(**document), 1e-6 * Scene.of(document).turnover
    method = ("lp", "milp")[seed // 2 % 2]
    if optimum == np.inf:
        with pytest.raises(InfeasibleError):
            solved(case, method, physics, gap=GAP)
        return
    found = solved(case, method, physics, gap=GAP)
    assert found.bound <= optimum + dust
    assert found.answer.status == "optimal"
    assert found.objective == pytest.approx(optimum, rel=2 * GAP, abs=dust)
    assert max(found.near_limits.values(), default=0.0) == 0.0


@pytest.mark.parametrize("seed", seeds(12, TWO_MODES_IN_AC))
def test_no_bound_is_above_an_ac_plan(seed: int) -> None:
    document, scale = drawn(seed, ac=True)
    reached = ac_point(document, scale=scale)
    case, dust = small_case(**document), 2e-6 * Scene.of(document).turnover
    if reached == np.inf:
        pytest.skip("Ipopt found no AC plan")
    found = solved(case, "minlp", gap=1e-4)
    assert found.bound <= reached + dust
    if found.answer.status == "optimal":
        assert found.objective <= reached + 2e-4 * abs(reached) + dust
    assert max(found.near_limits.values(), default=0.0) == 0.0


@pytest.mark.parametrize("seed", seeds(16, *SPILLED))
def test_no_dispatcher_is_below_the_clairvoyant_bound(seed: int) -> None:
    document, scale = drawn(seed, ac=False)
    case = small_case(**document)
    down = ~status(case)[:, :, None]
    storms = Scenarios(case.network.line_names, down, np.ones(1))
    try:
        world = World.build(Microgrid.build(case, "copperplate"), storms)
    except UsageError as error:
        pytest.skip(error.message)
    (bound,) = clairvoyant(world).objective
    planners = ("mpc-blind", "mpc", "stochastic") if case.ess else ()
    for method in ("idle", "greedy", "rule", *planners):
        run = simulate(world, DISPATCHERS[method](world.setting))
        (cost,) = run.objective(world.end_value_per_mwh)
        assert cost >= bound - 1e-6 * (abs(bound) + scale), method
