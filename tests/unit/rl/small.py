"""A microgrid of two buses whose days are quickly learned, and trainings of a second on it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import resilience as rs
from resilience.case import OutageTable
from resilience.rl.ground.episodes import EpisodeSampler
from resilience.testing.cases import small_case

SETTINGS: dict[str, Any] = {"batch": 3, "hidden": (5,), "learning_rate": 0.01}


def small_storm_case(days: int = 8, step_h: int = 2) -> rs.Case:
    """Days of some hours a slot; a line that storms take down is between the grid and all else."""
    hours = np.arange(0, 24 * days, step_h)
    shape = 0.6 + 0.3 * np.sin(2 * np.pi * hours / 24 + 0.3 * (hours // 24))
    light = np.maximum(np.sin(2 * np.pi * (hours % 24 - 6) / 24), 0.0)
    price = np.where((hours % 24 >= 17) & (hours % 24 < 22), 2.3, 0.7)
    case = small_case(
        slots=len(hours),
        step_min=60.0 * step_h,
        buses=2,
        lines=[(1, 2, 0.001, 0.002)],
        line_tables=[{"name": "1-2", "breakpoint": True}],
        profiles={
            "shape": shape.tolist(),
            "light": light.tolist(),
            "price": price.tolist(),
        },
        terminal_value_per_mwh=0.35,
        grid=[
            {
                "import_max_mw": 9.0,
                "export_max_mw": 9.0,
                "import_cost_per_mwh": 1.1,
                "export_cost_per_mwh": -0.2,
                "price_profile": "price",
            }
        ],
        load=[{"bus": "2", "p_max_mw": 2.2, "shed_cost_per_mwh": 31.0, "profile": "shape"}],
        pv=[{"bus": "2", "p_max_mw": 1.3, "profile": "light"}],
        ess=[
            {
                "bus": "2",
                "p_max_mw": 1.6,
                "e_mwh": 5.5,
                "soc_min": 0.1,
                "soc_max": 0.95,
                "soc_initial": 0.45,
                "efficiency_charge": 0.93,
                "efficiency_discharge": 0.94,
                "degradation_cost_per_mwh": 0.05,
            },
            {
                "bus": "2",
                "p_max_mw": 0.7,
                "e_mwh": 1.9,
                "soc_min": 0.15,
                "soc_max": 0.9,
                "soc_initial": 0.6,
                "efficiency_charge": 0.91,
                "efficiency_discharge": 0.96,
                "degradation_cost_per_mwh": 0.07,
            },
        ],
        generator=[{"bus": "2", "p_max_mw": 0.4, "cost_per_mwh": 0.9}],
        outages=["1-2@14:00-17:00"],
    )
    return case.replace(
        outage=OutageTable(
            probability=0.7, centres=(40, 64), duration_slots=(16, 32), sigma_slots=6
        )
    )


def few_storms(monkeypatch: pytest.MonkeyPatch, storms: int = 40) -> None:
    """Fewer outage paths to draw batches from: they take most of the time of a small training."""
    monkeypatch.setitem(keyword_defaults(), "storms", storms)


def keyword_defaults() -> dict[str, Any]:
    """Those of what draws episodes."""
    defaults = EpisodeSampler.__init__.__kwdefaults__
    assert defaults is not None
    return defaults
