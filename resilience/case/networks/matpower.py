"""MATPOWER case files (`.m`, format version 2) as feeders.

Taken over are branches with their taps, phase shifts, charging, ratings and limits of angles,
shunts, voltage limits, loads, and generators with their limits and costs; a generator that can only
take is a load with a price. What else the file states is listed in `Feeder.omissions`.
"""

from __future__ import annotations

import cmath
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import zip_longest
from pathlib import Path

from resilience.arrays import Floats
from resilience.case.networks.costs import UnitCost, piecewise_cost, polynomial_cost
from resilience.case.networks.feeder import (
    V_MAX_PU,
    V_MIN_PU,
    Branch,
    Feeder,
    FeederError,
    SourceDevice,
    make_network,
    unique_names,
    unit_omissions,
)
from resilience.case.networks.matpower_text import COLUMNS, read_tables, read_words
from resilience.case.networks.omissions import Omission, omission
from resilience.case.networks.pandapower_devices import driven_by

_LOAD_BUS, _REFERENCE, _ISOLATED = 1, 3, 4
_PIECEWISE = 1
_FULL_TURN = 360.0
_BUS, _BRANCH, _GEN = COLUMNS["bus"], COLUMNS["branch"], COLUMNS["gen"]
_NEEDED = "mpc.baseMVA, mpc.bus and mpc.branch are needed, as MATPOWER's savecase writes them"
_USUAL = f"free from {V_MIN_PU:g} to {V_MAX_PU:g} pu"
_TEXT_TABLES = ("bus_name", "version")
_FUELS = ("genfuel", "gentype")
_STORED = ("ess", "BA")
_TYPES = {"PV": "sun", "WT": "wind", "WS": "wind"}
"""Of `gentype`, which has abbreviations of the EIA (MATPOWER's `gentypes`); `genfuel` has words."""


def feeder_from_matpower(path: Path) -> Feeder:
    """The network of a MATPOWER case file, with its loads and generators.

    Raises:
        FeederError: it is no such file, or holds statements that are not understood.
    """
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
        tables, others = read_tables(text)
        for name in ("baseMVA", "bus", "branch"):
            if name not in tables:
                raise ValueError(f"no mpc.{name}")
        _check(tables)
        fuels = _fuels(text, len(tables.get("gen", ())))
        return _feeder(tables, fuels, [name for name in others if not fuels or name not in _FUELS])
    except FeederError as error:
        raise error.prefixed("file", f"{path.name}: ") from None
    except (ValueError, ArithmeticError, LookupError, SyntaxError) as error:
        value = f"{path.name}: {error}"
        raise FeederError(("file", value, "a MATPOWER case, version 2", _NEEDED)) from None


Finding = tuple[str, str, str, str]
"""Key of `[network]`, what stands there, what may, and what to do about it."""


def _check(tables: dict[str, Floats]) -> None:
    """Refuses what no later check of the network could see; all of it together."""
    base_mva = float(tables["baseMVA"])
    findings = [*_wrong_buses(tables["bus"]), *_wrong_ends(tables)]
    if not (base_mva > 0 and math.isfinite(base_mva)):
        value, hint = f"mpc.baseMVA is {base_mva:g}", "write the base in MVA"
        findings.insert(0, ("", value, "a number above 0", hint))
    if findings:
        raise FeederError(*findings)


def _wrong_buses(bus: Floats) -> Iterator[Finding]:
    for number, count in Counter(bus[:, _BUS["BUS_I"]].tolist()).items():
        if count > 1 or not float(number).is_integer():
            value = f"mpc.bus: bus {number:g} in {count} rows"
            yield "", value, "whole numbers, every one once", "number the buses anew"
    for row in bus[bus[:, _BUS["BUS_TYPE"]] != _ISOLATED]:
        if row[_BUS["BASE_KV"]] == 0:
            hint = "column 10 must hold the nominal voltage"
            yield "", f"mpc.bus: baseKV is 0 at bus {row[0]:g}", "a voltage in kV above 0", hint
        for key in ("PD", "QD", "GS", "BS"):
            if not math.isfinite(row[_BUS[key]]):
                value = f"mpc.bus: {key} is {row[_BUS[key]]:g} at bus {row[0]:g}"
                yield "", value, "a number", "write 0 for none"


def _wrong_ends(tables: dict[str, Floats]) -> Iterator[Finding]:
    bus_numbers = set(tables["bus"][:, _BUS["BUS_I"]].tolist())
    for name, keys in (("branch", ("F_BUS", "T_BUS")), ("gen", ("GEN_BUS",))):
        for k, row in enumerate(tables.get(name, ()), start=1):
            for key in keys:
                if row[COLUMNS[name][key]] not in bus_numbers:
                    value = f"mpc.{name}, row {k}: {key} is {row[COLUMNS[name][key]]:g}"
                    yield "", value, "a bus of mpc.bus", "mend the row, or add the bus"
    for k, row in enumerate(tables.get("dcline", ()), start=1):
        if row[COLUMNS["dcline"]["BR_STATUS"]] > 0:
            hint = "set its status to 0, or put generators at its ends"
            yield "", f"mpc.dcline, row {k}: a DC line from {row[0]:g}", "AC branches", hint


