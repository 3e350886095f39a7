"""Random small microgrids: one to three buses in a row, a few devices, two or three slots."""

from __future__ import annotations

from typing import Any

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

from resilience.case import Case
from resilience.testing import small_case

quick = settings(
    deadline=None,
    derandomize=True,
    database=None,
    max_examples=15,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
"""The same few examples every time, so that a failure is there again on the next run."""


def number(low: float, high: float) -> st.SearchStrategy[float]:
    """Numbers with two decimals: simple enough to read, odd enough to have no ties."""
    return st.integers(round(low * 100), round(high * 100)).map(lambda k: k / 100)


shares = st.lists(number(0.1, 1.0), min_size=3, max_size=3)


def loads(buses: int, blocks: bool) -> st.SearchStrategy[list[dict[str, Any]]]:
    load = st.fixed_dictionaries(
        {
            "bus": st.integers(1, buses).map(str),
            "p_max_mw": number(0.2, 1.5),
            "profile": st.just("demand"),
            "power_factor": number(0.9, 1.0),
            "shed_cost_per_mwh": number(5, 20),
            "block": st.booleans() if blocks else st.just(False),
        }
    )
    return st.lists(load, min_size=1, max_size=2)


def plants(buses: int) -> st.SearchStrategy[list[dict[str, Any]]]:
    plant = st.fixed_dictionaries(
        {
            "bus": st.integers(1, buses).map(str),
            "p_max_mw": number(0.2, 1.5),
            "profile": st.just("sun"),
            "cost_per_mwh": number(0, 1),
            "s_mva": number(1.5, 2.0),
        }
    )
    return st.lists(plant, max_size=1)


def batteries(buses: int) -> st.SearchStrategy[list[dict[str, Any]]]:
    battery = st.fixed_dictionaries(
        {
            "bus": st.integers(1, buses).map(str),
            "p_max_mw": number(0.2, 1.0),
            "e_mwh": number(0.5, 3.0),
            "soc_min": number(0.0, 0.2),
            "soc_initial": number(0.2, 1.0),
            "efficiency_charge": number(0.8, 1.0),
            "efficiency_discharge": number(0.8, 1.0),
            "degradation_cost_per_mwh": number(0.1, 1.0),
            "s_mva": number(1.0, 1.5),
        }
    )
    return st.lists(battery, max_size=1)


def generators(buses: int, memory: bool) -> st.SearchStrategy[list[dict[str, Any]]]:
    """With `memory` also minimum times and ramps, which an outage may lift."""
    hours = number(0.0, 2.0) if memory else st.just(0.0)
    unit = st.fixed_dictionaries(
        {
            "bus": st.integers(1, buses).map(str),
            "p_min_mw": st.sampled_from([0.0, 0.3]),
            "p_max_mw": number(0.3, 1.5),
            "cost_per_mwh": number(2, 8),
            "no_load_cost_per_h": number(0, 1),
            "start_cost": number(0, 2),
            "min_up_h": hours,
            "min_down_h": hours,
            "q_min_mvar": st.just(-0.5),
            "q_max_mvar": st.just(0.5),
        },
        optional={"ramp_up_mw_per_h": number(0.3, 1.0)} if memory else {},
    )
    return st.lists(unit, max_size=1)


@st.composite
def documents(draw: st.DrawFn, *, blocks: bool = True, memory: bool = True) -> dict[str, Any]:
    """The arguments of `small`."""
    buses = draw(st.integers(1, 3))
    slots = draw(st.integers(2, 3))
    lines = [
        (k, k + 1, draw(number(0.01, 0.03)), draw(number(0.01, 0.03))) for k in range(1, buses)
    ]
    outages = []
    if buses > 1 and draw(st.booleans()):
        k, first = draw(st.integers(1, buses - 1)), draw(st.integers(0, slots - 1))
        outages = [f"{k}-{k + 1}@{first:02d}:00-{slots:02d}:00"]
    grid = {
        "import_max_mw": draw(number(0.5, 3.0)),
        "export_max_mw": draw(number(0.1, 1.0)),
        "import_cost_per_mwh": draw(number(1, 5)),
        "export_cost_per_mwh": draw(number(-1, 1)),
        "price_profile": "price",
        "q_max_mvar": 2.0,
    }
    return {
        "slots": slots,
        "buses": buses,
        "lines": lines,
        "outages": outages,
        "profiles": {name: draw(shares)[:slots] for name in ("demand", "sun", "price")},
        "terminal_value_per_mwh": draw(number(0, 3)),
        "load": draw(loads(buses, blocks)),
        "pv": draw(plants(buses)),
        "ess": draw(batteries(buses)),
        "generator": draw(generators(buses, memory)),
        "grid": [grid],
    }


PRICES = (
    "shed_cost_per_mwh",
    "cost_per_mwh",
    "degradation_cost_per_mwh",
    "no_load_cost_per_h",
    "start_cost",
    "import_cost_per_mwh",
    "export_cost_per_mwh",
)


def dearer(document: dict[str, Any], factor: float) -> Case:
    """The case with all its prices multiplied."""
    changed = {**document, "terminal_value_per_mwh": document["terminal_value_per_mwh"] * factor}
    for kind in ("load", "pv", "ess", "generator", "grid"):
        changed[kind] = [
            {key: value * factor if key in PRICES else value for key, value in table.items()}
            for table in document[kind]
        ]
    return small_case(**changed)
