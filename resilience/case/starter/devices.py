"""The tables of a first case file: what the network brings along, as `[[load]]` and the like."""

from __future__ import annotations

import json
import math
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from resilience.arrays import Complexes
from resilience.case.networks.feeder import Feeder, SourceDevice, unique_names
from resilience.case.networks.network import Network
from resilience.case.networks.omissions import Omission, omission

_MAX_CURRENT_KA = 9.0
"""Just below what a case accepts."""
_NO_LIMIT_MVA = 9999.0
"""Sources write 9999 and the like, or infinity, for no limit."""
_ROOM = 1.5
"""What a grid connection has over the load of the feeder, losses included."""
_MACHINE_MVAR_PER_MW = 0.75
"""Of a generator whose source states no reactive limits: a power factor of 0.8."""
_GENERATOR_COST, _IMPORT_COST = 100.0, 50.0  # $/MWh where the source states none
_MAX_FACTOR = 0.999
"""Above, rounding a power factor would change the reactive power; `q_mvar` is written instead."""


@dataclass(frozen=True)
class _Entry:
    """One table to write.

    Attributes:
        kind: of the device.
        unit: of the source.
        values: keys after name and bus, each with a value or with TOML text.
        remark: a comment above it.
        in_comments: whether all of it is to be taken out of comments first.
    """

    kind: str
    unit: SourceDevice
    values: dict[str, object]
    remark: str = ""
    in_comments: bool = False


@dataclass
class _Sizes:
    """What the feeder's loads come to, and what had to be cut.

    Attributes:
        load_mw: all loads, and what flows to earth at 1 pu, MW.
        load_mvar: likewise, either way, Mvar.
        fed_mw: all that is fed in whatever is decided, MW.
        cut: devices that are smaller in the case, with the MW that they lack.
    """

    load_mw: float
    load_mvar: float
    fed_mw: float
    cut: list[tuple[str, float]] = field(default_factory=list)


def device_tables(feeder: Feeder) -> tuple[str, list[Omission]]:
    """The tables of all devices as TOML, and what of them is left out."""
    loads, earth = [*feeder.load, *feeder.flexible], _admittances(feeder.network)
    sizes = _Sizes(
        load_mw=sum(max(load.p_mw, 0.0) for load in loads) + float(np.abs(earth.real).sum()),
        load_mvar=sum(abs(load.q_mvar) for load in [*loads, *feeder.static])
        + float(np.abs(earth.imag).sum()),
        fed_mw=sum(max(-load.p_mw, 0.0) for load in loads),
    )
    entries = [
        *_loads(feeder, sizes),
        *_flexible(feeder, sizes),
        *_static(feeder, sizes),
        *(_generator(feeder, unit, sizes) for unit in feeder.generator),
        *map(_storage, feeder.storage),
        *(_grid(feeder, grid, sizes) for grid in feeder.grid),
    ]
    names = unique_names(entry.unit.name for entry in entries)
    blocks = [_block(entry, name) for entry, name in zip(entries, names, strict=True)]
    winds = [(unit.name, unit.p_mw) for unit in feeder.wind]
    empty = [(unit.name, unit.p_mw) for unit in feeder.storage if unit.e_mwh is None]
    idle = [u.name for u in (*feeder.static, *feeder.generator) if not (u.p_mw or _gives_q(u))]
    return "".join(blocks), [
        *omission("wind turbine", winds, "MW", "in comments, to be given a profile"),
        *omission("storage without an energy", empty, "MW", "in comments, to be given e_mwh"),
        *omission("unit of no size", [(name, 0.0) for name in idle]),
        *omission("device beyond a busbar's current", sizes.cut, "MW", "cut to 9 kA"),
    ]


def _admittances(network: Network) -> Complexes:
    """Everything at buses and branches that flows to earth, pu on 1 MVA."""
    hanging = [y_pu for _, y_pu in network.open_ended.values()]
    in_use = network.in_service
    ends = network.y_from_pu[in_use] / network.tap[in_use] ** 2, network.y_to_pu[in_use]
    return np.concatenate([network.y_bus_pu, *ends, hanging])


def _gives_q(unit: SourceDevice) -> bool:
    return bool(unit.q_mvar or unit.q_min_mvar or unit.q_max_mvar)


def _block(entry: _Entry, name: str) -> str:
    lines = [f"[[{entry.kind}]]", f"name = {_toml(name)}", f"bus = {_toml(entry.unit.bus)}"]
    lines += [f"{key} = {_toml(value)}" for key, value in entry.values.items()]
    if entry.in_comments:
        lines = [f"# {line}" for line in lines]
    remark = [f"# {entry.remark}"] if entry.remark else []
    return "\n".join(["", *remark, *lines, ""])


