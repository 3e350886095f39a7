"""Devices of pandapower networks: what of them a case can have, and what it has otherwise."""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

from resilience.case.networks.costs import UnitCost, piecewise_cost, polynomial_cost
from resilience.case.networks.feeder import SourceDevice, unique_names, unit_omissions
from resilience.case.networks.omissions import Omission, omission
from resilience.case.networks.pandapower_tables import Row, Tables, active, number, source_names

_PV = re.compile(r"solar|photovolt|(?<![a-z])(pv|res)(?![a-z])", re.IGNORECASE)
_WIND = re.compile(r"wind|(?<![a-z])(wp|wka|wea)(?![a-z])", re.IGNORECASE)
_MACHINE = re.compile(r"chp|diesel|fuel.?cell|bio|hydro|gas|engine|turbine|genset", re.IGNORECASE)
_DRIVEN = ("sun", "wind")
_PHASES = "abc"
Powers = Callable[[Row], tuple[float, float]]
"""MW and Mvar of a row before its scaling."""


@dataclass(frozen=True)
class Devices:
    """Devices of a network, as `feeder.Feeder` has them.

    Attributes:
        load: loads of constant power, and whatever else takes.
        static: plants that follow the sun.
        wind: wind turbines.
        generator: generators that can be called on.
        storage: storage.
        grid: connections to a grid.
        omissions: what of all devices is in none of these.
    """

    load: tuple[SourceDevice, ...]
    static: tuple[SourceDevice, ...]
    wind: tuple[SourceDevice, ...]
    generator: tuple[SourceDevice, ...]
    storage: tuple[SourceDevice, ...]
    grid: tuple[SourceDevice, ...]
    omissions: tuple[Omission, ...]

    def groups(self) -> dict[str, tuple[SourceDevice, ...]]:
        """The devices by field of a `Feeder`."""
        return {name: units for name, units in vars(self).items() if name != "omissions"}


@dataclass(frozen=True)
class _Reader:
    """What all kinds of devices are read with: the tables, and where their buses are."""

    tables: Tables
    names: Mapping[int, str]
    aliases: Mapping[str, str]

    def rows(self, kind: str) -> list[tuple[Row, str, str]]:
        """Rows in service at buses in service, each with its name and its bus."""
        rows = [r for r in active(self.tables, kind) if int(r["bus"]) in self.names]
        labels = source_names(rows) or {}
        titles = unique_names(
            labels.get(int(r["index"]), f"{kind}{int(r['index']) + 1}") for r in rows
        )
        buses = [self.names[int(r["bus"])] for r in rows]
        return [
            (row, title, self.aliases.get(bus, bus))
            for row, title, bus in zip(rows, titles, buses, strict=True)
        ]

    def constant(self, kind: str, powers: Powers) -> list[SourceDevice]:
        """Devices of constant power."""
        loads = []
        for row, title, bus in self.rows(kind):
            p_mw, q_mvar = powers(row)
            loads.append(SourceDevice(title, bus, p_mw * _scaling(row), q_mvar * _scaling(row)))
        return loads


def devices(tables: Tables, names: Mapping[int, str], aliases: Mapping[str, str]) -> Devices:
    """The devices of a network.

    Args:
        tables: of the network.
        names: of the buses in service by index.
        aliases: buses that stand for others.
    """
    reader, costs = _Reader(tables, names, aliases), _costs(tables)
    static = [*_static(reader, "sgen", _power, costs), *_static(reader, "asymmetric_sgen", _sum)]
    taking = [
        replace(unit, p_mw=-unit.p_mw, q_mvar=-unit.q_mvar) for unit, _ in static if unit.p_mw < 0
    ]
    giving = [(unit, kind) for unit, kind in static if unit.p_mw >= 0]
    machines = tuple(_machines(reader, costs))
    grid = tuple(_grids(reader, costs))
    generator = (*machines, *(unit for unit, kind in giving if kind == "generator"))
    return Devices(
        load=(*_loads(reader), *taking),
        static=tuple(unit for unit, kind in giving if kind == "sun"),
        wind=tuple(unit for unit, kind in giving if kind == "wind"),
        generator=generator,
        storage=tuple(_storages(reader)),
        grid=grid,
        omissions=(
            *_other_physics(reader),
            *_held(machines),
            *unit_omissions(generator, grid, [unit for unit, kind in giving if kind in _DRIVEN]),
            *_unread_costs(tables),
        ),
    )


