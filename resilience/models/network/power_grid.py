"""A network as tables of power-grid-model: what is a line there, a generic branch, a shunt."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from resilience.arrays import Bools, Complexes, Ints

if TYPE_CHECKING:
    from resilience.case import Network

MEGA = 1e6
RATED_V = 1e3
SHORT_CIRCUIT_VA = 1e16  # of a root: 1e-10 pu behind it, where the default is 1e-4
MIN_X_PU = 1e-8  # in place of an impedance of zero, which has no admittance
OUTPUT: Any = {
    "node": ["u_pu", "u_angle"],
    "line": ["p_from", "q_from", "s_from", "p_to", "s_to"],
    "source": ["p", "q"],
}
ENDS: Any = ["p_from", "q_from", "p_to", "q_to"]


@dataclass(frozen=True)
class Wires:
    """Lines that are closed in any member, by what they are to power-grid-model, and shunts.

    Attributes:
        line: indices of plain lines.
        branch: indices of lines with a ratio or with charging.
        shunt_bus: (shunts,) index of the bus.
        shunt_pu: (shunts,) admittance at the bus, pu.
        shunt_line: (shunts,) index of the line whose charging it is; -1 for a shunt of the bus.
        shunt_end: (shunts,) whether it is at the second end of that line.
    """

    line: Ints
    branch: Ints
    shunt_bus: Ints
    shunt_pu: Complexes
    shunt_line: Ints
    shunt_end: Bools

    @classmethod
    def from_lines(cls, network: Network, lines: Ints) -> Wires:
        """The lines, those among them that are plain, and every admittance to earth."""
        plain = network.plain[lines]
        y_from, y_to = network.y_from_pu[lines] / network.tap[lines] ** 2, network.y_to_pu[lines]
        buses, none = np.flatnonzero(network.y_bus_pu), np.full(len(network.bus_names), -1)
        first, second = np.flatnonzero(y_from), np.flatnonzero(y_to)
        charged = lines[np.concatenate([first, second])]
        ends = np.concatenate([network.from_bus[lines[first]], network.to_bus[lines[second]]])
        return cls(
            line=lines[plain],
            branch=lines[~plain],
            shunt_bus=np.concatenate([buses, ends]),
            shunt_pu=np.concatenate([network.y_bus_pu[buses], y_from[first], y_to[second]]),
            shunt_line=np.concatenate([none[buses], charged]),
            shunt_end=np.arange(len(buses) + len(charged)) >= len(buses) + len(first),
        )

    def status(self, up: Bools) -> dict[str, Any]:
        """What is closed, of (lines, members), as power-grid-model has it."""
        line, branch = (
            rows_of_members(up[chosen].astype(np.int8)) for chosen in (self.line, self.branch)
        )
        status: dict[str, Any] = {"line": {"from_status": line, "to_status": line}}
        if len(self.branch):
            status["generic_branch"] = {"from_status": branch, "to_status": branch}
        if len(self.shunt_bus):
            on = up[self.shunt_line] | (self.shunt_line < 0)[:, None]
            status["shunt"] = {"status": rows_of_members(on.astype(np.int8))}
        return status

    @property
    def output(self) -> Any:
        """What to ask of a solution."""
        quantities: Any = OUTPUT | ({"generic_branch": ENDS} if len(self.branch) else {})
        return quantities | ({"shunt": ["p", "q"]} if len(self.shunt_bus) else {})


def rows_of_members(values: np.ndarray) -> np.ndarray:
    """A row per member, as power-grid-model has it."""
    return np.ascontiguousarray(values.T)


def parts_of(network: Network, wires: Wires, sources: Ints) -> dict[str, np.ndarray]:
    """The network as tables of power-grid-model, one injection per bus."""
    from power_grid_model import initialize_array

    n, lines = len(network.bus_names), wires.line
    first = np.cumsum([0, n, n, len(lines), len(sources), len(wires.branch)])
    node: Any = initialize_array("input", "node", n)
    node["id"], node["u_rated"] = np.arange(n), RATED_V
    feed: Any = initialize_array("input", "sym_gen", n)
    feed["id"], feed["node"], feed["status"] = first[1] + np.arange(n), np.arange(n), 1
    feed["type"], feed["p_specified"], feed["q_specified"] = 0, 0.0, 0.0
    line: Any = initialize_array("input", "line", len(lines))
    line["id"] = first[2] + np.arange(len(lines))
    line["from_node"], line["to_node"] = network.from_bus[lines], network.to_bus[lines]
    line["from_status"], line["to_status"] = 1, 1
    r, x = network.r_pu[lines], network.x_pu[lines]
    line["r1"], line["x1"] = r, np.where(np.hypot(r, x) < MIN_X_PU, MIN_X_PU, x)
    line["c1"], line["tan1"] = 0.0, 0.0
    source: Any = initialize_array("input", "source", len(sources))
    source["id"], source["node"] = first[3] + np.arange(len(sources)), sources
    source["status"], source["u_ref"], source["sk"] = 1, 1.0, SHORT_CIRCUIT_VA
    parts = {"node": node, "sym_gen": feed, "line": line, "source": source}
    if len(wires.branch):
        parts["generic_branch"] = _branches(network, wires.branch, int(first[4]))
    if len(wires.shunt_bus):
        shunt: Any = initialize_array("input", "shunt", len(wires.shunt_bus))
        shunt["id"] = first[5] + np.arange(len(wires.shunt_bus))
        shunt["node"], shunt["status"] = wires.shunt_bus, 1
        shunt["g1"], shunt["b1"] = wires.shunt_pu.real, wires.shunt_pu.imag
        parts["shunt"] = shunt
    return parts


def _branches(network: Network, lines: Ints, first: int) -> np.ndarray:
    """Lines with a ratio, without their charging."""
    from power_grid_model import initialize_array

    branch: Any = initialize_array("input", "generic_branch", len(lines))
    branch["id"] = first + np.arange(len(lines))
    branch["from_node"], branch["to_node"] = network.from_bus[lines], network.to_bus[lines]
    branch["from_status"], branch["to_status"] = 1, 1
    r, x = network.r_pu[lines], network.x_pu[lines]
    branch["r1"], branch["x1"] = r, np.where(np.hypot(r, x) < MIN_X_PU, MIN_X_PU, x)
    branch["g1"], branch["b1"] = 0.0, 0.0
    branch["k"], branch["theta"] = network.tap[lines], np.angle(network.ratio[lines])
    branch["sn"] = MEGA
    return branch
