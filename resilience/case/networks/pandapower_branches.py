r"""Branches of pandapower networks: lines, transformers, impedances, switches with an impedance.

All become a $\pi$ on 1 MVA behind a ratio at the first end. A transformer is a T in pandapower:
iron losses `pfe_kw` and no-load current `i0_percent` flow to earth between its two leakage
impedances, which a change from star to triangle makes a $\pi$. Its taps move the rated voltage of
their side; a changer of type `Ideal` turns the angle alone.

A line or transformer that an open switch parts from one bus only still hangs at the other one, with
its charging; so does a line to a bus that is out of service.

Source: pandapower's documentation of its elements, "Electric Model", which its power flow follows.
"""

from __future__ import annotations

import cmath
import math
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal

from resilience.case.networks.course import pandapower_courses
from resilience.case.networks.feeder import Branch
from resilience.case.networks.pandapower_tables import Row, Tables, number, source_names

_NO_LIMIT_KA = 9999.0
"""pandapower writes 99999 kA where the source gives no limit."""
_SIDES = (("hv", 1.0), ("lv", -1.0))


@dataclass(frozen=True)
class Pi:
    """A branch between two nominal voltages, on 1 MVA.

    Attributes:
        z_pu: series impedance.
        rating_mva: inf for none.
        ratio: of the ideal transformer at the first end.
        y_from_pu, y_to_pu: admittances to earth at the two ends, the first behind the ratio.
    """

    z_pu: complex
    rating_mva: float = math.inf
    ratio: complex = 1.0
    y_from_pu: complex = 0.0
    y_to_pu: complex = 0.0

    def branch(self, start: str, stop: str) -> Branch:
        """The branch between two buses."""
        r, x = self.z_pu.real, self.z_pu.imag
        return Branch(
            start,
            stop,
            r,
            x,
            self.rating_mva,
            ratio=self.ratio,
            y_from_pu=self.y_from_pu,
            y_to_pu=self.y_to_pu,
        )


Parameters = Callable[[Row, float, float, float], Pi]
"""A row between two nominal voltages, kV, at a frequency, Hz, as a branch."""


def branches_of(
    tables: Tables, names: Mapping[int, str], vn_kv: Mapping[str, float]
) -> Iterator[Branch]:
    """All branches between buses in service.

    Args:
        tables: of the network.
        names: of the buses in service by index.
        vn_kv: nominal voltage by bus, kV.
    """
    f_hz = number(tables["net"][0], "f_hz", 50.0)
    opened = _open_switches(tables)
    for kind, (parameters, ends, switch) in _KINDS.items():
        rows = tables.get(kind, [])
        courses = pandapower_courses(rows) if kind == "line" else {}
        labels = source_names(rows) or {}
        for row in rows:
            start, stop = (names.get(int(row[end])) for end in ends)
            if start is None or stop is None:
                continue
            index = int(row["index"])
            in_use, buses_off = bool(row.get("in_service", True)), opened[switch, index]
            off = [end for end, key in zip(_ENDS, ends, strict=True) if int(row[key]) in buses_off]
            plain = parameters(row, vn_kv[start], vn_kv[stop], f_hz).branch(start, stop)
            yield replace(
                plain,
                in_service=in_use and not buses_off,
                name=labels.get(index, ""),
                course=courses.get(index),
                open_at=off[0] if in_use and len(off) == 1 else "",
            )
    yield from _switch_branches(tables, names, vn_kv)


def hanging_at_dead_buses(
    tables: Tables, names: Mapping[int, str], vn_kv: Mapping[str, float]
) -> Iterator[tuple[str, complex]]:
    """Buses, and admittances of lines there whose other bus is out of service."""
    f_hz = number(tables["net"][0], "f_hz", 50.0)
    opened = _open_switches(tables)
    for row in tables.get("line", []):
        ends = int(row["from_bus"]), int(row["to_bus"])
        start, stop = (names.get(end) for end in ends)
        bus = start or stop
        if (start is None) == (stop is None) or bus is None or not row.get("in_service", True):
            continue
        if (ends[0] if start else ends[1]) in opened["l", int(row["index"])]:
            continue
        branch = _line(row, vn_kv[bus], vn_kv[bus], f_hz).branch(bus, bus)
        if hanging := replace(branch, open_at="to" if start else "from").hanging:
            yield hanging


def _open_switches(tables: Tables) -> defaultdict[tuple[str, int], set[int]]:
    """Buses at which a switch parts a branch from the network, by its kind and index."""
    opened: defaultdict[tuple[str, int], set[int]] = defaultdict(set)
    for row in tables.get("switch", []):
        if not row["closed"]:
            opened[str(row["et"]), int(row["element"])].add(int(row["bus"]))
    return opened


def _switch_branches(
    tables: Tables, names: Mapping[int, str], vn_kv: Mapping[str, float]
) -> Iterator[Branch]:
    for row in tables.get("switch", []):
        z_ohm = number(row, "z_ohm", 0.0)
        if row["et"] == "b" and row["closed"] and z_ohm > 0:
            start, stop = names.get(int(row["bus"])), names.get(int(row["element"]))
            if start is not None and stop is not None:
                yield Branch(start, stop, z_ohm / vn_kv[start] ** 2, 0.0)


