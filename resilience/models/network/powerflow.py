r"""AC power flow of many members at once, islands included, by power-grid-model.

A member is one slot, scenario or draw: injections at every bus and the lines that are closed. Every
island hangs on one root, the bus whose unit holds the voltage and gives whatever the injections
leave over: losses, and all reactive power that nobody else feeds in.

Impedances are in pu on one base throughout the network, so all buses are given a rated voltage of
1 kV, where 1 pu on 1 MVA is 1 ohm; the result is in pu whatever the real voltages are. Branches
with a ratio are generic branches there; whatever flows to earth, charging at the two ends too, is a
shunt at its bus, on while its branch is closed.

| symbol | name | unit |
|---|---|---|
| $P_i, Q_i$ | `p_mw`, `q_mvar`: fed in at bus $i$, net | MW, Mvar |
| $V_i$ | `v_pu` | pu |
| $P_{ij}, Q_{ij}$ | `p_line_mw`, `q_line_mvar` at the sending end, charging included | MW, Mvar |
| $\sum_{ij} (P_{ij} + P_{ji}) + \sum_i g_i V_i^2$ | `loss_mw` | MW |
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from resilience.arrays import Bools, Floats, Ints
from resilience.errors import UsageError
from resilience.models.network.power_grid import MEGA, Wires, parts_of, rows_of_members
from resilience.models.network.situation import Situation

if TYPE_CHECKING:
    from resilience.case import Network

MIN_MEMBERS = 32  # members from which a pattern is worth a model of its own


@dataclass(frozen=True)
class Flow:
    """The solution of a power flow. All values of a member that did not converge are NaN.

    Attributes:
        network: what was solved.
        converged: (members,) False where there is no solution or an injection is no number.
        v_pu: (buses, members), NaN where a bus is dead.
        v_angle_rad: (buses, members) of the voltage, NaN likewise.
        p_line_mw, q_line_mvar: (lines, members) at the sending end, 0 where nothing flows.
        s_line_mva: (lines, members) apparent power at the end where it is larger.
        loss_mw: (members,) in all lines and shunts.
        p_root_mw, q_root_mvar: (buses, members) what a root gave beyond `p_mw` and `q_mvar`.
    """

    network: Network = field(repr=False)
    converged: Bools
    v_pu: Floats = field(repr=False)
    v_angle_rad: Floats = field(repr=False)
    p_line_mw: Floats = field(repr=False)
    q_line_mvar: Floats = field(repr=False)
    s_line_mva: Floats = field(repr=False)
    loss_mw: Floats = field(repr=False)
    p_root_mw: Floats = field(repr=False)
    q_root_mvar: Floats = field(repr=False)

    @classmethod
    def blank(cls, network: Network, converged: Bools) -> Flow:
        """Nothing flows, and no bus has a voltage."""
        buses, lines, n = len(network.bus_names), len(network.line_names), len(converged)
        none, idle = np.zeros((lines, n)), np.zeros((buses, n))
        dead = np.full((buses, n), np.nan)
        return cls(
            network,
            converged.copy(),
            v_pu=dead,
            v_angle_rad=dead.copy(),
            p_line_mw=none,
            q_line_mvar=none.copy(),
            s_line_mva=none.copy(),
            loss_mw=np.zeros(n),
            p_root_mw=idle,
            q_root_mvar=idle.copy(),
        )

    @property
    def overload_mva(self) -> Floats:
        """(lines, members) apparent power beyond the rating; 0 within it or without one."""
        return np.maximum(self.s_line_mva - self.network.rating_mva[:, None], 0.0)

    @property
    def line_angle_degree(self) -> Floats:
        """(lines, members) by how much the voltage at the first end leads that at the second, from
        -180 to 180; NaN where nothing flows.
        """
        lead = self.v_angle_rad[self.network.from_bus] - self.v_angle_rad[self.network.to_bus]
        return np.where(self.s_line_mva > 0.0, np.degrees(np.angle(np.exp(1j * lead))), np.nan)

    @property
    def angle_excess_degree(self) -> Floats:
        """(lines, members) how far that lies beyond the line's limits; negative within them."""
        angle, network = self.line_angle_degree, self.network
        low, high = network.angle_min_degree[:, None], network.angle_max_degree[:, None]
        return np.maximum(low - angle, angle - high)

    @property
    def v_violation_pu(self) -> Floats:
        """(buses, members) how far the voltage lies outside the bus's band; 0 within it."""
        below = self.network.v_min_pu[:, None] - self.v_pu
        above = self.v_pu - self.network.v_max_pu[:, None]
        return np.maximum(np.maximum(below, above), 0.0)


