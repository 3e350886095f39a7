"""A feeder as its source has it: the network, and the devices that the source knows."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from resilience.case.networks.network import Network


class FeederError(Exception):
    """A network that cannot be read: `(key, value, allowed, hint)`."""


@dataclass(frozen=True)
class Branch:
    """One line or transformer on its way into a network; impedances in pu on 1 MVA."""

    from_bus: str
    to_bus: str
    r_pu: float
    x_pu: float
    rating_mva: float = float("inf")
    in_service: bool = True
    name: str = ""


@dataclass(frozen=True)
class SourceDevice:
    """A load, generator or grid connection that a network file brings along; MW and Mvar."""

    name: str
    bus: str
    p_mw: float
    q_mvar: float = 0.0
    v_pu: float = 1.0


@dataclass(frozen=True)
class Feeder:
    """A network as its source has it, with the devices the source knows.

    Voltage limits are not taken from the source; the case sets them. `places` holds the (x, y) of
    buses, whatever the source means by them: degrees of longitude and latitude, or a drawing.
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
    """Assemble a network from `(bus name, vn_kv)` pairs and branches that name their buses."""
    index = {name: i for i, (name, _) in enumerate(buses)}
    index |= {alias: index[name] for alias, name in (aliases or {}).items()}
    count, closed = len(branches), np.zeros(len(branches), dtype=np.bool_)
    return Network(
        bus_names=tuple(name for name, _ in buses),
        vn_kv=np.array([vn for _, vn in buses], dtype=np.float64),
        v_min_pu=np.full(len(buses), 0.9),
        v_max_pu=np.full(len(buses), 1.1),
        line_names=unique_names(b.name or f"{b.from_bus}-{b.to_bus}" for b in branches),
        from_bus=np.array([index[b.from_bus] for b in branches], dtype=np.int64).reshape(count),
        to_bus=np.array([index[b.to_bus] for b in branches], dtype=np.int64).reshape(count),
        r_pu=np.array([b.r_pu for b in branches], dtype=np.float64),
        x_pu=np.array([b.x_pu for b in branches], dtype=np.float64),
        rating_mva=np.array([b.rating_mva for b in branches], dtype=np.float64),
        in_service=np.array([b.in_service for b in branches], dtype=np.bool_),
        switchable=closed,
        switching_cost=np.zeros(count),
        breakpoint=closed.copy(),
        aliases=dict(aliases or {}),
    )


def unique_names(names: Iterable[str]) -> tuple[str, ...]:
    """Return the names with `#2`, `#3`, ... after repeated ones, as parallel lines have."""
    seen: dict[str, int] = {}
    out = []
    for name in names:
        seen[name] = seen.get(name, 0) + 1
        out.append(name if seen[name] == 1 else f"{name}#{seen[name]}")
    return tuple(out)