class _Text(str):
    """A value that is TOML already."""


def _toml(value: object) -> str:
    if isinstance(value, _Text):
        return value
    if isinstance(value, float):
        return repr(round(value, 9) + 0.0)
    return json.dumps(value, ensure_ascii=False)


def _power(feeder: Feeder, unit: SourceDevice, p_mw: float, sizes: _Sizes, load: bool) -> object:
    """A power; sources state 9999 MW and the like, and LV buses with the load of a city."""
    vn_kv = float(feeder.network.vn_kv[feeder.network.bus(unit.bus)])
    limit_mw = _MAX_CURRENT_KA * math.sqrt(3.0) * vn_kv
    if feeder.network.placeholder_kv or p_mw <= limit_mw:
        return float(p_mw)
    if load:
        sizes.cut.append((unit.name, p_mw - limit_mw))
    cut = f"{limit_mw:.6g} # cut from {p_mw:.6g}, more than a busbar at {vn_kv:g} kV carries"
    return _Text(cut)


def _bus_loads(feeder: Feeder) -> list[SourceDevice]:
    """The loads added up by bus, those that feed in apart from those that take."""
    sums: dict[tuple[str, bool], list[float]] = defaultdict(lambda: [0.0, 0.0])
    for load in feeder.load:
        total = sums[load.bus, load.p_mw < 0]
        total[0] += load.p_mw
        total[1] += load.q_mvar
    return [
        SourceDevice(f"load {bus}" if not feeds else f"negative load {bus}", bus, p, q)
        for (bus, feeds), (p, q) in sums.items()
        if p or q
    ]


def _loads(feeder: Feeder, sizes: _Sizes) -> Iterator[_Entry]:
    for load in _bus_loads(feeder):
        if load.p_mw < 0:
            values: dict[str, object] = {
                "p_max_mw": _power(feeder, load, -load.p_mw, sizes, load=True),
                "curtailable": False,
            }
            if load.q_mvar:
                values["q_mvar"] = -load.q_mvar
            yield _Entry("pv", load, values, "A negative load of the network: it feeds in.")
        else:
            yield _Entry("load", load, _demand(feeder, load, sizes))


def _demand(feeder: Feeder, load: SourceDevice, sizes: _Sizes) -> dict[str, object]:
    values: dict[str, object] = {"p_max_mw": _power(feeder, load, load.p_mw, sizes, load=True)}
    size = math.hypot(load.p_mw, load.q_mvar)
    factor = load.p_mw / size if size else 1.0
    if load.q_mvar > 0 and 0.0 < factor <= _MAX_FACTOR:
        values["power_factor"] = factor
    elif load.q_mvar:
        values["q_mvar"] = load.q_mvar
    return values


def _flexible(feeder: Feeder, sizes: _Sizes) -> Iterator[_Entry]:
    for load in feeder.flexible:
        values = _demand(feeder, load, sizes)
        remark = "A dispatchable load of the network"
        if load.cost is not None and load.cost.per_mwh > 0:
            values["shed_cost_per_mwh"] = load.cost.per_mwh
            remark += ", at the price that it states"
        yield _Entry("load", load, values, remark + ".")


def _static(feeder: Feeder, sizes: _Sizes) -> Iterator[_Entry]:
    for unit in feeder.static:
        if not unit.p_mw:
            if unit.q_mvar:
                load = {"p_max_mw": 0.0, "q_mvar": -unit.q_mvar}
                yield _Entry("load", unit, dict(load), "A PV plant that feeds in Mvar alone.")
            continue
        values: dict[str, object] = {"p_max_mw": _power(feeder, unit, unit.p_mw, sizes, load=True)}
        if unit.q_mvar:
            values["q_mvar"] = unit.q_mvar
        if unit.cost is not None and unit.cost.per_mwh:
            values["cost_per_mwh"] = unit.cost.per_mwh
        yield _Entry("pv", unit, values)
    for unit in feeder.wind:
        turbine: dict[str, object] = {"p_max_mw": unit.p_mw, "profile": "wind"}
        if unit.q_mvar:
            turbine["q_mvar"] = unit.q_mvar
        remark = "A wind turbine: a [[pv]] with a profile of the wind follows it."
        yield _Entry("pv", unit, turbine, remark, in_comments=True)


