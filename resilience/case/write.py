"""Writing a case as it was solved: one TOML text that needs no other case file."""

from __future__ import annotations

import json
import textwrap

from resilience.arrays import Floats
from resilience.case.change import plain
from resilience.case.cloud import is_reduced
from resilience.case.data import Case
from resilience.case.document import TomlTable
from resilience.case.outages import outage_texts


def case_text(case: Case) -> str:
    """A case as TOML that loads, from any folder, to an equal case.

    Bases and defaults are resolved, profiles are written out over the horizon, and a network file
    is named by its absolute path.
    """
    import tomli_w

    data: TomlTable = {
        "name": case.name,
        "description": case.description,
        "terminal_value_per_mwh": case.terminal_value_per_mwh,
        "loss_cost_per_mwh": case.loss_cost_per_mwh,
        "outages": outage_texts(case.outages, case.window),
        "network": case.source["network"],
        "line": [plain(line) for line in case.line],
        "tank": [plain(tank) for tank in case.tank],
        "time": {"start": case.start, "slots": case.slots, "step_min": case.step_min},
        "outage": plain(case.outage),
    }
    for kind, tables in case.devices.items():
        data[kind] = [plain(table) for table in tables]
    for key in ("geography", "storm", "blackout", "plan"):
        if getattr(case, key) is not None:
            data[key] = plain(getattr(case, key))
    if case.reserve_price_per_mwh is not None:
        data["reserve_price_per_mwh"] = case.reserve_price_per_mwh
    text = tomli_w.dumps({key: value for key, value in data.items() if value != []})
    derived = {grid.tariff_profile for grid in case.grid}
    derived |= {tank.delivery_profile for tank in case.tank}
    derived |= {name for name in case.profiles if is_reduced(name)}
    columns = [_column(name, v) for name, v in case.profiles.items() if name not in derived]
    return "\n".join([text, "[profiles.columns]", *columns, ""]) if columns else text


def _column(name: str, values: Floats) -> str:
    numbers = ", ".join(map(repr, values.tolist()))
    lines = textwrap.wrap(numbers, 100, initial_indent="    ", subsequent_indent="    ")
    return "\n".join([f"{json.dumps(name, ensure_ascii=False)} = [", *lines, "]"])
