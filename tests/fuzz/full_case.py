"""Cases that state every key there is: what is left out in one stands in the other."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any

from resilience.case.schema import case_schema
from tests.unit.case.valid import VALID

STORM = """
[storm]
name = "Rammasun"
source = "a forecast"
points = [
  [2016-07-11T18:00:00, 18.0, 112.0, 960.0, 38.0],
  [2016-07-12T02:00:00, 20.5, 110.5, 945.0, 45.0],
  [2016-07-12T12:00:00, 21.5, 109.0, nan, 33.0],
]
averaging_s = 120
agency = "cma"
utc_offset_h = 8
day = 2016-07-12
laid_on = 2016-07-12
rmw_km = 40.0
rmw = "ibtracs"
basin = "WP"
penv_hpa = 1005.0
wind = "holland2008"
asymmetry = "mouton"
inflow = "bretschneider"
roughness = "tchazards"
inland_km = 4.0
pole = "mine"
conductor = "yours"
hardening = 1.1
correlation = 0.2
by_angle = true
mode = "rate"
lines = "all"
[storm.repair]
law = "lognormal"
hours = [4.0, 0.4]
crews = 2
priority = { "1-2" = 2.0 }
wind_limit_mps = 18.0
[storm.forecast]
members = 3
issued = 2016-07-12T00:00:00
along_km_per_day = 30.0
cross_km_per_day = 35.0
intensity_mps = 4.0
seed = 5
[storm.cloud]
factor = 0.4
radius_km = 150.0
[storm.curves.mine]
kind = "lognormal"
median_mps = 60.0
beta = 0.3
averaging_s = 3
height_m = 10.0
exposure = "land"
source = "a survey"
[storm.curves.yours]
kind = "piecewise"
v_crit_mps = 30.0
v_collapse_mps = 70.0
averaging_s = 60
[storm.curves.table]
kind = "tabulated"
speed_mps = [20.0, 40.0]
probability = [0.1, 0.9]
averaging_s = 60
"""
BLACKOUT = """
[blackout]
lines = ["1-2"]
start = 2016-07-12T00:15:00
law = "lognormal"
hours = [12.0, 0.8]
longest_h = 48.0
"""
FAILS = {"mttf_h": 900.0, "mttr_h": 24.0, "availability": 0.97}
UNIT: dict[str, Any] = {
    "name": "chp",
    "bus": "3",
    "p_max_mw": 0.3,
    "cost_per_mwh": 90.0,
    "no_load_cost_per_h": 1.0,
    "start_cost": 2.0,
    "ramp_down_mw_per_h": 1.0,
    "min_up_h": 0.25,
    "min_down_h": 0.25,
    "initial_on": True,
    "initial_hours": 3.0,
    "p_initial_mw": 0.1,
    "tank": "cistern",
    "fuel_m3_per_mwh": 0.25,
    "fuel_no_load_m3_per_h": 0.01,
    "q_min_mvar": -0.1,
    "q_max_mvar": 0.1,
    "grid_forming": False,
}
TANK = {
    "name": "cistern",
    "capacity_m3": 2.0,
    "initial_m3": 1.0,
    "delivery": [{"hour": 0.5, "amount_m3": 0.5}],
    **FAILS,
}
OUTAGE = {
    "probability": 0.7,
    "height": 0.1,
    "sigma_slots": 3.0,
    "duration_slots": [3, 9],
    "duration_law": "lognormal",
    "shift_slots": 2,
    "shared_shift": True,
    "common_draw": True,
    "refail": True,
    "wrap": False,
    "overnight": True,
    "centres": [40, 60],
    "centre_error_slots": 2,
    "rate": False,
}
GEOGRAPHY = {
    "degrees": False,
    "synthetic": False,
    "anchor_bus": "1",
    "anchor_lat_deg": 21.0,
    "anchor_lon_deg": 110.0,
    "turn_deg": 10.0,
    "ohm_per_km": 0.3,
    "span_m": 60.0,
}


def placed_case(more: str) -> dict[str, Any]:
    """The valid case, its buses in a row, with more tables."""
    data = tomllib.loads(VALID + more)
    for k, bus in enumerate(data["network"]["bus"]):
        bus |= {"lat_deg": 20.9 + 0.002 * k, "lon_deg": 110.1 + 0.003 * k}
    return data


@cache
def stormy_case() -> dict[str, Any]:
    """With a storm on its track, and buses that have places."""
    data = placed_case(STORM)
    data["network"]["bus"][1] |= {"v_min_pu": 0.94}
    data["network"]["line"][3] |= {"name": "4-1", "b_us": 3.0, "g_us": 0.1}
    data["line"][0] |= {
        "hardening": 1.5, "span_m": 45.0, "pole": "mine", "underground": False, "rating_mva": 4.0,
    }  # fmt: skip
    data["line"][1] |= {"switching_cost": 1.0, "in_service": False}
    data["line"][0] |= {
        "harden": [
            {"factor": 1.4, "cost": 30.0, "life_years": 30.0},
            {"underground": True, "cost": 200.0},
        ]
    }
    strengths = [{"factor": 1.5, "cost": 40.0}, {"underground": True, "cost": 90.0}]
    strengths[0]["life_years"] = 30.0
    unit = {"bus": "2", "p_max_mw": 0.1, "e_mwh": 0.2}
    site = {"name": "depot", "kind": "ess", "units": 2, "cost": 5.0, "life_years": 15.0}
    later = {"file": "tracks.csv", "storm": "LATER", "averaging_s": 60.0, "agency": "cma"}
    data["plan"] = {"budget": 1000.0, "harden": strengths, "interest_rate": 0.04,
                    "life_years": 40.0, "site": [site | {"unit": unit}],
                    "storm": [{"per_year": 0.1}, later | {"per_year": 0.2}]}  # fmt: skip
    data["defaults"] |= {
        "ess": {"efficiency_charge": 0.93}, "grid": {"v_pu": 1.0},
        "pv": {"curtailable": True}, "generator": {"initial_hours": 12.0},
    }  # fmt: skip
    data["load"][0] |= {"profile": "homes", "shed_cost_per_mwh": 900.0}
    data["load"][0] |= {"cold_load_share": 0.5, "cold_load_h": 1.5, "power_factor": 0.95}
    data["load"][0] |= {"customers": 120}
    data["load"][1] |= {"critical": True, "block": True, "q_mvar": -0.05}
    data["pv"][0] |= {"s_mva": 0.6, "curtailable": True, "cost_per_mwh": 1.0}
    data["ess"][0] |= {"p_min_mw": -0.4, "soc_initial": 0.6, "soc_final_min": 0.2, "s_mva": 0.7,
                       "efficiency_discharge": 0.95, "degradation_cost_per_mwh": 2.0,
                       "grid_forming": True}  # fmt: skip
    data["grid"][0] |= {"tariff": [["00:00", 30.0], ["06:30", 70.0]], "export_max_mw": 1.0,
                        "export_tariff_factor": -0.5, "q_max_mvar": 1.5, "v_pu": 1.01,
                        "grid_forming": True, "name": "utility"}  # fmt: skip
    del data["grid"][0]["import_cost_per_mwh"]
    data["generator"].append(dict(UNIT))
    data["tank"] = [TANK | {"delivery": [{"time": data["time"]["start"], "amount_m3": 0.5}]}]
    prices = {"reserve_price": 500.0, "terminal_value": 0.3, "loss_cost": 0.01}
    return {**{f"{name}_per_mwh": value for name, value in prices.items()}, **data}


@cache
def dark_case() -> dict[str, Any]:
    """With a blackout, outages of a bell, units that fail, fuel curves, taps and shunts."""
    data = placed_case(BLACKOUT)
    data |= {"outage": OUTAGE, "geography": GEOGRAPHY, "tank": [TANK]}
    data["plan"] = {"storms_per_year": 0.5}
    tie = {"from": "2", "to": "4", "r_ohm": 0.8, "x_ohm": 0.5, "in_service": False}
    data["network"]["line"].append(tie)
    data["line"].append({"name": "2-4", "tie_cost": 3.0})
    data["network"] |= {"impedance_scale": 1.1, "v_max_pu": 1.08, "parallel_grids": True,
                        "radial": False, "not_modelled": ["2 ways of lines"]}  # fmt: skip
    data["network"]["bus"][2] |= {"shunt_p_mw": 0.01, "shunt_q_mvar": -0.02}
    data["network"]["line"][1] |= {"tap_ratio": 0.98, "shift_degree": 30.0, "in_service": True,
                                   "angle_min_degree": -10.0, "angle_max_degree": 65.0}  # fmt: skip
    data["pv"][0] |= {"q_mvar": 0.05, **FAILS}
    data["ess"][0] |= {"efficiency_charge": 0.9, **FAILS}
    data["generator"][0] |= {"start_failure": 0.01, **FAILS, "tank": "cistern",
                             "fuel_curve": [[0.1, 0.03], [0.2, 0.05], [0.4, 0.12]]}  # fmt: skip
    data["grid"][0] |= {"export_max_mw": 1.0, "export_cost_per_mwh": -10.0}
    return data


ELSEWHERE = {
    ("extends",): "a case of another kind of file",
    ("network", "file"): "the kinds of networks",
    ("network", "pandapower"): "the kinds of networks",
    ("profiles", "file"): "the kinds of profiles",
}
"""Keys that no such case can have, and where else they are changed."""


def stated(data: Mapping[str, Any], path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Every key, with the tables above it; curves, that have names of their own, are `*`."""
    for key, value in data.items():
        place = (*path, "*") if path == ("storm", "curves") else (*path, key)
        yield place
        for table in value if isinstance(value, list) else [value]:
            if isinstance(table, dict):
                yield from stated(table, place)


def allowed() -> Iterator[tuple[str, ...]]:
    """Every key of the schema likewise."""
    schema = case_schema()
    definitions = schema.get("$defs", {})

    def walk(node: Mapping[str, Any], path: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
        if "$ref" in node:
            yield from walk(definitions[node["$ref"].rsplit("/", 1)[-1]], path)
        for part in node.get("anyOf", ()):
            yield from walk(part, path)
        if isinstance(node.get("items"), dict):
            yield from walk(node["items"], path)
        for key, child in node.get("properties", {}).items():
            yield (*path, key)
            yield from walk(child, (*path, key))
        if isinstance(node.get("additionalProperties"), dict):
            yield from walk(node["additionalProperties"], (*path, "*"))

    yield from walk(schema, ())