def flow(
    network: Network,
    p_mw: Floats,
    q_mvar: Floats,
    line_up: Bools,
    root: Bools,
    v_root: ArrayLike = 1.0,
) -> Flow:
    """Solves every member; those that fail are masked and disturb no other.

    Args:
        network: its own line status does not count; `line_up` does.
        p_mw: (buses, members) active power fed in, net of demand; ignored where a bus is dead.
        q_mvar: the same for reactive power.
        line_up: (lines,) or (lines, members) True where a line is closed.
        root: (buses,) or (buses, members) True for one bus of every island that is alive.
        v_root: voltage at the roots in pu: one number, (buses,), or (buses, members).

    Raises:
        UsageError: arrays that do not fit the network, or an island with two roots.
    """
    members = _Members.checked(network, p_mw, q_mvar, line_up, root, v_root)
    solution = Flow.blank(network, members.sound)
    for group in members.groups():
        _solve(members, group, solution)
    _mask(solution)
    return solution


@dataclass(frozen=True)
class _Members:
    """The request, every array spread over the members.

    Attributes:
        network: the network.
        p, q: (buses, members) MW and Mvar fed in.
        up: (lines, members) closed lines.
        root: (buses, members) roots of islands.
        v: (buses, members) pu to hold at roots.
        live: (buses, members) whether a bus hangs on a root.
        pattern: (members,) number of the pattern of lines and roots.
    """

    network: Network
    p: Floats
    q: Floats
    up: Bools
    root: Bools
    v: Floats
    live: Bools
    pattern: Ints

    @classmethod
    def checked(
        cls, network: Network, p: Floats, q: Floats, up: Bools, root: Bools, v: ArrayLike
    ) -> _Members:
        buses, lines = len(network.bus_names), len(network.line_names)
        p, q = np.asarray(p, float), np.asarray(q, float)
        members = p.shape[1] if p.ndim == 2 else 0
        shape = (buses, members)
        p, q = _filled("p_mw", p, shape), _filled("q_mvar", q, shape)
        up = _filled("line_up", np.asarray(up, bool), (lines, members))
        root = _filled("root", np.asarray(root, bool), shape)
        volts = _filled("v_root", np.asarray(v, float), shape)
        live, pattern = _islands(network, up, root)
        return cls(network, p, q, up, root, volts, live, pattern)

    @property
    def sound(self) -> Bools:
        """(members,) all numbers finite; power-grid-model takes NaN for `as before`."""
        finite = np.isfinite(self.p) & np.isfinite(self.q)
        has_voltage = np.isfinite(self.v) | ~self.root
        return np.all((finite & has_voltage) | ~self.live, axis=0)

    def groups(self) -> list[Ints]:
        """Indices of members to solve together: the common patterns alone, the rare ones at once.

        A model of its own is twice as fast as switching a common one, but takes as long to build
        as ten flows.
        """
        chosen = np.flatnonzero(self.sound & self.live.any(axis=0))
        counts = np.bincount(self.pattern[chosen])
        often = np.flatnonzero(counts >= MIN_MEMBERS)
        groups = [chosen[self.pattern[chosen] == k] for k in often]
        rare = chosen[counts[self.pattern[chosen]] < MIN_MEMBERS]
        return [*groups, rare] if len(rare) else groups