def _scaling(row: Row) -> float:
    return number(row, "scaling", 1.0)


def _power(row: Row) -> tuple[float, float]:
    return number(row, "p_mw", 0.0), number(row, "q_mvar", 0.0)


def _constant(row: Row) -> tuple[float, float]:
    """What of a load is no constant impedance."""
    (p_mw, q_mvar), (p_share, q_share) = _power(row), _shares(row, "z")
    return p_mw * (1.0 - p_share), q_mvar * (1.0 - q_share)


def impedance_of_load(row: Row) -> tuple[float, float]:
    """MW and Mvar at 1 pu of the constant impedance that is in a load."""
    (p_mw, q_mvar), (p_share, q_share) = _power(row), _shares(row, "z")
    return p_mw * p_share * _scaling(row), q_mvar * q_share * _scaling(row)


def _shares(row: Row, kind: str) -> tuple[float, float]:
    """Shares of active and of reactive power that are a constant current (i) or impedance (z).

    Files before pandapower 3 have one number for both.
    """
    both = number(row, f"const_{kind}_percent", 0.0)
    p, q = (number(row, f"const_{kind}_{power}_percent", both) / 100.0 for power in "pq")
    return p, q


def _sum(row: Row) -> tuple[float, float]:
    p, q = ([number(row, f"{x}_{phase}_{unit}", 0.0) for phase in _PHASES] for x, unit in _UNITS)
    return sum(p), sum(q)


_UNITS = (("p", "mw"), ("q", "mvar"))


def _ward(row: Row) -> tuple[float, float]:
    return number(row, "ps_mw", 0.0), number(row, "qs_mvar", 0.0)


def _motor(row: Row) -> tuple[float, float]:
    """Electrical power of a motor (pandapower, "Motor": P = pn / efficiency * loading)."""
    loading, efficiency = (
        number(row, f"{key}_percent", 100.0) / 100.0 for key in ("loading", "efficiency")
    )
    p_mw = number(row, "pn_mech_mw", 0.0) / efficiency * loading
    return p_mw, p_mw * math.tan(math.acos(number(row, "cos_phi", 1.0)))


def _loads(reader: _Reader) -> Iterator[SourceDevice]:
    kinds: tuple[tuple[str, Powers], ...] = (
        ("load", _constant),
        ("asymmetric_load", _sum),
        ("ward", _ward),
        ("xward", _ward),
        ("motor", _motor),
    )
    for kind, powers in kinds:
        yield from reader.constant(kind, powers)


def _static(
    reader: _Reader,
    kind: str,
    powers: Powers,
    costs: Mapping[tuple[str, int], UnitCost] | None = None,
) -> Iterator[tuple[SourceDevice, str]]:
    """Generators of constant power, and what they are: sun, wind, or generator.

    A unit at scaling 0 has the size that its row states.
    """
    for row, title, bus in reader.rows(kind):
        scale = _scaling(row) or 1.0
        p_mw, q_mvar = (power * scale for power in powers(row))
        kind_of = _driven_by(row)
        if kind_of == "generator" and p_mw >= 0:
            p_mw = number(row, "max_p_mw", p_mw or number(row, "sn_mva", 0.0))
        yield (
            SourceDevice(
                title,
                bus,
                p_mw,
                q_mvar,
                p_min_mw=number(row, "min_p_mw", 0.0),
                q_min_mvar=number(row, "min_q_mvar", min(q_mvar, 0.0)),
                q_max_mvar=number(row, "max_q_mvar", max(q_mvar, 0.0)),
                cost=(costs or {}).get((kind, int(row["index"]))),
            ),
            kind_of,
        )


def _driven_by(row: Row) -> str:
    return driven_by(*(str(row.get(key) or "") for key in ("type", "name")))


