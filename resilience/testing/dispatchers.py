"""What every dispatcher must keep to, whoever wrote it."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime

import numpy as np

from resilience.arrays import Floats
from resilience.case import Case
from resilience.evaluation.clairvoyant import clairvoyant
from resilience.fragility.outages.scenarios import Scenarios
from resilience.simulation.causality import with_another_future
from resilience.simulation.forecast import ForecastError, sample_outlook
from resilience.simulation.observation import Action, Dispatcher, Observation, parts_of
from resilience.simulation.setting import Setting
from resilience.simulation.simulate import simulate
from resilience.simulation.trajectory import Trajectory
from resilience.simulation.world import World, microgrid_with_fallible_lines
from resilience.testing.cases import small_case

DispatcherFactory = Callable[[Setting], Dispatcher]
LIMIT_TOLERANCE = 1e-9  # MWh and MW
COST_TOLERANCE = 1e-6  # $
FUTURE_TOLERANCE = 1e-7  # MW; what a solver makes of equal programs is equal


def small_world() -> World:
    """Nine hours of the morning on three buses, two unequal batteries, and three scenarios.

    One scenario has no outage; the others cut off bus 3, or bus 2 and with it bus 3. Load and PV
    differ from their forecast.
    """
    case = small_case(
        slots=9,
        start=datetime(2016, 7, 12, 5),
        buses=3,
        lines=[(1, 2, 0.01, 0.02), (2, 3, 0.03, 0.01)],
        line_tables=[{"name": f"{k}-{k + 1}", "breakpoint": True} for k in (1, 2)],
        profiles={
            "load": [0.5, 0.6, 0.8, 0.9, 1.0, 0.9, 0.7, 0.8, 0.9],
            "sun": [0.1, 0.2, 0.4, 0.6, 0.7, 0.8, 0.9, 0.8, 0.6],
            "price": [1.0, 1.0, 1.0, 2.0, 2.0, 3.0, 3.0, 2.0, 1.0],
        },
        terminal_value_per_mwh=0.2,
        load=[
            {"bus": "2", "p_max_mw": 0.7, "profile": "load", "shed_cost_per_mwh": 8.0},
            {"bus": "3", "p_max_mw": 1.1, "profile": "load", "shed_cost_per_mwh": 5.0},
        ],
        pv=[{"bus": "3", "p_max_mw": 0.9, "profile": "sun"}],
        ess=[
            {"bus": "2", "p_max_mw": 0.5, "e_mwh": 1.3, "soc_initial": 0.4},
            {"bus": "3", "p_max_mw": 0.8, "e_mwh": 2.1, "soc_min": 0.15, "soc_initial": 0.6,
             "efficiency_charge": 0.95, "efficiency_discharge": 0.92},
        ],
        generator=[{"bus": "2", "p_max_mw": 0.3, "cost_per_mwh": 0.5}],
        grid=[{"import_max_mw": 4.0, "import_cost_per_mwh": 0.15, "price_profile": "price"}],
    )  # fmt: skip
    down = np.zeros((2, case.slots, 3), bool)
    down[1, 4:7, 1] = True
    down[0, 3:8, 2] = True
    peak = np.full((1, 3), 32)  # 08:00 in slots of 15 minutes
    scenarios = Scenarios(("1-2", "2-3"), down, np.array([0.5, 0.3, 0.2]), peak)
    outlook = sample_outlook(case, ForecastError(), scenarios.n, seed=7)
    grid = microgrid_with_fallible_lines(case, scenarios, "copperplate")
    return World.build(grid, scenarios, outlook=outlook)


def check_dispatcher(
    make_dispatcher: DispatcherFactory, world: World | None = None, *, at_slot: int | None = None
) -> Trajectory:
    """Holds a dispatcher against the rules of the game, in a world of a few slots.

    Actions must have the shape of the storage and be finite, what is stored must stay within its
    limits, nobody may cost less than the clairvoyant bound, and nobody may see the future: where
    two worlds are alike up to a slot, so are the actions. Scenarios are dispatched one by one, as
    in a comparison.

    Args:
        make_dispatcher: makes a fresh one from the setting that it acts in.
        world: where it acts; `small_world()` if omitted.
        at_slot: the last slot that the two worlds have in common; the middle of the horizon if
            omitted.

    Returns:
        What it did in the last scenario.

    Raises:
        AssertionError: the first rule that is broken, with value and what is allowed.
    """
    world, rng = world or small_world(), np.random.default_rng(0)
    slot = world.microgrid.case.slots // 2 if at_slot is None else at_slot
    for k in range(world.scenarios.n):
        episode = world.with_scenarios(np.array([k]))
        trajectory, actions = _run(make_dispatcher, episode)
        _check_limits(episode.microgrid.case, trajectory)
        _check_bound(episode, trajectory)
        _, changed = _run(make_dispatcher, with_another_future(episode, slot, rng))
        difference = np.abs(actions[: slot + 1] - changed[: slot + 1])
        assert difference.max(initial=0.0) <= FUTURE_TOLERANCE, (
            f"{trajectory.name}: in slot {int(difference.max(axis=(1, 2)).argmax())} it acts on "
            f"what happens after slot {slot}; hint: use the observation alone, and random numbers "
            "of a stream that `setting.numbers` keys"
        )
    return trajectory


class _Recorder:
    """Passes observations on to a dispatcher and notes its actions."""

    def __init__(self, dispatcher: Dispatcher, case: Case) -> None:
        self.name, self.dispatcher = dispatcher.name, dispatcher
        self.burners = sum(unit.tank is not None for unit in case.generator)
        self.actions: list[Floats] = []

    def act(self, observation: Observation) -> Action:
        """The dispatcher's action, if it is one."""
        action = self.dispatcher.act(observation)
        decision, shape = parts_of(action), observation.energy.shape
        assert np.shape(decision.power) == shape, (
            f"{self.name}: action of shape {np.shape(decision.power)}; allowed: {shape}, "
            "(units, batch)"
        )
        carried = {
            "on": ("generator.on", "committed generators"),
            "closed": ("line.closed", "switchable lines"),
            "ramped_mw": ("generator.p_before", "generators with a ramp"),
        }
        rows = {"burner_mw": (self.burners, "generators with a tank")} | {
            key: (len(observation.states.get(state, ())), devices)
            for key, (state, devices) in carried.items()
        }
        for key, (n, devices) in rows.items():
            values = getattr(decision, key)
            assert values is None or np.shape(values) == (n, shape[1]), (
                f"{self.name}: {key} of shape {np.shape(values)}; allowed: {(n, shape[1])}, "
                f"({devices}, batch)"
            )
        for key, values in decision._asdict().items():
            finite = values is None or np.isfinite(values).all()
            assert finite, f"{self.name}: {key} {values}; allowed: finite numbers"
        stated = [np.array(values, float) for values in decision if values is not None]
        self.actions.append(np.concatenate(stated))
        return action