def _fuels(text: str, count: int) -> list[str]:
    """What drives each generator: `mpc.genfuel`, or else `mpc.gentype`; none where unknown."""
    columns = (read_words(text, name) for name in _FUELS)
    return next((words for words in columns if len(words) == count > 0), [])


def _feeder(tables: dict[str, Floats], fuels: list[str], others: list[str]) -> Feeder:
    every, base_mva = tables["bus"], float(tables["baseMVA"])
    bus = every[every[:, _BUS["BUS_TYPE"]] != _ISOLATED]
    names = {int(row[0]): str(int(row[0])) for row in bus}
    branches = _branches(tables["branch"], names, base_mva)
    kv = bus[:, _BUS["BASE_KV"]]
    network = make_network(
        list(zip(names.values(), kv.tolist(), strict=True)),
        branches,
        limits=_limits(bus, names),
        shunts={
            name: complex(*row[[_BUS["GS"], _BUS["BS"]]])
            for name, row in zip(names.values(), bus, strict=True)
        },
        placeholder_kv=len(kv) > 1 and bool((kv == 1.0).all()),
    )
    reference = {names[int(row[0])] for row in bus if row[1] == _REFERENCE}
    drives = list(_units(tables.get("gen"), tables.get("gencost"), fuels, names))
    takes = [unit for unit, _ in drives if unit.p_mw <= 0 and unit.p_min_mw < 0]
    grid = tuple(u for u, _ in drives if u.bus in reference and u not in takes)
    by_drive: dict[str, list[SourceDevice]] = {d: [] for d in ("sun", "wind", "ess", "generator")}
    for unit, drive in drives:
        if unit not in takes and unit not in grid:
            by_drive[drive].append(unit)
    generators = tuple(by_drive["generator"])
    driven = (*by_drive["sun"], *by_drive["wind"])
    return Feeder(
        network,
        load=tuple(_loads(bus, names)),
        flexible=tuple(map(_flexible, takes)),
        static=tuple(by_drive["sun"]),
        wind=tuple(by_drive["wind"]),
        storage=tuple(by_drive["ess"]),
        generator=generators,
        grid=grid,
        omissions=(
            *_of_buses(every, names),
            *_of_units(generators, grid, driven, by_drive["ess"]),
            *_of_file(network.placeholder_kv, network.bus_names, others),
        ),
    )


def _branches(table: Floats, names: dict[int, str], base_mva: float) -> list[Branch]:
    """The branches between buses that are not isolated."""
    branches = []
    for row in table:
        start, stop = names.get(int(row[0])), names.get(int(row[1]))
        if start is None or stop is None:
            continue
        rate, tap, shift, b = (
            float(row[_BRANCH[key]]) for key in ("RATE_A", "TAP", "SHIFT", "BR_B")
        )
        r_pu, x_pu = (float(row[_BRANCH[key]]) / base_mva for key in ("BR_R", "BR_X"))
        half = complex(0.0, 0.5 * b * base_mva)
        angle_min, angle_max = _angle_limits(row)
        branches.append(
            Branch(
                start,
                stop,
                r_pu,
                x_pu,
                # MATPOWER writes 0 for no limit, and exports NaN.
                rating_mva=math.inf if rate == 0 or math.isnan(rate) else rate,
                in_service=bool(row[_BRANCH["BR_STATUS"]] > 0),
                ratio=cmath.rect(tap or 1.0, math.radians(shift)),
                y_from_pu=half,
                y_to_pu=half,
                angle_min_degree=angle_min,
                angle_max_degree=angle_max,
            )
        )
    return branches


def _angle_limits(row: Floats) -> tuple[float, float]:
    """(ANGMIN, ANGMAX) of a branch, degrees; 0, NaN and a full turn state none."""
    if len(row) <= _BRANCH["ANGMAX"]:
        return -math.inf, math.inf
    low, high = (float(row[_BRANCH[key]]) for key in ("ANGMIN", "ANGMAX"))
    return (
        low if low and low > -_FULL_TURN else -math.inf,
        high if high and high < _FULL_TURN else math.inf,
    )


def _limits(bus: Floats, names: dict[int, str]) -> dict[str, tuple[float, float]]:
    """(VMIN, VMAX) by bus; 0, NaN and infinity state none."""
    limits = {}
    for row in bus if bus.shape[1] > _BUS["VMIN"] else ():
        low, high = float(row[_BUS["VMIN"]]), float(row[_BUS["VMAX"]])
        if not _is_pinned(row):
            limits[names[int(row[0])]] = (
                low if 0 < low < math.inf else V_MIN_PU,
                high if 0 < high < math.inf else V_MAX_PU,
            )
    return limits