def driven_by(*texts: str) -> str:
    """What drives a plant, by the first text that tells: sun, wind, or else generator."""
    for text in texts:
        if _PV.search(text):
            return "sun"
        if _WIND.search(text):
            return "wind"
    return "generator"


def _is_machine(row: Row) -> bool:
    return any(_MACHINE.search(str(row.get(key) or "")) for key in ("type", "name"))


def _machines(reader: _Reader, costs: Mapping[tuple[str, int], UnitCost]) -> Iterator[SourceDevice]:
    """Generators that hold a voltage; without `max_p_mw` their size is `p_mw`, or `sn_mva`."""
    for row, title, bus in reader.rows("gen"):
        p_mw = number(row, "p_mw", 0.0) * (_scaling(row) or 1.0)
        size = p_mw if p_mw > 0 else number(row, "sn_mva", 0.0)
        yield SourceDevice(
            title,
            bus,
            number(row, "max_p_mw", size),
            v_pu=number(row, "vm_pu", 1.0),
            p_min_mw=number(row, "min_p_mw", 0.0),
            q_min_mvar=_limit(row, "min_q_mvar"),
            q_max_mvar=_limit(row, "max_q_mvar"),
            s_mva=_limit(row, "sn_mva"),
            cost=costs.get(("gen", int(row["index"]))),
        )


def _grids(reader: _Reader, costs: Mapping[tuple[str, int], UnitCost]) -> Iterator[SourceDevice]:
    for row, title, bus in reader.rows("ext_grid"):
        yield SourceDevice(
            title,
            bus,
            number(row, "max_p_mw", 0.0),
            v_pu=number(row, "vm_pu", 1.0),
            p_min_mw=number(row, "min_p_mw", 0.0),
            q_min_mvar=_limit(row, "min_q_mvar"),
            q_max_mvar=_limit(row, "max_q_mvar"),
            cost=costs.get(("ext_grid", int(row["index"]))),
        )


def _storages(reader: _Reader) -> Iterator[SourceDevice]:
    """Storages; pandapower counts charging as positive."""
    for row, title, bus in reader.rows("storage"):
        size = abs(number(row, "p_mw", 0.0)) or number(row, "sn_mva", 0.0)
        e_mwh = _limit(row, "max_e_mwh")
        share = number(row, "min_e_mwh", 0.0) / e_mwh if e_mwh else 0.0
        p_mw = number(row, "max_p_mw", size) or size  # SimBench's may only discharge, it says
        s_mva = _limit(row, "sn_mva")
        yield SourceDevice(
            title,
            bus,
            p_mw,
            p_min_mw=number(row, "min_p_mw", -size),
            s_mva=s_mva if s_mva is not None and s_mva >= p_mw else None,
            e_mwh=e_mwh or None,
            soc_min=min(max(share, 0.0), 1.0),
            soc=min(max(number(row, "soc_percent", 50.0) / 100.0, share, 0.0), 1.0),
            efficiency=_efficiency(row) or 1.0,
        )


def _efficiency(row: Row) -> float | None:
    """That of a storage, where one is stated that can be; SimBench writes 0.95 for 95 %."""
    stated = number(row, "efficiency_percent", 100.0)
    efficiency = stated if stated <= 1.0 else stated / 100.0
    return efficiency if 0.0 < efficiency <= 1.0 else None


def _limit(row: Row, key: str) -> float | None:
    value = number(row, key, math.nan)
    return None if math.isnan(value) else value