def _run(make_dispatcher: DispatcherFactory, world: World) -> tuple[Trajectory, Floats]:
    """What a fresh dispatcher does, and its actions, (slots, units, batch)."""
    recorder = _Recorder(make_dispatcher(world.setting), world.microgrid.case)
    trajectory = simulate(world, recorder)
    return trajectory, np.array(recorder.actions)


def _check_limits(case: Case, trajectory: Trajectory) -> None:
    for k, unit in enumerate(case.ess):
        stored, power = trajectory.energy[k], trajectory.storage[k]
        low, high = unit.soc_min * unit.e_mwh, unit.soc_max * unit.e_mwh
        assert (stored >= low - LIMIT_TOLERANCE).all(), f"{unit.name}: below {low:g} MWh"
        assert (stored <= high + LIMIT_TOLERANCE).all(), f"{unit.name}: above {high:g} MWh"
        limit = max(unit.p_max_mw, -unit.p_min_mw)
        assert (np.abs(power) <= limit + LIMIT_TOLERANCE).all(), f"{unit.name}: above {limit:g} MW"


def _check_bound(world: World, trajectory: Trajectory) -> None:
    objective = trajectory.objective(world.end_value_per_mwh)
    bound = clairvoyant(world).objective
    assert (objective >= bound - COST_TOLERANCE).all(), (
        f"{trajectory.name}: objective {objective} $; allowed: at least the bound {bound} $"
    )
