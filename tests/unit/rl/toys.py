"""Two training grounds whose best policy can be derived by hand."""

from __future__ import annotations

import numpy as np
import torch

from resilience.fragility.outages.scenarios import Scenarios
from resilience.rl.ground.env import BatchEnv
from resilience.rl.ground.episodes import EpisodeSampler
from resilience.rl.ground.tape import Tape
from resilience.rl.learning.learner import Learner, Progress
from resilience.rl.networks.nets import network
from resilience.testing.cases import small_case

DAYS = 4
BUYING_PRICE, SHED_PRICE = 3.0, 10.0


def _case(prices: list[float], energy: float, filled: float, shed: float):
    """One load of 1 MWh per slot behind a line that can fail, storage beside it, nothing lossy."""
    slots = len(prices)
    step_h = 24.0 / slots
    return small_case(
        slots=slots * DAYS,
        step_min=60.0 * step_h,
        buses=2,
        lines=[(1, 2, 0.01, 0.01)],
        line_tables=[{"name": "1-2", "breakpoint": True}],
        grid=[
            {
                "bus": "1",
                "import_max_mw": 9.0,
                "export_max_mw": 0.0,
                "import_cost_per_mwh": 1.0,
                "price_profile": "price",
            }
        ],
        load=[{"bus": "2", "p_max_mw": 1.0 / step_h, "shed_cost_per_mwh": shed}],
        ess=[
            {
                "bus": "2",
                "p_max_mw": 1.0 / step_h,
                "e_mwh": energy,
                "soc_min": 0.0,
                "soc_max": 1.0,
                "soc_initial": filled,
                "efficiency_charge": 1.0,
                "efficiency_discharge": 1.0,
                "degradation_cost_per_mwh": 0.0,
            }
        ],
        profiles={"price": prices * DAYS},
    )


def _ground(case, down: np.ndarray, band: str, observer: str) -> BatchEnv:
    """Down: (slots, scenarios) whether the line is, in equally likely scenarios."""
    torch.set_num_threads(1)
    sampler = EpisodeSampler(case, seed=5, end_value_per_mwh=0.0, storms=2)
    n = down.shape[1]
    sampler.storms = Scenarios(sampler.storms.lines, down[None], np.full(n, 1.0 / n))
    return BatchEnv(sampler, band, "none", observer_name=observer)


def arbitrage(band: str = "anchors", observer: str = "full") -> BatchEnv:
    """Prices 1, 1, 3, 3 and 2 MWh that are empty: fill in two, serve in two, 4 $; idle 8 $."""
    case = _case([1.0, 1.0, 3.0, 3.0], 2.0, 0.0, SHED_PRICE)
    return _ground(case, np.zeros((4, 1), bool), band, observer)


def outage(share: float) -> BatchEnv:
    """1 MWh stored, power for 3 $ now and for nothing later, an outage later with a probability.

    Serving now saves 3 $, holding saves 10 $ times the probability.
    """
    case = _case([BUYING_PRICE, 0.0], 1.0, 1.0, SHED_PRICE)
    down = np.zeros((2, 20), bool)
    down[1, : round(20 * share)] = True
    return _ground(case, down, "anchors", "full")


def every_scenario(env: BatchEnv) -> Tape:
    """Each scenario once, on the first day."""
    storms = env.sampler.storms
    first = np.zeros(storms.n, np.intp)
    return env.tape(env.sampler.episodes(first, storms, np.random.default_rng(0)))


def learn(learner: Learner, iterations: int) -> None:
    for k in range(iterations):
        learner.iterate(Progress(k, iterations))


def cost_of(env: BatchEnv, learner: Learner) -> float:
    """$ per episode of what was learned, from the start of the case, without noise."""
    actor = network(learner.network(), env.size, env.units)
    actor.load_state_dict(learner.weights())
    tape = every_scenario(env)
    energy, total = env.start(tape.n), 0.0
    with torch.no_grad():
        for t in range(tape.slots):
            step = env.step(tape, t, energy, actor(env.observe(tape, t, energy)))
            total, energy = total + float(step.cost.mean()), step.energy
    return total