def _is_pinned(row: Floats) -> bool:
    """Whether a bus without a unit that could hold it is to have one voltage exactly."""
    if row[_BUS["BUS_TYPE"]] != _LOAD_BUS or len(row) <= _BUS["VMIN"]:
        return False
    return bool(row[_BUS["VMIN"]] == row[_BUS["VMAX"]] != 0.0)


def _loads(bus: Floats, names: dict[int, str]) -> Iterator[SourceDevice]:
    for row in bus:
        p_mw, q_mvar = float(row[_BUS["PD"]]), float(row[_BUS["QD"]])
        if p_mw or q_mvar:
            name = names[int(row[0])]
            yield SourceDevice(f"load{name}", name, p_mw, q_mvar)


def _units(
    gen: Floats | None, gencost: Floats | None, fuels: list[str], names: dict[int, str]
) -> Iterator[tuple[SourceDevice, str]]:
    """Generators in service, dispatchable loads among them, and what drives them."""
    table: list[Floats] = [] if gen is None else list(gen)
    costs: list[Floats] = [] if gencost is None else list(gencost)[: len(table)]
    rows = [
        (row, cost, fuel)
        for row, cost, fuel in zip_longest(table, costs, fuels)
        if row[_GEN["GEN_STATUS"]] > 0 and int(row[0]) in names
    ]
    titles = unique_names(f"gen{int(row[0])}" for row, _, _ in rows)
    for (row, cost, fuel), title in zip(rows, titles, strict=True):
        p_min, p_max, q_min, q_max = (
            _limit(row[_GEN[key]], title, key) for key in ("PMIN", "PMAX", "QMIN", "QMAX")
        )
        unit = SourceDevice(
            title,
            names[int(row[0])],
            p_max,
            v_pu=float(row[_GEN["VG"]]),
            p_min_mw=p_min,
            q_min_mvar=q_min,
            q_max_mvar=q_max,
            cost=None if cost is None else _cost(cost, max(p_min, min(p_max, 0.0)), p_max),
        )
        yield unit, _drive(fuel or "", unit)


def _drive(fuel: str, unit: SourceDevice) -> str:
    if fuel in _STORED and unit.p_mw > 0:
        return "ess"
    drive = _TYPES.get(fuel, driven_by(fuel))
    return drive if unit.p_min_mw >= 0 else "generator"


def _limit(value: float, title: str, key: str) -> float:
    if math.isnan(value):
        raise ValueError(f"mpc.gen, {title}: {key} is no number")
    return float(value)


def _cost(row: Floats, p_min_mw: float, p_max_mw: float) -> UnitCost:
    """The cost of one row of mpc.gencost."""
    count, start = int(row[3]), max(float(row[1]), 0.0)
    if row[0] == _PIECEWISE:
        points = row[4 : 4 + 2 * count].reshape(-1, 2).tolist()
        return piecewise_cost(tuple((p, cost) for p, cost in points), p_min_mw, p_max_mw, start)
    return polynomial_cost(row[4 : 4 + count].tolist(), p_min_mw, p_max_mw, start)


def _flexible(unit: SourceDevice) -> SourceDevice:
    """A dispatchable load: MATPOWER holds its power factor by the QMIN or QMAX that is not 0."""
    q_mvar = -(unit.q_min_mvar or unit.q_max_mvar or 0.0)
    name = unit.name.replace("gen", "flexible", 1)
    return SourceDevice(name, unit.bus, -unit.p_min_mw, q_mvar, cost=unit.cost)


def _of_buses(every: Floats, names: dict[int, str]) -> Iterator[Omission]:
    pinned = [
        (names[int(row[0])], 0.0) for row in every if int(row[0]) in names and _is_pinned(row)
    ]
    yield from omission("load bus of one fixed voltage", pinned, instead=_USUAL)
    isolated = [row for row in every if int(row[0]) not in names]
    yield from omission("isolated bus", [(f"{row[0]:g}", float(row[2])) for row in isolated], "MW")


def _of_units(
    generators: Sequence[SourceDevice],
    grid: Sequence[SourceDevice],
    driven: Sequence[SourceDevice],
    storage: Sequence[SourceDevice],
) -> Iterator[Omission]:
    setpoints = [(unit.name, 0.0) for unit in generators if unit.q_min_mvar != unit.q_max_mvar]
    yield from omission("held voltage", setpoints, instead="free within the limits of the bus")
    for element, units in (("plant of sun or wind", driven), ("storage", storage)):
        ranges = [(unit.name, 0.0) for unit in units if unit.q_min_mvar or unit.q_max_mvar]
        yield from omission(f"reactive range of a {element}", ranges)
    yield from unit_omissions(generators, grid, driven)


def _of_file(placeholder: bool, buses: tuple[str, ...], others: list[str]) -> Iterator[Omission]:
    if placeholder:
        every = [(name, 0.0) for name in buses]
        yield from omission("nominal voltage", every, instead="1 kV as in the file, a placeholder")
    unread = [(f"mpc.{name}", 0.0) for name in others if name not in _TEXT_TABLES]
    yield from omission("table", unread)
