r"""The network of a case: buses and branches in per unit on a base of 1 MVA.

A branch from bus $i$ to bus $j$ is a $\pi$ behind an ideal transformer, as in MATPOWER's manual
(section 3.2): with the ratio $a = \tau e^{\mathrm{j} \varphi}$ it sees $V_i' = V_i / a$, and

$$ I_i = \frac{1}{a^*} \left( y_i V_i' + \frac{V_i' - V_j}{r + \mathrm{j} x} \right), \qquad
I_j = y_j V_j + \frac{V_j - V_i'}{r + \mathrm{j} x} $$

flow into its two ends. A bus has a shunt $y_b$. An admittance $y = g + \mathrm{j} b$ takes
$g |V|^2$ MW and feeds in $b |V|^2$ Mvar, as the base is 1 MVA.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields

import numpy as np

from resilience.arrays import Bools, Complexes, Floats, Ints
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
            It may be negative, as in equivalents of three windings.
        x_pu: (lines,) reactance, likewise.
        ratio: (lines,) of the ideal transformer at `from_bus`, in per unit of the nominal voltages:
            its magnitude is the tap, its angle the phase shift; 1 for a line.
        y_from_pu: (lines,) admittance to earth behind the ratio, pu on 1 MVA: half the charging of
            a line, what magnetises a transformer.
        y_to_pu: (lines,) the same at `to_bus`.
        y_bus_pu: (buses,) shunts, pu on 1 MVA.
        rating_mva: (lines,) limit of apparent power, MVA; inf for none.
        angle_min_degree: (lines,) least that the voltage at `from_bus` may lead the one at
            `to_bus` by, degrees, phase shift included; -inf for none.
        angle_max_degree: (lines,) the most, likewise; inf for none.
        in_service: (lines,) whether the line is closed at first.
        switchable: (lines,) whether it can be opened and closed.
        switching_cost: (lines,) $ per action.
        breakpoint: (lines,) whether it can fail.
        parallel_grids: whether several grid connections may feed one tree of closed lines.
        radial: whether lines that can be switched are kept a tree.
        placeholder_kv: the nominal voltages stand for nothing, as the source has only per unit.
        aliases: names of buses that a closed switch fuses to the one that stands for them.
        courses: how lines run, by name, of those whose source says anything of it.
        open_ended: by name, lines that are open at one end only: the bus at which the other end
            hangs, and the admittance that it shows there, pu on 1 MVA.
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
    ratio: Complexes
    y_from_pu: Complexes
    y_to_pu: Complexes
    y_bus_pu: Complexes
    rating_mva: Floats
    angle_min_degree: Floats
    angle_max_degree: Floats
    in_service: Bools
    switchable: Bools
    switching_cost: Floats
    breakpoint: Bools
    parallel_grids: bool = False
    radial: bool = True
    placeholder_kv: bool = False
    aliases: Mapping[str, str] = field(default_factory=dict)
    courses: Mapping[str, Course] = field(default_factory=dict)
    open_ended: Mapping[str, tuple[str, complex]] = field(default_factory=dict)
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

    @property
    def tap(self) -> Floats:
        """(lines,) magnitude of `ratio`."""
        return np.abs(self.ratio)

    @property
    def plain(self) -> Bools:
        """(lines,) branches that are a series impedance and nothing else."""
        return (self.ratio == 1.0) & (self.y_from_pu == 0.0) & (self.y_to_pu == 0.0)

    @property
    def is_charged(self) -> bool:
        """Whether anything flows to earth, at a branch or at a bus."""
        return bool(self.y_from_pu.any() or self.y_to_pu.any() or self.y_bus_pu.any())

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