def _filled(name: str, array: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """The array, its one column, or its one number, for all members."""
    if array.shape not in (shape, shape[:1], ()):
        raise UsageError(
            f"{name} has the shape {array.shape}; allowed: {shape}",
            hint="rows follow the network's buses or lines, columns are the members of p_mw",
        )
    return np.broadcast_to(array[:, None] if array.ndim == 1 else array, shape)


def _islands(network: Network, up: Bools, root: Bools) -> tuple[Bools, Ints]:
    """(buses, members) whether a bus hangs on a root, and (members,) the number of the pattern."""
    packed = np.concatenate([np.packbits(up, axis=0), np.packbits(root, axis=0)])
    keys = np.ascontiguousarray(packed.T).view(f"V{len(packed)}").ravel()
    _, first, pattern = np.unique(keys, return_index=True, return_inverse=True)
    ends = np.stack([network.from_bus, network.to_bus])
    nobody = np.zeros(len(root), bool)
    n = len(first)
    situation = Situation(lambda _: np.ones(n), network.line_names, ends, up[:, first], nobody, n)
    island, roots = situation.island, root[:, first]
    count = np.zeros((island.max(initial=0) + 1, n), int)
    bus, column = np.nonzero(roots)
    np.add.at(count, (island[bus, column], column), 1)
    if (count > 1).any():
        number, column = np.argwhere(count > 1)[0]
        buses = np.flatnonzero(roots[:, column] & (island[:, column] == number))
        names = ", ".join(network.bus_names[k] for k in buses)
        raise UsageError(
            f"one island of member {first[column]} has the roots {names}; allowed: one",
            hint="`roots` chooses the largest forming unit of every island",
        )
    live = np.take_along_axis(count, island, axis=0) > 0
    return live[:, pattern], pattern


def _solve(members: _Members, group: Ints, solution: Flow) -> None:
    """Solves a group and writes its solution; the members that fail become unconverged."""
    from power_grid_model import PowerGridModel

    up, root = members.up[:, group], members.root[:, group]
    network = members.network
    lines, sources = np.flatnonzero(up.any(axis=1)), np.flatnonzero(root.any(axis=1))
    wires = Wires.from_lines(network, lines)
    model = PowerGridModel(parts_of(network, wires, sources))
    live = members.live[:, group]
    update: dict[str, Any] = {
        "sym_gen": {
            "p_specified": rows_of_members(np.where(live, members.p[:, group], 0.0) * MEGA),
            "q_specified": rows_of_members(np.where(live, members.q[:, group], 0.0) * MEGA),
        },
        "source": {"u_ref": rows_of_members(np.where(root, members.v[:, group], 1.0)[sources])},
    }
    if not (up[lines].all() and root[sources].all()):
        update |= wires.status(up)
        update["source"]["status"] = rows_of_members(root[sources].astype(np.int8))
    answer: Any = model.calculate_power_flow(
        update_data=update,
        output_component_types=wires.output,
        continue_on_batch_error=True,
    )
    error = model.batch_error
    if error is not None:
        solution.converged[group[np.asarray(error.failed_scenarios, np.intp)]] = False
    node = answer["node"]
    solution.v_pu[:, group] = np.where(live, node["u_pu"].T, np.nan)
    solution.v_angle_rad[:, group] = np.where(live, node["u_angle"].T, np.nan)
    if len(wires.line):
        _write_lines(answer["line"], np.ix_(wires.line, group), solution)
        loss_w = answer["line"]["p_from"] + answer["line"]["p_to"]
        solution.loss_mw[group] = loss_w.sum(axis=1) / MEGA
    if len(wires.branch) or len(wires.shunt_bus):
        _write_branches(wires, answer, group, solution)
    places = np.ix_(sources, group)
    solution.p_root_mw[places] = answer["source"]["p"].T / MEGA
    solution.q_root_mvar[places] = answer["source"]["q"].T / MEGA


def _write_branches(wires: Wires, answer: Any, group: Ints, solution: Flow) -> None:
    """Flows of branches with their charging, and the losses of these and of all shunts."""
    n = len(solution.network.line_names)
    ends = np.zeros((2, n, len(group)), complex)  # MW + j Mvar into both ends
    if len(wires.branch):
        branch = answer["generic_branch"]
        for k, end in enumerate(("from", "to")):
            ends[k, wires.branch] = (branch[f"p_{end}"] + 1j * branch[f"q_{end}"]).T / MEGA
    if len(wires.shunt_bus):
        earth_mva = (answer["shunt"]["p"] + 1j * answer["shunt"]["q"]).T / MEGA
        charging = wires.shunt_line >= 0
        place = wires.shunt_end.astype(int)[charging], wires.shunt_line[charging]
        np.add.at(ends, place, earth_mva[charging])
        solution.loss_mw[group] += earth_mva[~charging].real.sum(axis=0)
    solution.loss_mw[group] += ends.real.sum(axis=(0, 1))
    places = np.ix_(wires.branch, group)
    sent = ends[0, wires.branch]
    solution.p_line_mw[places], solution.q_line_mvar[places] = sent.real, sent.imag
    solution.s_line_mva[places] = np.abs(ends[:, wires.branch]).max(axis=0)


def _write_lines(line: Any, places: tuple[Ints, ...], solution: Flow) -> None:
    solution.p_line_mw[places] = line["p_from"].T / MEGA
    solution.q_line_mvar[places] = line["q_from"].T / MEGA
    solution.s_line_mva[places] = np.maximum(line["s_from"], line["s_to"]).T / MEGA


def _mask(solution: Flow) -> None:
    """What power-grid-model leaves in a failed member are numbers that mean nothing."""
    failed = ~solution.converged
    flows = "p_line_mw", "q_line_mvar", "s_line_mva", "p_root_mw", "q_root_mvar"
    for name in ("v_pu", "v_angle_rad", *flows):
        getattr(solution, name)[:, failed] = np.nan
    solution.loss_mw[failed] = np.nan
