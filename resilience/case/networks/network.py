"""The network of a case: buses and branches in per unit on a base of 1 MVA."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.case.networks.course import Course
from resilience.errors import UsageError, did_you_mean


@dataclass(frozen=True, eq=False)
class Network:
    """Buses and branches (lines and two-winding transformers) of one feeder.

    Attributes:
        bus_names: of the buses, in the order of all arrays (buses,).
        vn_kv: (buses,) nominal voltage, kV.
        v_min_pu: (buses,) lower limit of the voltage, pu of `vn_kv`.
        v_max_pu: (buses,) upper limit of the voltage, pu of `vn_kv`.
        line_names: of the branches, in the order of all arrays (lines,).
        from_bus: (lines,) position of the bus at one end.
        to_bus: (lines,) position of the bus at the other.
        r_pu: (lines,) resistance, pu on 1 MVA; the impedance scale of the case is already in it.
        x_pu: (lines,) reactance, likewise.
        rating_mva: (lines,) limit of apparent power, MVA; inf for none.
        in_service: (lines,) whether the line is closed at first.
        switchable: (lines,) whether it can be opened and closed.
        switching_cost: (lines,) $ per action.
        breakpoint: (lines,) whether it can fail.
        parallel_grids: whether several grid connections may feed one tree of closed lines.
        placeholder_kv: the nominal voltages stand for nothing, as the source has only per unit.
        aliases: names of buses that a closed switch fuses to the one that stands for them.
        courses: how lines run, by name, of those whose source says anything of it.
    """

    bus_names: tuple[str, ...]
    vn_kv: Floats
    v_min_pu: Floats
    v_max_pu: Floats
    line_names: tuple[str, ...]
    from_bus: Ints
    to_bus: Ints
    r_pu: Floats
    x_pu: Floats
    rating_mva: Floats
    in_service: Bools
    switchable: Bools
    switching_cost: Floats
    breakpoint: Bools
    parallel_grids: bool = False
    placeholder_kv: bool = False
    aliases: Mapping[str, str] = field(default_factory=dict)
    courses: Mapping[str, Course] = field(default_factory=dict)
    _bus_index: dict[str, int] = field(init=False, repr=False)
    _line_index: dict[str, int] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        buses = {name: i for i, name in enumerate(self.bus_names)}
        buses |= {alias: buses[name] for alias, name in self.aliases.items()}
        object.__setattr__(self, "_bus_index", buses)
        lines = {name: i for i, name in enumerate(self.line_names)}
        object.__setattr__(self, "_line_index", lines)
        for f in fields(self):
            value = getattr(self, f.name)
            if isinstance(value, np.ndarray):
                value.setflags(write=False)

    def bus(self, name: str) -> int:
        """The position of a bus.

        Raises:
            UsageError: the network has no bus of this name.
        """
        if name not in self._bus_index:
            raise UsageError(f"bus {name!r} is not in the network", self.bus_hint(name))
        return self._bus_index[name]

    def line(self, name: str) -> int:
        """The position of a line.

        Raises:
            UsageError: the network has no line of this name.
        """
        if name not in self._line_index:
            raise UsageError(f"line {name!r} is not in the network", self.line_hint(name))
        return self._line_index[name]

    def has_bus(self, name: str) -> bool:
        """Whether a bus, or a bus fused into another, has this name."""
        return name in self._bus_index

    def has_line(self, name: str) -> bool:
        """Whether a line has this name."""
        return name in self._line_index

    def bus_hint(self, name: str) -> str:
        """What to write instead of an unknown bus name."""
        return did_you_mean(name, self._bus_index)

    def line_hint(self, name: str) -> str:
        """What to write instead of an unknown line name; ends may be swapped."""
        swapped = "-".join(reversed(name.split("-")))
        if swapped in self._line_index:
            return f"did you mean {swapped}?"
        return did_you_mean(name, self._line_index)

    def equals(self, network: Network) -> bool:
        """Whether both networks are the same, number for number."""
        return all(
            np.array_equal(getattr(self, f.name), getattr(network, f.name))
            if isinstance(getattr(self, f.name), np.ndarray)
            else getattr(self, f.name) == getattr(network, f.name)
            for f in fields(self)
        )
