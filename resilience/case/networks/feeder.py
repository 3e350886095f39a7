"""A feeder as its source has it: the network, and the devices that the source knows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from resilience.arrays import Floats
from resilience.case.networks.costs import UnitCost
from resilience.case.networks.course import Course
from resilience.case.networks.network import Network
from resilience.case.networks.omissions import Omission, omission
from resilience.errors import MAX_SHOWN, UsageError, shortened

V_MIN_PU, V_MAX_PU = 0.9, 1.1
"""Voltage limits where neither source nor case states any."""


class FeederError(UsageError):
    """A network that cannot be read.

    Args:
        findings: `(key of [network], what stands there, what may stand there, what to do about
            it)`, one for each mistake.
    """

    def __init__(self, *findings: tuple[str, str, str, str]) -> None:
        self.findings = tuple(
            (key, shortened(value, MAX_SHOWN), shortened(allowed, MAX_SHOWN), hint)
            for key, value, allowed, hint in findings
        )
        words = (f"{key}: {value}; allowed: {may}" for key, value, may, _ in self.findings)
        super().__init__(f"network, {'; '.join(words)}", self.findings[0][3] if findings else "")
        self.args = self.findings

    def prefixed(self, key: str, prefix: str) -> FeederError:
        """The same of a key of `[network]`, with `prefix` before what stands there."""
        return FeederError(*((key, prefix + v, may, hint) for _, v, may, hint in self.findings))


@dataclass(frozen=True)
class Branch:
    """One line or transformer on its way into a network.

    Attributes:
        from_bus: name of the bus at one end.
        to_bus: name of the bus at the other.
        r_pu: resistance, pu on 1 MVA.
        x_pu: reactance, pu on 1 MVA.
        rating_mva: of apparent power.
        in_service: False where it exists and is out of use.
        name: the source's; empty where it has none that tells anything.
        course: how it runs; None where the source says nothing of it.
        ratio: of the ideal transformer at `from_bus`, tap and phase shift.
        y_from_pu: admittance to earth behind it, pu on 1 MVA.
        y_to_pu: admittance to earth at `to_bus`, likewise.
        angle_min_degree, angle_max_degree: how much the voltage at `from_bus` may lead that at
            `to_bus`, phase shift included.
        open_at: `from` or `to` where one end alone is open, and charging hangs at the other.
    """

    from_bus: str
    to_bus: str
    r_pu: float
    x_pu: float
    rating_mva: float = float("inf")
    in_service: bool = True
    name: str = ""
    course: Course | None = None
    ratio: complex = 1.0
    y_from_pu: complex = 0.0
    y_to_pu: complex = 0.0
    angle_min_degree: float = float("-inf")
    angle_max_degree: float = float("inf")
    open_at: Literal["", "from", "to"] = ""

    @property
    def hanging(self) -> tuple[str, complex] | None:
        """The bus at which an open end hangs, and the admittance that it shows there, pu."""
        if not self.open_at:
            return None
        z = complex(self.r_pu, self.x_pu)
        near, far = self.y_from_pu, self.y_to_pu
        if self.open_at == "from":
            near, far = far, near
        y = near + far / (1.0 + z * far)
        if self.open_at == "from":
            return (self.to_bus, y) if y else None
        return (self.from_bus, y / abs(self.ratio) ** 2) if y else None

    @property
    def title(self) -> str:
        """Its name, or else its two buses."""
        return self.name or f"{self.from_bus}-{self.to_bus}"


@dataclass(frozen=True)
class SourceDevice:
    """A load, generator, storage or grid connection that a network file brings along.

    Attributes:
        name: the source's, or one made from its kind and number.
        bus: name of its bus.
        p_mw: consumption of a load; most that anything else gives.
        q_mvar: consumption of a load; what a static generator feeds in beside `p_mw`.
        v_pu: voltage that a generator or grid connection holds.
        p_min_mw: least that a generator or grid connection gives; negative where it takes.
        q_min_mvar: least reactive power that it gives; None where the source states none.
        q_max_mvar: greatest reactive power, likewise.
        s_mva: rating; None where the source states none.
        cost: of its energy; None where the source states none.
        e_mwh: energy that a storage can hold; None where the source states none.
        soc_min: least share of it.
        soc: share of it that is stored at first.
        efficiency: of a storage, of charging as of discharging.
    """

    name: str
    bus: str
    p_mw: float
    q_mvar: float = 0.0
    v_pu: float = 1.0
    p_min_mw: float = 0.0
    q_min_mvar: float | None = None
    q_max_mvar: float | None = None
    s_mva: float | None = None
    cost: UnitCost | None = None
    e_mwh: float | None = None
    soc_min: float = 0.0
    soc: float = 0.5
    efficiency: float = 1.0


@dataclass(frozen=True)
class Feeder:
    """A network as its source has it, with the devices the source knows.

    Attributes:
        network: its buses and branches, with the source's voltage limits.
        load: its loads; a negative one feeds in.
        flexible: loads that the source lets be shed at a price, `cost.per_mwh`.
        static: photovoltaic plants, which follow the sun.
        wind: wind turbines.
        generator: generators that can be called on.
        storage: its storage.
        grid: connections to a grid.
        places: (x, y) of buses by name, whatever the source means by them: degrees of longitude
            and latitude, or a drawing.
        omissions: what of the source is in none of these.
    """

    network: Network
    load: tuple[SourceDevice, ...] = ()
    flexible: tuple[SourceDevice, ...] = ()
    static: tuple[SourceDevice, ...] = ()
    wind: tuple[SourceDevice, ...] = ()
    generator: tuple[SourceDevice, ...] = ()
    storage: tuple[SourceDevice, ...] = ()
    grid: tuple[SourceDevice, ...] = ()
    places: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    omissions: tuple[Omission, ...] = ()


def make_network(
    buses: Sequence[tuple[str, float]],
    branches: Sequence[Branch],
    aliases: dict[str, str] | None = None,
    *,
    limits: Mapping[str, tuple[float, float]] | None = None,
    shunts: Mapping[str, complex] | None = None,
    placeholder_kv: bool = False,
) -> Network:
    """A network of buses and branches.

    Args:
        buses: name and nominal voltage in kV of every bus.
        branches: lines and transformers, which name their buses.
        aliases: further names of buses.
        limits: lowest and highest voltage by bus, pu, where the source states them.
        shunts: admittance by bus, pu on 1 MVA.
        placeholder_kv: the nominal voltages stand for nothing.

    Raises:
        FeederError: two buses of one name, or a branch to a bus that there is not.
    """
    index = {name: i for i, (name, _) in enumerate(buses)}
    index |= {alias: index[name] for alias, name in (aliases or {}).items()}
    _check_names(buses, branches, index)
    count, fixed = len(branches), np.zeros(len(branches), dtype=np.bool_)
    default = (V_MIN_PU, V_MAX_PU)
    band = [(limits or {}).get(name, default) for name, _ in buses]
    v_min, v_max = np.array(band, dtype=np.float64).reshape(-1, 2).T
    line_names = unique_names(b.title for b in branches)
    y_bus = np.zeros(len(buses), dtype=np.complex128)
    for name, y_pu in (shunts or {}).items():
        if name not in index:
            value, hint = f"a shunt at bus {name}, which is not there", "add the bus"
            raise FeederError(("", value, "shunts at buses of the network", hint))
        y_bus[index[name]] += y_pu
    hanging = [b.hanging for b in branches]
    return Network(
        bus_names=tuple(name for name, _ in buses),
        vn_kv=np.array([vn for _, vn in buses], dtype=np.float64),
        v_min_pu=v_min.copy(),
        v_max_pu=v_max.copy(),
        line_names=line_names,
        from_bus=np.array([index[b.from_bus] for b in branches], dtype=np.int64).reshape(count),
        to_bus=np.array([index[b.to_bus] for b in branches], dtype=np.int64).reshape(count),
        r_pu=_column(branches, "r_pu"),
        x_pu=_column(branches, "x_pu"),
        ratio=np.array([b.ratio for b in branches], dtype=np.complex128),
        y_from_pu=np.array([b.y_from_pu for b in branches], dtype=np.complex128),
        y_to_pu=np.array([b.y_to_pu for b in branches], dtype=np.complex128),
        y_bus_pu=y_bus,
        rating_mva=_column(branches, "rating_mva"),
        angle_min_degree=_column(branches, "angle_min_degree"),
        angle_max_degree=_column(branches, "angle_max_degree"),
        in_service=np.array([b.in_service for b in branches], dtype=np.bool_),
        switchable=fixed,
        switching_cost=np.zeros(count),
        breakpoint=fixed.copy(),
        placeholder_kv=placeholder_kv,
        aliases=dict(aliases or {}),
        courses={
            name: b.course
            for name, b in zip(line_names, branches, strict=True)
            if b.course is not None
        },
        open_ended={n: h for n, h in zip(line_names, hanging, strict=True) if h is not None},
    )


def _column(branches: Sequence[Branch], key: str) -> Floats:
    return np.array([getattr(branch, key) for branch in branches], dtype=np.float64)


def _check_names(
    buses: Sequence[tuple[str, float]], branches: Sequence[Branch], index: Mapping[str, int]
) -> None:
    twice = [name for name, count in Counter(name for name, _ in buses).items() if count > 1]
    findings = [
        ("", f"bus {name} twice", "every bus once", "rename or drop one of them") for name in twice
    ]
    for branch in branches:
        absent = [bus for bus in (branch.from_bus, branch.to_bus) if bus not in index]
        if absent:
            value = f"branch {branch.title} to bus {' and '.join(absent)}, which is not there"
            hint = "mend the branch, or add the bus"
            findings.append(("", value, "branches between buses of the network", hint))
    if findings:
        raise FeederError(*findings)


def unit_omissions(
    generators: Iterable[SourceDevice],
    grid: Iterable[SourceDevice],
    driven: Iterable[SourceDevice] = (),
) -> Iterator[Omission]:
    """What of units cannot be as the source has it.

    Args:
        generators: those that can be called on.
        grid: connections to a grid.
        driven: plants that follow the sun or the wind.
    """
    generators, grid, driven = list(generators), list(grid), list(driven)
    takes = [(unit.name, unit.p_min_mw) for unit in generators if unit.p_min_mw < 0]
    yield from omission("two-way generator", takes, "MW", "one that only gives")
    curved = [u.name for u in generators if u.cost is not None and u.cost.is_chords]
    yield from omission("curved cost", [(name, 0.0) for name in curved], instead="straight pieces")
    for element, units in (("grid", grid), ("plant of sun or wind", driven)):
        bent = [u.name for u in units if (c := u.cost) and (c.curve or c.is_chords or c.per_h)]
        places = [(name, 0.0) for name in bent]
        yield from omission(f"cost curve of a {element}", places, instead="its mean slope")
    must = [(unit.name, unit.p_min_mw) for unit in driven if unit.p_min_mw > 0]
    yield from omission("least output of a plant of sun or wind", must, "MW")


def unique_names(names: Iterable[str]) -> tuple[str, ...]:
    """The names with `#2`, `#3`, ... after repeated ones, as parallel lines have."""
    count: dict[str, int] = {}
    numbered = []
    for name in names:
        count[name] = count.get(name, 0) + 1
        numbered.append(name if count[name] == 1 else f"{name}#{count[name]}")
    return tuple(numbered)
