"""What a dead island leaves of every kind of device: no power, of either kind and sign."""

from __future__ import annotations

import numpy as np
import pytest

from resilience.models.components import fleet_classes
from resilience.models.components.fleet import DeviceFleet
from resilience.models.network.situation import Situation

UP = np.array([[True, True, False, True, False]])  # the line to bus 1, which has no source


@pytest.mark.parametrize("fleet", fleet_classes(), ids=lambda fleet: fleet.kind)
def test_no_device_gives_or_takes_power_in_a_dead_island(fleet: type[DeviceFleet]) -> None:
    profile = np.array([0.6, 0.7, 0.8, 0.9, 0.5])
    forming = np.array([True, False])
    situation = Situation(
        lambda _: profile, ("0-1",), np.array([[0], [1]]), UP, forming, UP.shape[1]
    )
    data = fleet((fleet.showcase(),), np.array([1])).data(situation)
    limits = {
        name: values
        for name, values in data.items()
        if name.endswith(("_max", "_min", ".available", ".must_take")) and "shed" not in name
    }
    for name, values in limits.items():
        assert (values[:, ~UP[0]] == 0.0).all(), name
    if fleet.kind == "load":  # all demand is shed, and none that can be reached has to be
        dead = np.where(UP, 0.0, data["load.demand"])
        np.testing.assert_array_equal(data["load.shed_min"], dead)
        assert (data["load.demand"] > 0.0).all()
    else:
        assert any((values[:, UP[0]] != 0.0).all() for values in limits.values())