def _other_physics(reader: _Reader) -> Iterator[Omission]:
    """Devices that are taken over as something simpler."""

    def sized(
        kind: str, powers: Powers, chosen: Callable[[Row], bool] = lambda _: True
    ) -> list[tuple[str, float]]:
        rows = [(row, title) for row, title, _ in reader.rows(kind) if chosen(row)]
        return [(title, powers(row)[0] * (_scaling(row) or 1.0)) for row, title in rows]

    def off(row: Row) -> bool:
        return _scaling(row) == 0.0

    constant = "constant power"
    yield from omission("motor", sized("motor", _motor), "MW", constant)
    for letter, element, instead in (
        ("z", "impedance in a load", "a shunt of its bus, never shed"),
        ("i", "constant current in a load", constant),
    ):
        rows = [(row, title) for row, title, _ in reader.rows("load") if any(_shares(row, letter))]
        sizes = [
            (title, math.hypot(*map(operator.mul, _power(row), _shares(row, letter))))
            for row, title in rows
        ]
        yield from omission(element, sizes, "MVA", instead)
    yield from omission("asymmetric load", sized("asymmetric_load", _sum), "MW", "summed up")
    yield from omission("asymmetric sgen", sized("asymmetric_sgen", _sum), "MW", "summed up")
    yield from omission("load at scaling 0", sized("load", _power, off), "MW")
    yield from omission("sgen at scaling 0", sized("sgen", _power, off), "MW", "kept at its size")
    unknown = sized(
        "sgen", _power, lambda row: _driven_by(row) == "generator" and not _is_machine(row)
    )
    yield from omission("sgen of unknown type", unknown, "MW", "generators that can be called on")
    sources = [(title, 0.0) for _, title, _ in reader.rows("xward")]
    yield from omission("held voltage of an xward", sources)
    yield from _of_storages(reader)


def _of_storages(reader: _Reader) -> Iterator[Omission]:
    rows = [(row, title) for row, title, _ in reader.rows("storage")]
    stated = [(title, 0.0) for row, title in rows if (_efficiency(row) or 1.0) != 1.0]
    yield from omission("efficiency of a storage", stated, instead="for each way")
    wrong = [(title, 0.0) for row, title in rows if _efficiency(row) is None]
    yield from omission("efficiency of a storage out of range", wrong, instead="without losses")
    decay = "self-discharge_percent_per_day"
    losing = [(title, 0.0) for row, title in rows if number(row, decay, 0.0) != 0.0]
    yield from omission("self-discharge of a storage", losing)
    moving = [(title, q) for row, title in rows if (q := _power(row)[1])]
    yield from omission("reactive power of a storage", moving, "Mvar")


def _held(machines: Iterable[SourceDevice]) -> list[Omission]:
    setpoints = [(unit.name, 0.0) for unit in machines]
    return omission("held voltage", setpoints, instead="free within the limits of the bus")


def _ranges(tables: Tables) -> dict[tuple[str, int], tuple[float, float]]:
    """(least, greatest) MW of every unit that may have a cost."""
    return {
        (kind, int(row["index"])): (
            max(number(row, "min_p_mw", 0.0), 0.0),
            number(row, "max_p_mw", number(row, "p_mw", 0.0)),
        )
        for kind in _PRICED
        for row in tables.get(kind, [])
    }


_PRICED = ("gen", "sgen", "ext_grid")


def _costs(tables: Tables) -> dict[tuple[str, int], UnitCost]:
    """Costs by kind and index of the unit."""
    ranges, costs = _ranges(tables), {}
    for row in tables.get("poly_cost", []):
        unit = str(row["et"]), int(row["element"])
        if unit in ranges:
            terms = [number(row, key, 0.0) for key in ("cp2_eur_per_mw2", "cp1_eur_per_mw")]
            costs[unit] = polynomial_cost([*terms, number(row, "cp0_eur", 0.0)], *ranges[unit])
    for row in tables.get("pwl_cost", []):
        unit = str(row["et"]), int(row["element"])
        if unit in ranges and row.get("power_type", "p") == "p":
            costs[unit] = _piecewise(row["points"], *ranges[unit])
    return costs


def _piecewise(pieces: list[list[float]], p_min_mw: float, p_max_mw: float) -> UnitCost:
    """The cost of pieces [from MW, to MW, $/MWh]; it is 0 where the first begins."""
    points = [(float(pieces[0][0]), 0.0)]
    for start, stop, slope in pieces:
        points.append((float(stop), points[-1][1] + (float(stop) - float(start)) * float(slope)))
    return piecewise_cost(tuple(points), p_min_mw, p_max_mw)


def _unread_costs(tables: Tables) -> list[Omission]:
    others = [
        (f"{row['et']} {row['element']}", 0.0)
        for kind in ("poly_cost", "pwl_cost")
        for row in tables.get(kind, [])
        if row["et"] not in _PRICED or row.get("power_type", "p") != "p"
    ]
    return omission("cost", others)