def _line(row: Row, vn_kv: float, _: float, f_hz: float) -> Pi:
    parallel = number(row, "parallel", 1.0)
    length_km = number(row, "length_km", math.nan)
    scale = length_km / parallel / vn_kv**2
    limit_ka = number(row, "max_i_ka", math.inf)
    if limit_ka >= _NO_LIMIT_KA or limit_ka == 0:
        limit_ka = math.inf
    loading = number(row, "max_loading_percent", 100.0) / 100.0
    rating = limit_ka * number(row, "df", 1.0) * parallel * loading * math.sqrt(3.0) * vn_kv
    r_ohm, x_ohm = (number(row, f"{axis}_ohm_per_km", math.nan) for axis in "rx")
    siemens = complex(
        number(row, "g_us_per_km", 0.0) * 1e-6,
        2.0 * math.pi * f_hz * number(row, "c_nf_per_km", 0.0) * 1e-9,
    )
    half = 0.5 * siemens * length_km * parallel * vn_kv**2
    return Pi(complex(r_ohm * scale, x_ohm * scale), rating, y_from_pu=half, y_to_pu=half)


def _trafo(row: Row, vn_hv_kv: float, vn_lv_kv: float, _: float) -> Pi:
    parallel, sn_mva = number(row, "parallel", 1.0), float(row["sn_mva"])
    hv_kv, lv_kv, shift = _rated(row)
    scale = (lv_kv / vn_lv_kv) ** 2 / sn_mva / parallel / 100.0
    vk, vkr = float(row["vk_percent"]), float(row["vkr_percent"])
    loading = number(row, "max_loading_percent", 100.0) / 100.0
    rating = sn_mva * number(row, "df", 1.0) * parallel * loading
    # MATPOWER branches that pandapower turned into transformers without a limit carry 99999 MVA.
    rating = math.inf if rating >= _NO_LIMIT_KA else rating
    x_percent = math.copysign(math.sqrt(max(vk**2 - vkr**2, 0.0)), vk)
    z = complex(vkr * scale, x_percent * scale)
    iron_mw = number(row, "pfe_kw", 0.0) * 1e-3
    idle_mva = number(row, "i0_percent", 0.0) / 100.0 * sn_mva
    magnetising = complex(iron_mw, -math.sqrt(max(idle_mva**2 - iron_mw**2, 0.0)))
    y = magnetising * parallel * (vn_lv_kv / lv_kv) ** 2
    ratio = cmath.rect(hv_kv / lv_kv * vn_lv_kv / vn_hv_kv, math.radians(shift))
    if not y:
        return Pi(z, rating, ratio)
    shares = (number(row, f"leakage_{axis}_ratio_hv", 0.5) for axis in ("resistance", "reactance"))
    r_hv, x_hv = shares
    near = complex(z.real * r_hv, z.imag * x_hv)
    far = z - near
    total = near * far + (near + far) / y  # star to triangle
    return Pi(total * y, rating, ratio, y_from_pu=far / total, y_to_pu=near / total)


def _rated(row: Row) -> tuple[float, float, float]:
    """Rated voltages, kV, of both sides as the taps leave them, and the phase shift, degrees."""
    rated = {side: number(row, f"vn_{side}_kv", math.nan) for side, _ in _SIDES}
    shift = number(row, "shift_degree", 0.0)
    for changer in ("tap", "tap2"):
        kind, steps = _changer(row, changer), tap_steps(row, changer)
        for side, sign in _SIDES:
            if row.get(f"{changer}_side") != side or not steps:
                continue
            percent, degrees = (number(row, f"{changer}_step_{u}", 0.0) for u in _TAP_UNITS)
            if kind == "Ideal":
                turn = 2.0 * math.degrees(math.asin(steps * percent / 200.0))
                shift += sign * (steps * degrees if degrees else turn)
            elif kind in ("Ratio", "Symmetrical"):
                added = cmath.rect(steps * percent / 100.0, math.radians(degrees))
                rated[side] *= abs(1.0 + added)
                shift += sign * math.degrees(math.atan(added.imag / (1.0 + added.real)))
    return rated["hv"], rated["lv"], shift


def tap_steps(row: Row, changer: str = "tap") -> float:
    """How far a tap changer is from neutral; 0 where the row does not say."""
    steps = number(row, f"{changer}_pos", math.nan) - number(row, f"{changer}_neutral", math.nan)
    return 0.0 if math.isnan(steps) else steps


def _changer(row: Row, changer: str) -> str:
    """`Ratio`, `Symmetrical`, `Ideal`, or nothing; files before pandapower 3 have a flag."""
    key = f"{changer}_changer_type"
    if key in row:
        return str(row[key])
    return "Ideal" if number(row, f"{changer}_phase_shifter", 0.0) else "Ratio"


def _impedance(row: Row, _: float, __: float, ___: float) -> Pi:
    sn_mva = float(row["sn_mva"])
    y_from, y_to = (
        sn_mva * complex(*(number(row, f"{axis}{end}_pu", 0.0) for axis in "gb")) for end in "ft"
    )
    z = complex(float(row["rft_pu"]) / sn_mva, float(row["xft_pu"]) / sn_mva)
    return Pi(z, y_from_pu=y_from, y_to_pu=y_to)


_ENDS: tuple[Literal["from", "to"], ...] = ("from", "to")
_TAP_UNITS = ("percent", "degree")
_KINDS: dict[str, tuple[Parameters, tuple[str, str], str]] = {
    "line": (_line, ("from_bus", "to_bus"), "l"),
    "trafo": (_trafo, ("hv_bus", "lv_bus"), "t"),
    "impedance": (_impedance, ("from_bus", "to_bus"), ""),
}
"""Tables of branches: how a row is read, its ends, and what switches call it."""