def _generator(feeder: Feeder, unit: SourceDevice, sizes: _Sizes) -> _Entry:
    p_max = unit.p_mw if unit.p_mw < _NO_LIMIT_MVA else _ROOM * sizes.load_mw
    p_max = max(p_max, 0.0)
    values: dict[str, object] = {"p_max_mw": _power(feeder, unit, p_max, sizes, load=True)}
    if 0 < unit.p_min_mw <= p_max:
        values["p_min_mw"] = unit.p_min_mw
    remark = ""
    if unit.q_min_mvar is None and unit.q_max_mvar is None:
        machine = unit.s_mva is not None and unit.s_mva > p_max
        room = math.sqrt((unit.s_mva or 0.0) ** 2 - p_max**2) if machine else None
        q_mvar = _MACHINE_MVAR_PER_MW * p_max if room is None else room
        limits = -q_mvar, q_mvar
        stated = "from its sn_mva" if machine else "for a power factor of 0.8"
        remark = f"The network states no limits of reactive power; these are {stated}."
    else:
        ends = unit.q_min_mvar or 0.0, unit.q_max_mvar or 0.0
        room_mvar = max(p_max, _ROOM * sizes.load_mvar)
        limits = (
            -room_mvar if ends[0] <= -_NO_LIMIT_MVA else ends[0],
            room_mvar if ends[1] >= _NO_LIMIT_MVA else ends[1],
        )
    if any(limits):
        values["q_min_mvar"], values["q_max_mvar"] = min(limits), max(limits)
    values |= _cost(unit)
    if p_max == 0.0:
        values["grid_forming"] = False
        remark = "It gives reactive power alone."
    return _Entry("generator", unit, values, remark)


def _cost(unit: SourceDevice) -> dict[str, object]:
    cost = unit.cost
    if cost is None:
        return {"cost_per_mwh": _GENERATOR_COST}
    values: dict[str, object] = {"cost_per_mwh": cost.per_mwh}
    if cost.curve is not None and all(0 <= p < math.inf for p, _ in cost.curve):
        values = {"cost_curve": [list(point) for point in cost.curve]}
    elif cost.per_h > 0:
        values["no_load_cost_per_h"] = cost.per_h
    if cost.start > 0:
        values["start_cost"] = cost.start
    return values


def _storage(unit: SourceDevice) -> _Entry:
    values: dict[str, object] = {"p_max_mw": max(unit.p_mw, 0.0)}
    if unit.p_min_mw != -unit.p_mw:
        values["p_min_mw"] = min(unit.p_min_mw, 0.0)
    values["e_mwh"] = 0.0 if unit.e_mwh is None else unit.e_mwh
    if unit.soc_min:
        values["soc_min"] = unit.soc_min
    values["soc_initial"] = unit.soc
    if unit.efficiency != 1.0:
        values["efficiency_charge"] = values["efficiency_discharge"] = unit.efficiency
    if unit.s_mva is not None:
        values["s_mva"] = unit.s_mva
    remark = "The network does not say how much energy it holds." if unit.e_mwh is None else ""
    return _Entry("ess", unit, values, remark, in_comments=unit.e_mwh is None)


def _grid(feeder: Feeder, grid: SourceDevice, sizes: _Sizes) -> _Entry:
    """A connection that can carry the calm day, whatever the source states."""
    needed = _ROOM * sizes.load_mw
    stated = grid.p_mw if 0 < grid.p_mw < _NO_LIMIT_MVA else needed
    import_mw, remark = stated or 1.0, ""
    if stated < sizes.load_mw:
        import_mw, remark = needed, f"The network states {stated:g} MW, less than its own load."
    values: dict[str, object] = {
        "import_max_mw": _power(feeder, grid, import_mw, sizes, load=False)
    }
    export_mw = max(min(-grid.p_min_mw, _NO_LIMIT_MVA), _ROOM * sizes.fed_mw)
    if export_mw > 0:
        values["export_max_mw"] = _power(feeder, grid, export_mw, sizes, load=False)
    ends = [abs(q) for q in (grid.q_min_mvar, grid.q_max_mvar) if q is not None]
    own_mvar = max((q for q in ends if q < _NO_LIMIT_MVA), default=0.0)
    # Lines ask for Mvar, too; a limit that nobody states must not shed.
    values["q_max_mvar"] = max(own_mvar, _ROOM * (sizes.load_mvar + sizes.load_mw), 1.0)
    cost = _IMPORT_COST if grid.cost is None else grid.cost.per_mwh
    values["import_cost_per_mwh"] = cost
    low, high = (
        float(limits[feeder.network.bus(grid.bus)])
        for limits in (feeder.network.v_min_pu, feeder.network.v_max_pu)
    )
    values["v_pu"] = min(max(grid.v_pu, low), high)
    if values["v_pu"] != grid.v_pu:
        remark += f" It holds {grid.v_pu:g} pu, outside the limits of its bus."
    return _Entry("grid", grid, values, remark.strip())
