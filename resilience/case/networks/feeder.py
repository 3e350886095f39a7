"""A feeder as its source has it: the network, and the devices that the source knows."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from resilience.case.networks.course import Course
from resilience.case.networks.network import Network


class FeederError(Exception):
    """A network that cannot be read.

    Args:
        key: of `[network]`.
        value: what stands there.
        allowed: what may stand there.
        hint: what to do about it.
    """

    def __init__(self, key: str, value: str, allowed: str, hint: str) -> None:
        super().__init__(key, value, allowed, hint)
        self.finding = (key, value, allowed, hint)


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
    """

    from_bus: str
    to_bus: str
    r_pu: float
    x_pu: float
    rating_mva: float = float("inf")
    in_service: bool = True
    name: str = ""
    course: Course | None = None


@dataclass(frozen=True)
class SourceDevice:
    """A load, generator or grid connection that a network file brings along.

    Attributes:
        name: the source's, or one made from its kind and number.
        bus: name of its bus.
        p_mw: consumption of a load; most that anything else gives.
        q_mvar: consumption of a load.
        v_pu: voltage that a generator or grid connection holds.
    """

    name: str
    bus: str
    p_mw: float
    q_mvar: float = 0.0
    v_pu: float = 1.0


@dataclass(frozen=True)
class Feeder:
    """A network as its source has it, with the devices the source knows.

    Voltage limits are not taken from the source; the case sets them.

    Attributes:
        network: its buses and branches.
        load: its loads.
        static: generators without voltage control, PV mostly.
        generator: generators that hold a voltage.
        grid: connections to a grid.
        places: (x, y) of buses by name, whatever the source means by them: degrees of longitude
            and latitude, or a drawing.
    """

    network: Network
    load: tuple[SourceDevice, ...] = ()
    static: tuple[SourceDevice, ...] = ()
    generator: tuple[SourceDevice, ...] = ()
    grid: tuple[SourceDevice, ...] = ()
    places: Mapping[str, tuple[float, float]] = field(default_factory=dict)


def make_network(
    buses: Sequence[tuple[str, float]],
    branches: Sequence[Branch],
    aliases: dict[str, str] | None = None,
) -> Network:
    """A network of buses and branches.

    Args:
        buses: name and nominal voltage in kV of every bus.
        branches: lines and transformers, which name their buses.
        aliases: further names of buses.
    """
    index = {name: i for i, (name, _) in enumerate(buses)}
    index |= {alias: index[name] for alias, name in (aliases or {}).items()}
    count, fixed = len(branches), np.zeros(len(branches), dtype=np.bool_)
    line_names = unique_names(b.name or f"{b.from_bus}-{b.to_bus}" for b in branches)
    return Network(
        bus_names=tuple(name for name, _ in buses),
        vn_kv=np.array([vn for _, vn in buses], dtype=np.float64),
        v_min_pu=np.full(len(buses), 0.9),
        v_max_pu=np.full(len(buses), 1.1),
        line_names=line_names,
        from_bus=np.array([index[b.from_bus] for b in branches], dtype=np.int64).reshape(count),
        to_bus=np.array([index[b.to_bus] for b in branches], dtype=np.int64).reshape(count),
        r_pu=np.array([b.r_pu for b in branches], dtype=np.float64),
        x_pu=np.array([b.x_pu for b in branches], dtype=np.float64),
        rating_mva=np.array([b.rating_mva for b in branches], dtype=np.float64),
        in_service=np.array([b.in_service for b in branches], dtype=np.bool_),
        switchable=fixed,
        switching_cost=np.zeros(count),
        breakpoint=fixed.copy(),
        aliases=dict(aliases or {}),
        courses={
            name: b.course
            for name, b in zip(line_names, branches, strict=True)
            if b.course is not None
        },
    )


def unique_names(names: Iterable[str]) -> tuple[str, ...]:
    """The names with `#2`, `#3`, ... after repeated ones, as parallel lines have."""
    count: dict[str, int] = {}
    numbered = []
    for name in names:
        count[name] = count.get(name, 0) + 1
        numbered.append(name if count[name] == 1 else f"{name}#{count[name]}")
    return tuple(numbered)
