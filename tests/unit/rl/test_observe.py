"""What a policy is told of lines and of the time, by hand."""

from __future__ import annotations

import math
from dataclasses import replace
from datetime import timedelta

import numpy as np
import pytest

from resilience.case import Case
from resilience.case.schema.storm import StormTable
from resilience.fragility.outages.scenarios import Scenarios
from resilience.models.microgrid import Microgrid
from resilience.rl.ground.observe import Observer
from resilience.simulation.observation import Observation
from resilience.simulation.setting import Setting
from resilience.simulation.simulate import simulate
from resilience.simulation.world import World
from resilience.testing import small_case


class Watcher:
    """Notes what it is told, block by block, and leaves the storage alone."""

    def __init__(self, setting: Setting) -> None:
        self.name, self.observer = "watcher", Observer(setting)
        self.told: list[dict[str, list[list[float]]]] = []

    def act(self, observation: Observation) -> np.ndarray:
        numbers = self.observer.observed(observation).T.astype(float)
        blocks = self.observer.blocks
        ends = np.cumsum([len(block.labels) for block in blocks])[:-1]
        parts = zip(blocks, np.split(numbers, ends), strict=True)
        self.told.append({block.name: part.tolist() for block, part in parts})
        return np.zeros_like(observation.energy)


def feeder(*, storm: bool) -> Case:
    """36 slots of an hour; half the load and a store stand behind a line that can fail."""
    case = small_case(
        slots=36,
        buses=2,
        lines=[(1, 2, 0.011, 0.013)],
        line_tables=[{"name": "1-2", "breakpoint": True}],
        load=[{"bus": "2", "p_max_mw": 0.8, "shed_cost_per_mwh": 9.0}],
        ess=[{"bus": "2", "p_max_mw": 0.7, "e_mwh": 2.3}],
        grid=[{"import_max_mw": 1.7, "import_cost_per_mwh": 2.0}],
    )
    hours = (case.start + timedelta(hours=h) for h in (0, 18, 36))
    points = tuple((hour, 18.0 + k, 112.0, 955.0, 43.0) for k, hour in enumerate(hours))
    over = StormTable(points=points, averaging_s=60.0)
    return replace(case, storm=over) if storm else case  # where the buses are does not matter here


@pytest.mark.parametrize(
    ("storm", "failed_before", "horizon_left"),
    [(False, [0.0, 0.0], 0.0), (True, [1.0, 1.0], 10 / 36)],
    ids=["bell", "storm"],
)
def test_a_storm_is_one_and_other_days_begin_anew_at_midnight(
    storm: bool, failed_before: list[float], horizon_left: float
) -> None:
    """Slot 26 of 36, 02:00 to 03:00: in one scenario the line was down from 14:00 to 16:00 the day
    before, in the other it is since 22:00, which no midnight ends. 4 h are 1.
    """
    down = np.zeros((1, 36, 2), bool)
    down[0, 14:16, 0] = True
    down[0, 22:28, 1] = True
    case = feeder(storm=storm)
    scenarios = Scenarios(("1-2",), down, np.array([0.4, 0.6]))
    world = World.build(Microgrid.build(case, "copperplate"), scenarios)
    watcher = Watcher(world.setting)
    simulate(world, watcher)
    told = watcher.told[26]
    assert told["line_up"] == [[1.0, 0.0]]
    assert told["line_down_h"] == [pytest.approx([0.0, 5.0 / 4.0])]
    assert told["line_failed_before"] == [failed_before]
    sin, cos, left = (row[0] for row in told["clock"])
    assert (sin, cos) == pytest.approx((math.sin(math.pi / 6), math.cos(math.pi / 6)))
    assert left == pytest.approx(horizon_left)
