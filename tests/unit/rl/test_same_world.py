"""Training is acting: the same numbers are observed, and the same acts cost the same."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="learners need torch")

import resilience as rs  # noqa: E402
from resilience.arrays import Floats  # noqa: E402
from resilience.evaluation.clairvoyant import Replay  # noqa: E402
from resilience.fragility.outages.scenarios import Scenarios  # noqa: E402
from resilience.models.microgrid import Microgrid  # noqa: E402
from resilience.rl.ground.env import BatchEnv  # noqa: E402
from resilience.rl.ground.episodes import EpisodeSampler  # noqa: E402
from resilience.rl.ground.observe import Observer  # noqa: E402
from resilience.simulation.causality import with_another_future  # noqa: E402
from resilience.simulation.forecast import ForecastError  # noqa: E402
from resilience.simulation.observation import Observation  # noqa: E402
from resilience.simulation.setting import Setting  # noqa: E402
from resilience.simulation.simulate import simulate  # noqa: E402
from resilience.simulation.world import World  # noqa: E402
from resilience.testing import small_case, small_world  # noqa: E402
from tests.unit.rl.grounds import world_of  # noqa: E402


class Watcher:
    """Notes what it sees, in numbers, and charges by turns."""

    def __init__(self, setting: Setting) -> None:
        self.name, self.observer = "watcher", Observer(setting)
        self.observed: list[Floats] = []
        self.energy: list[Floats] = []

    def act(self, observation: Observation) -> Floats:
        self.observed.append(self.observer.observed(observation))
        self.energy.append(observation.energy)
        return np.full_like(observation.energy, 0.7 if observation.t % 5 < 3 else -0.9)


@pytest.mark.parametrize(
    ("days", "error", "known"), [(1, None, True), (3, ForecastError(), False), (2, None, False)]
)
def test_training_sees_what_acting_sees_bit_by_bit(
    days: int, error: ForecastError | None, known: bool
) -> None:
    sampler = EpisodeSampler(
        rs.load_case("ieee33-tou"),
        days=days,
        seed=5,
        forecast_error=error,
        known_centre=known,
        storms=40,
    )
    env = BatchEnv(sampler)
    tape = env.draw(3, 17)
    assert not tape.episodes.line_up.all()
    for k in range(3):
        world = world_of(sampler, tape.episodes, k)
        watcher = Watcher(world.setting)
        simulate(world, watcher)
        assert watcher.observer.schema == Observer(env.setting).schema
        # Behind the last day of a world its last slot is repeated, where training sees the next.
        inside = tape.slots - int(watcher.observer.ahead[-1])
        for t in range(inside):
            stored = torch.as_tensor(watcher.energy[t], dtype=torch.float32).repeat(1, 3)
            there = env.observe(tape, t, stored)[k].numpy()
            np.testing.assert_array_equal(there, watcher.observed[t][0])


def test_an_observation_does_not_depend_on_the_days_at_hand() -> None:
    """Else no policy could act on other days than those it was trained on."""
    whole = rs.load_case("ieee33-tou")
    schemas = set()
    for day in (1, 9, 30):
        case = whole.replace(start=whole.start.replace(month=7, day=day), slots=96)
        schemas.add(Observer(calm(case)).schema)
    assert len(schemas) == 1


def calm(case: rs.Case) -> Setting:
    """A setting of the case on these days, in which no line fails."""
    none = Scenarios(("1-2",), np.zeros((1, case.slots, 1), bool), np.ones(1))
    return World.build(Microgrid.build(case, "copperplate"), none).setting


def test_nothing_that_comes_later_is_seen() -> None:
    world = small_world()
    for slot in (2, 4, 6):
        both = []
        for there in (world, with_another_future(world, slot, np.random.default_rng(0))):
            watcher = Watcher(there.setting)
            simulate(there, watcher)
            both.append(np.array(watcher.observed))
        np.testing.assert_array_equal(both[0][: slot + 1], both[1][: slot + 1])
        assert (both[0] != both[1]).any()


def played(env: BatchEnv, tape: Any, start: Any) -> tuple[Floats, Floats]:
    """(batch,) $ of episodes, and (units, slots, batch) MW asked for: first down, then anything."""
    rng = np.random.default_rng(3)
    energy, cost, asked = start, torch.zeros(tape.n, dtype=env.dtype), []
    with torch.no_grad():
        for t in range(tape.slots):
            output = rng.uniform(-1.0, 1.0, (tape.n, env.units))
            output[:, 1:] = np.where(t % 40 < 25, -1.0, output[:, 1:])
            asked.append(env.power(tape, t, energy, env.tensor(output)).numpy().astype(float))
            step = env.step(tape, t, energy, env.tensor(output))
            energy, cost = step.energy, cost + step.cost
    return cost.numpy(), np.array(asked).swapaxes(0, 1)


def sunny() -> rs.Case:
    """Four days by the hour: behind a line that fails, sun and a load live by a battery alone."""
    hour = np.arange(96) % 24
    return small_case(
        slots=96,
        buses=2,
        lines=[(1, 2, 0.01, 0.02)],
        line_tables=[{"name": "1-2", "breakpoint": True}],
        profiles={
            "sun": (0.4 + 0.3 * np.cos(hour / 7.0)).tolist(),
            "demand": (0.6 + 0.3 * np.cos(hour / 5.0)).tolist(),
        },
        terminal_value_per_mwh=0.2,
        load=[{"bus": "2", "p_max_mw": 0.7, "profile": "demand", "shed_cost_per_mwh": 8.0}],
        pv=[{"bus": "2", "p_max_mw": 0.9, "profile": "sun"}],
        ess=[{"bus": "2", "p_max_mw": 0.5, "e_mwh": 1.3, "soc_initial": 0.4, "soc_min": 0.15}],
        grid=[{"import_max_mw": 4.0, "import_cost_per_mwh": 0.15}],
    )


@pytest.mark.parametrize(
    "case", ["ieee33-tou", "sunny", pytest.param("ieee33_koinu", marks=pytest.mark.slow)]
)
@pytest.mark.parametrize(("dtype", "tolerance"), [("float64", 1e-9), ("float32", 1e-4)])
def test_what_was_played_costs_the_same_in_the_world(
    case: str, dtype: str, tolerance: float
) -> None:
    """In two of them it depends on stored energy which islands are alive."""
    sampler = EpisodeSampler(sunny() if case == "sunny" else rs.load_case(case), seed=8, storms=6)
    env = BatchEnv(sampler, "affine", dtype=getattr(torch, dtype))
    tape = env.draw(3, 4)
    assert tape.episodes.has_energy_islands == (case != "ieee33-tou")
    cost, asked = played(env, tape, env.start(3))
    for k in range(3):
        world = world_of(sampler, tape.episodes, k)
        run = simulate(world, Replay("played", asked[:, :, [k]]))
        assert run.cost.sum() == pytest.approx(cost[k], rel=tolerance)


def test_islands_die_in_training_where_storage_is_empty() -> None:
    """Where they were looked at once, episodes would cost less: the sun would serve the load."""
    env = BatchEnv(EpisodeSampler(sunny(), seed=8, storms=30), "affine", dtype=torch.float64)
    tape = env.draw(8, 4)
    empty = env.tensor(np.repeat(env.simulator.low, 8, axis=1))
    costs = [
        env.simulator.step_ready(empty, torch.zeros_like(empty), now.ready).cost.sum().item()
        for t in range(tape.slots)
        for now in (tape.now(t), env.now(tape, t, empty))
    ]
    assert sum(costs[1::2]) > sum(costs[0::2]) + 1.0
