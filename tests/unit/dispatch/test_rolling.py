"""The programs behind rolling dispatch: trees, numbers, and what they decide by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import resilience as rs
from resilience.arrays import Floats, Ints
from resilience.case import Case
from resilience.dispatch.memory import Memory
from resilience.dispatch.merged_grid import merged_grid
from resilience.dispatch.mpc import MPC
from resilience.dispatch.registry import DISPATCHERS
from resilience.dispatch.stochastic import Stochastic
from resilience.dispatch.window_program import WindowProgram, WindowRequest, WindowSteps
from resilience.fragility.draw import sample_bell
from resilience.fragility.outages.bell import Bell
from resilience.fragility.outages.scenarios import Scenarios
from resilience.models.microgrid import Microgrid
from resilience.models.program.risk import Risk
from resilience.simulation.observation import Forecast, Observation, parts_of
from resilience.simulation.world import World
from resilience.testing import small_case
from tests.unit.dispatch.blackouts import world as blackout_world

WITHOUT_FUEL = {"tank": None, "fuel_m3_per_mwh": None}


def exact(case: Case) -> Forecast:
    return lambda name, at: case.profile(name)[at]


def feeder(shed: float = 10.0, **changes: Any) -> Case:
    """A grid at 1 $/MWh and, behind a breakpoint, 1 MW of load with an empty store."""
    return small_case(
        buses=2,
        lines=[(1, 2, 0.01, 0.01)],
        line_tables=[{"name": "1-2", "breakpoint": True}],
        load=[{"bus": "2", "p_max_mw": 1.0, "shed_cost_per_mwh": shed}],
        ess=[{"bus": "2", "p_max_mw": 5.0, "e_mwh": 9.0, "soc_initial": 0.0}],
        grid=[{"import_max_mw": 9.0, "import_cost_per_mwh": 1.0}],
        **changes,
    )


def worn() -> Case:
    """The feeder with a store that wears at 4 $/MWh."""
    store = {"bus": "2", "p_max_mw": 5.0, "e_mwh": 9.0, "soc_initial": 0.0}
    return small_case(
        buses=2,
        lines=[(1, 2, 0.01, 0.01)],
        line_tables=[{"name": "1-2", "breakpoint": True}],
        load=[{"bus": "2", "p_max_mw": 1.0, "shed_cost_per_mwh": 10.0}],
        ess=[{**store, "degradation_cost_per_mwh": 4.0}],
        grid=[{"import_max_mw": 9.0, "import_cost_per_mwh": 1.0}],
    )


@pytest.mark.parametrize("method", ["mpc-blind", "mpc", "stochastic"])
def test_without_a_storage_there_is_nothing_to_look_ahead_for(method: str) -> None:
    case = feeder().replace(ess=())
    drawn = sample_bell(case, Bell(), 1, 0)
    with pytest.raises(rs.UsageError, match="has no storage; allowed: a case with"):
        DISPATCHERS[method](World.build(Microgrid.build(case, "copperplate"), drawn).setting)


@pytest.mark.parametrize(
    ("price", "dark", "charged"),
    [(10.0, 0.5, 1.0), (0.8, 0.5, 0.0), (10.0, 0.01, 1.0), (0.5, 0.9, 0.0), (3.0, 0.1, 1.0)],
)
def test_a_fan_of_two_paths_equals_its_hand_solution(
    price: float, dark: float, charged: float
) -> None:
    """One slot now, one later with an outage on one of two paths; 1 MW of demand in both.

    A MWh bought now for 1 $ saves the shed price on the dark path and 1 $ on the other, so it is
    bought where dark * price + (1 - dark) > 1: wherever shedding is dearer than the grid.
    """
    case = feeder(price)
    program = WindowProgram(merged_grid(case), WindowSteps(slots=2, blocks=0), 2)
    up = np.ones((1, 2, 2), bool)
    up[0, 1, 1] = False
    share = np.array([1.0 - dark, dark])
    asked = WindowRequest(0, np.zeros(1), up, share, exact(case), np.zeros(1))
    assert program.decide(asked)[0] == pytest.approx(charged)


def test_probabilities_weigh_a_cost_of_having_stored_in_vain() -> None:
    """With wear of 4 $/MWh a MWh bought now saves 10 - 4 on the dark path and nothing on the other:
    it is bought where dark * 6 > 1."""
    case = worn()
    program = WindowProgram(merged_grid(case), WindowSteps(slots=2, blocks=0), 2)
    up = np.ones((1, 2, 2), bool)
    up[0, 1, 1] = False
    for dark, charged in ((0.15, 0.0), (0.18, 1.0)):
        share = np.array([1.0 - dark, dark])
        asked = WindowRequest(0, np.zeros(1), up, share, exact(case), np.zeros(1))
        assert program.decide(asked)[0] == pytest.approx(charged)


def test_the_worst_path_counts_double() -> None:
    """As above, with a weight of 0.5 on CVaR 0.8: of dark = 0.1, all of the worst fifth's dark half
    counts, so a MWh is bought where (0.5 * dark + 0.5 * dark / 0.2) * 6 > 1: at 0.1, not at 0.05.
    The mean alone buys from 1 / 6 on.
    """
    case = worn()
    program = WindowProgram(
        merged_grid(case), WindowSteps(slots=2, blocks=0), 2, risk=Risk(0.8, 0.5)
    )
    up = np.ones((1, 2, 2), bool)
    up[0, 1, 1] = False
    for dark, charged in ((0.1, 1.0), (0.05, 0.0), (0.1, 1.0)):
        share = np.array([1.0 - dark, dark])
        asked = WindowRequest(0, np.zeros(1), up, share, exact(case), np.zeros(1))
        assert program.decide(asked)[0] == pytest.approx(charged)


def test_energy_at_the_end_is_bought_below_its_value_only() -> None:
    case = feeder(slots=6)
    program = WindowProgram(merged_grid(case), WindowSteps(slots=2, blocks=1, block_slots=2), 1)
    up = np.ones((1, 3, 1), bool)
    for value, charged in ((0.9, 0.0), (1.1, 5.0)):
        asked = WindowRequest(0, np.zeros(1), up, np.ones(1), exact(case), np.full(1, value))
        program.solver.update(program.vectors(asked))
        z = program.solver.solve().point
        bought = z[program.standard.columns("ess.charge")].sum()
        assert (bought > 0.0) == (charged > 0.0)


@pytest.mark.parametrize(("risk", "cost"), [(Risk(), 0.356), (Risk(0.8, 0.5), 1.688)])
def test_what_is_left_on_a_path_is_worth_its_share(risk: Risk, cost: float) -> None:
    """3.3 MWh, worth 0.7 $ each at the end. On the dark path 1 MWh of them serves the second slot
    and wears for 4 $: 1 + 4 - 0.7 * 2.3 = 3.39; on the other 1 + 1 - 0.7 * 3.3 = -0.31. The mean is
    0.18 * 3.39 - 0.82 * 0.31; of the worst fifth 0.18 is dark: (0.18 * 3.39 - 0.02 * 0.31) / 0.2.
    """
    case = worn()
    program = WindowProgram(merged_grid(case), WindowSteps(slots=2, blocks=0), 2, risk=risk)
    up = np.ones((1, 2, 2), bool)
    up[0, 1, 1] = False
    share = np.array([0.82, 0.18])
    asked = WindowRequest(0, np.full(1, 3.3), up, share, exact(case), np.full(1, 0.7))
    assert program.decide(asked)[0] == pytest.approx(0.0, abs=1e-9)
    assert program.solver.solve().objective == pytest.approx(cost)


def test_steps_beyond_the_horizon_are_empty() -> None:
    """At the last slot but one, two of six slots are left: the others cost and move nothing."""
    case = feeder(slots=6)
    program = WindowProgram(merged_grid(case), WindowSteps(slots=2, blocks=1, block_slots=4), 1)
    up = np.ones((1, 3, 1), bool)
    asked = WindowRequest(3, np.zeros(1), up, np.ones(1), exact(case), np.zeros(1))
    program.solver.update(program.vectors(asked))
    found = program.solver.solve()
    # Slots 3 and 4, and one of the block's four: 3 MWh at 1 $.
    assert found.objective == pytest.approx(3.0)
    # Slots 4 and 5, and neither a slot nor a block behind them.
    program = WindowProgram(merged_grid(case), WindowSteps(slots=3, blocks=1, block_slots=4), 1)
    up = np.ones((1, 4, 1), bool)
    asked = WindowRequest(4, np.zeros(1), up, np.ones(1), exact(case), np.zeros(1))
    assert program.data(asked)["load.demand"].tolist() == [[1.0, 1.0, 0.0, 0.0]]
    program.solver.update(program.vectors(asked))
    assert program.solver.solve().objective == pytest.approx(2.0)


def test_a_tree_of_slots_and_blocks() -> None:
    steps = WindowSteps(slots=2, blocks=1, block_slots=4)
    assert steps.horizon == 6
    assert steps.starts.tolist() == [0, 1, 2]
    assert steps.width.tolist() == [1, 1, 4]
    tree = steps.tree(3)
    assert tree.n == 7
    assert tree.stage.tolist() == [0, 0, 1, 0, 1, 0, 1]
    assert tree.parent.tolist() == [-1, 0, 1, 0, 3, 0, 5]


def test_far_blocks_stand_behind_the_others_and_are_down_by_halves() -> None:
    """Steps of 1, 1, 2 and 4 slots. A block is down where it is touched, a far one half down."""
    steps = WindowSteps(slots=2, blocks=1, block_slots=2, far_blocks=2, far_slots=4)
    assert steps.width.tolist() == [1, 1, 2, 4, 4]
    assert steps.widths == [1, 2, 4]
    assert (steps.n, steps.horizon) == (5, 12)
    assert steps.tree(2).stage.tolist() == [0, 0, 1, 2, 2, 0, 1, 2, 2]
    paths = np.array([[0, 0, 1, 0, 0, 1, 1, 1, 0, 0, 0], [1, 1, 0, 1, 1, 1, 1, 0, 0, 0, 0]], bool)
    assert steps.down(paths.T[None])[0].T.tolist() == [[0, 1, 1, 0], [1, 1, 1, 0]]


@pytest.mark.parametrize(
    ("longest", "step_h", "hours", "width"),
    [(30, 0.25, 12, 16), (89 * 4, 0.25, 48, 16), (80, 0.25, 20, 16), (89, 1.0, 48, 4)],
)
def test_with_fuel_a_window_covers_the_outage_up_to_two_days(
    longest: int, step_h: float, hours: float, width: int
) -> None:
    steps = WindowSteps.with_fuel(longest, step_h)
    assert (steps.horizon * step_h, steps.far_slots) == (hours, width)


def test_where_there_is_fuel_to_keep_the_fan_looks_two_days_ahead() -> None:
    case = rs.load_case("ieee33-fuel").replace(step_min=15, slots=4 * 96)
    assert Stochastic(blackout_world(case).setting).steps.horizon == 4 * 48
    units = [unit.model_copy(update=WITHOUT_FUEL) for unit in case.generator]
    without = case.replace(tank=[], generator=units)
    assert Stochastic(blackout_world(without).setting).steps == WindowSteps()


def test_devices_that_no_program_can_tell_apart_are_one() -> None:
    """Loads of one price are one; blocks stay alone, as does another price."""
    loads = [
        {"name": name, "p_max_mw": p, "shed_cost_per_mwh": price, "block": block}
        for name, p, price, block in (
            ("a", 1.5, 7.0, False),
            ("b", 0.5, 7.0, False),
            ("c", 0.4, 9.0, False),
            ("d", 0.3, 7.0, True),
            ("e", 0.2, 7.0, True),
        )
    ]
    grid = [{"import_max_mw": 4.0, "import_cost_per_mwh": 2.0}]
    merged = merged_grid(small_case(load=loads, grid=grid)).microgrid.case
    assert [(load.name, load.p_max_mw) for load in merged.load] == [
        ("a+b", pytest.approx(2.0)),
        ("c", 0.4),
        ("d", 0.3),
        ("e", 0.2),
    ]


@pytest.fixture(scope="module")
def world() -> World:
    case = rs.load_case("ieee33-tou").replace(outages=())
    return World.build(Microgrid.build(case, "copperplate"), sample_bell(case, Bell(), 3, 5))


def seen(world: World, t: int) -> Observation:
    energy = np.repeat(world.microgrid.start()["ess.energy"][:, None], world.scenarios.n, axis=1)
    island = world.situation(t).island
    centre = np.full(world.scenarios.n, 48)
    up, data = world.line_up[:, t], world.slot(t).stacked
    return Observation(t, energy, up, island, centre, world.forecast(t), data)


def test_devices_joined_dispatch_alike(world: World) -> None:
    """The smaller program has the optimum of the whole case, at every slot of a stormy day."""
    case, steps = world.microgrid.case, WindowSteps(slots=3, blocks=2)
    small_one = merged_grid(case)
    assert len(small_one.microgrid.case.load) == 4
    assert len(small_one.microgrid.case.generator) == 4
    whole = type(small_one).as_it_is(Microgrid.build(case, "copperplate"))
    programs = [WindowProgram(which, steps, 2) for which in (small_one, whole)]
    rng = np.random.default_rng(3)
    for t in range(0, 96, 7):
        up = np.ones((37, steps.n, 2), bool)
        for line in ("1-2", "2-19", "3-23", "6-26"):
            up[case.network.line(line), 1:] = rng.random((steps.n - 1, 2)) < 0.5
        energy = world.microgrid.start()["ess.energy"] * rng.uniform(0.3, 1.7, 5)
        value = rng.uniform(0.0, 0.5, 5)
        asked = WindowRequest(t, energy, up, np.array([0.3, 0.7]), exact(case), value)
        best = []
        for program in programs:
            program.solver.update(program.vectors(asked))
            best.append(program.solver.solve().objective)
        # HiGHS takes costs that LATER alone parts to be alike.
        assert best[0] == pytest.approx(best[1], rel=1e-7)


def test_the_memory_of_outages_starts_anew_at_midnight(world: World) -> None:
    memory = Memory(world.setting)

    def notice(t: int, failed: Ints) -> None:
        up = np.ones((37, 3), bool)
        up[memory.lines[1], failed] = False
        blank: Floats = np.zeros((5, 3))
        memory.update(
            Observation(
                t, blank, up, blank.astype(np.intp), np.zeros(3, int), world.forecast(0), blank
            )
        )

    notice(40, np.array([0]))
    notice(41, np.array([0]))
    assert memory.since[1].tolist() == [40, -1, -1]
    notice(42, np.array([], int))
    assert memory.since[1, 0] == -1
    assert memory.spent[1, 0]
    notice(96, np.array([], int))
    assert not memory.spent.any()


@pytest.mark.parametrize("kind", [MPC, Stochastic])
def test_who_believes_in_the_bell_remembers_the_present_day(kind: type[MPC | Stochastic]) -> None:
    """At 11:00 of the second day: in one scenario the line was down on the first from 14:00 to
    16:00, in the other it is since 09:00.
    """
    case = feeder(slots=72)
    none = Scenarios(("1-2",), np.zeros((1, 72, 2), bool), np.array([0.4, 0.6]))
    setting = World.build(Microgrid.build(case, "copperplate"), none).setting
    dispatcher = kind(setting)
    blank = np.zeros((1, 2))
    for t in range(36):
        up = np.array([[not 14 <= t < 16, t < 33]])
        noticed = Observation(
            t, blank, up, blank.astype(np.intp), np.array([52, 44]), lambda _, at: blank, blank
        )
        dispatcher.memory.update(noticed)
    quiet, struck = (dispatcher.memory.history(noticed, k) for k in range(2))
    assert (quiet.t, quiet.day, quiet.since[0], quiet.spent[0]) == (11, 1, -1, False)
    assert (struck.t, struck.day, struck.since[0], struck.spent[0]) == (11, 1, 9, True)


def test_a_horizon_that_begins_at_noon_has_its_midnight_after_twelve_hours() -> None:
    case = rs.load_case("ieee33-tou").replace(outages=())
    noon = case.replace(start=case.start.replace(hour=12))
    none = Scenarios(("1-2",), np.zeros((1, 96, 1), bool), np.ones(1))
    memory = Memory(World.build(Microgrid.build(noon, "copperplate"), none).setting)
    assert [memory.clock(t) for t in (0, 47, 48)] == [48, 95, 0]
    assert [memory.day(t) for t in (0, 47, 48)] == [0, 0, 1]


def test_paths_that_are_alike_become_one(world: World) -> None:
    found = Stochastic(world.setting, paths=30)
    calm = seen(world, 0)
    up, share = found._paths(calm, 0)
    assert share.sum() == pytest.approx(1.0)
    used = up[:, :, share > 0.0].reshape(37, -1, (share > 0.0).sum())
    flat = used.reshape(-1, used.shape[2])
    assert np.unique(flat, axis=1).shape[1] == flat.shape[1]
    calm_bell = Stochastic(world.setting, Bell(probability=0.0), paths=30)
    assert calm_bell._paths(calm, 0)[1].tolist() == [1.0]


def test_mpc_keeps_a_reserve_while_a_storm_may_come_and_sells_it_afterwards(world: World) -> None:
    """At 18:00 of a storm centred at 18:00, energy is held; once the lines have failed and are back
    it is sold at the evening's price."""
    energies = []
    for spent in (False, True):
        mpc = MPC(world.setting)
        now = seen(world, 72)
        mpc.memory.down[:, :, 40:52] = spent
        evening = Observation(72, now.energy, np.ones((37, 3), bool), now.island * 0,
                              np.full(3, 72), now.forecast, now.data)  # fmt: skip
        energies.append(parts_of(mpc.act(evening))[0].sum())
    assert energies[0] > energies[1] + 1.0


def kept(final: float | None) -> Case:
    """0.7 MW of load at 90 $/MWh beside a store of 1.2 MWh, of which some has to be left; no grid
    behind the line, which is down for the last three of four hours.
    """
    store = {"bus": "2", "p_max_mw": 0.9, "e_mwh": 3.0, "soc_initial": 0.4}
    return small_case(
        slots=4,
        buses=2,
        lines=[(1, 2, 0.011, 0.013)],
        line_tables=[{"name": "1-2", "breakpoint": True}],
        outages=["1-2@01:00-04:00"],
        load=[{"bus": "2", "p_max_mw": 0.7, "shed_cost_per_mwh": 90.0}],
        ess=[store if final is None else store | {"soc_final_min": final}],
        grid=[{"import_max_mw": 1.1, "import_cost_per_mwh": 4.0}],
    )


@pytest.mark.parametrize(
    ("final", "left", "discharged"),
    [
        (None, 1.1, 0.7),  # nothing has to be left: the load is served
        (0.3, 1.1, 0.2),  # of 1.1 MWh 0.9 stay
        (0.5, 1.1, 0.0),  # 1.5 MWh cannot be had any more: the lack is paid for, no error
    ],
)
def test_energy_that_has_to_be_left_is_kept_or_its_lack_is_priced(
    final: float | None, left: float, discharged: float
) -> None:
    """In the last hour of the horizon, the line down: a MWh served saves 90 $, one lacking costs 90
    $, and discharging wears; so what has to be left stays.
    """
    wear = {"degradation_cost_per_mwh": 0.3}
    case = kept(final)
    case = case.replace(ess=tuple(t.model_copy(update=wear) for t in case.ess))
    program = WindowProgram(merged_grid(case), WindowSteps(2, 0), 1)
    up = np.zeros((1, 2, 1), bool)
    request = WindowRequest(3, np.array([left]), up, np.ones(1), exact(case), np.zeros(1))
    assert program.final_price_per_mwh == 90.0
    (power,) = program.decide(request)
    assert power == pytest.approx(-discharged, abs=1e-6)
    data = program.data(request)
    if final is not None:
        assert data["ess.final_min"][0] == pytest.approx([3.0 * final, 0.0])
        assert data["ess.final_price"][0] == pytest.approx([90.0, 90.0])


@pytest.mark.parametrize("slots", [3, 8, 24])
@pytest.mark.parametrize("stored_mwh", [0.5, 2.0])
def test_of_equal_plans_the_sooner_served_is_taken(slots: int, stored_mwh: float) -> None:
    """A load lacks as much whenever the battery gives what it has: it gives it now."""
    case = feeder(slots=slots)
    program = WindowProgram(merged_grid(case), WindowSteps(slots, 0), 1)
    up = np.ones((len(case.elements), slots, 1), bool)
    up[case.elements.index("1-2")] = False
    energy, worthless = np.array([stored_mwh]), np.zeros(1)
    program.decide(WindowRequest(0, energy, up, np.ones(1), exact(case), worthless))
    plan = program.latest_plan()
    assert plan is not None
    fed_mwh = stored_mwh * case.ess[0].efficiency_discharge
    lacks = np.clip(np.arange(1, slots + 1) - fed_mwh, 0.0, 1.0)
    assert plan.shed_mw == pytest.approx(lacks)
