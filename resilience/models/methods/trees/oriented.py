r"""A tighter relaxation of trees: every line has a direction away from the root.

In a forest each live bus is a root or has one parent. With arcs $a^+_l + a^-_l = z_l$ (or 1 for a
closed line without a switch) and the power of a switchable line split between its two arcs,

$$ \rho_b + \sum_{l \to b} a^\pm_l = \alpha_b, \qquad P = P^+ + P^-, \quad
\ell^\pm w^\pm \ge (P^\pm)^2 + (Q^\pm)^2, \quad w^\pm \le \overline{V}^2 a^\pm, \quad
w^+ + w^- \le v_i / \tau^2 $$

which every tree satisfies, and no mixture of trees as easily as $\ell v \ge P^2 + Q^2$ and big-M
rows: half a line pays for a whole current (the perspective of the cone). Where nothing but roots
feeds in, power flows away from the root, an arc carries at least what the bus at its end takes, and
no voltage is above the root's. Elsewhere at most what is fed in elsewhere flows back.

The commodity of `topology` is left out: a search over trees knows cycles by itself.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Bools, Floats, Ints
from resilience.models.backends.clarabel import ConeProgram, SecondOrderRows
from resilience.models.case_program import CaseProgram
from resilience.models.components.fleet import bus_capacity
from resilience.models.components.line import Lines
from resilience.models.components.loops import parallel
from resilience.models.network.limits import MARGIN, admittances
from resilience.models.program.standard import Vectors
from resilience.models.structures import SecondOrder

TWO_SIDED = ("line.p.switch", "line.q.switch", "line.gap.switch", "topology.flow.switch")
REPLACED = (
    *(f"{row}{side}" for row in TWO_SIDED for side in (".upper", ".lower")),
    *("topology.tree", "topology.reach", "topology.feed.root", "line.l.switch"),
)
ARC_COLUMNS = ("p", "q", "l", "w")


@dataclass
class ArcRows:
    """Rows under construction, over columns that are known by number.

    Attributes:
        entries: rows, columns and values, (k,) each.
        low: lower sides, -inf where there is none.
        high: upper sides.
        n: rows so far.
    """

    entries: list[tuple[Ints, Ints, Floats]] = field(default_factory=list)
    low: list[Floats] = field(default_factory=list)
    high: list[Floats] = field(default_factory=list)
    n: int = 0

    def add(
        self, terms: list[tuple[Ints, Floats | float]], low: Floats | float, high: Floats | float
    ) -> None:
        """As many rows as the terms have columns, each term one column per row."""
        count = len(terms[0][0])
        for columns, values in terms:
            rows = self.n + np.arange(count)
            self.entries.append((rows, columns, np.broadcast_to(values, (count,))))
        self._sides(low, high, count)

    def add_matrix(self, block: sp.csr_array, low: Floats | float, high: Floats | float) -> None:
        """The rows of a matrix."""
        coo = block.tocoo()
        self.entries.append((self.n + coo.row, coo.col, coo.data))
        self._sides(low, high, block.shape[0])

    def _sides(self, low: Floats | float, high: Floats | float, count: int) -> None:
        self.low.append(np.broadcast_to(np.asarray(low, float), (count,)))
        self.high.append(np.broadcast_to(np.asarray(high, float), (count,)))
        self.n += count

    def matrix(self, width: int) -> sp.csr_array:
        """(rows, width)."""
        rows, columns, values = (np.concatenate(entry) for entry in zip(*self.entries, strict=True))
        return sp.csr_array((values, (rows, columns)), shape=(self.n, width))


@dataclass(frozen=True)
class OrientedProgram:
    """The relaxation, and where its columns stand.

    Attributes:
        cones: the program.
        lower, upper: (columns,) the widest box.
        closed: (switches, slots) columns of `line.closed`.
        arcs: (2, switches, slots) columns of both arcs of every switch.
        of_arc: (2, kinds, switches, slots) what is zero where an arc is.
        current: (switches, slots) columns of `line.l`.
    """

    cones: ConeProgram
    lower: Floats
    upper: Floats
    closed: Ints
    arcs: Ints
    of_arc: Ints
    current: Ints

    def box(self, low: Bools, high: Bools) -> tuple[Floats, Floats]:
        """Bounds where switches (switches, slots) are closed for sure, and may be closed."""
        lower, upper = self.lower.copy(), self.upper.copy()
        lower[self.closed], upper[self.closed] = low, high & (upper[self.closed] > 0.5)
        gone = ~high
        for columns in (*self.arcs, *self.of_arc.reshape(-1, *self.closed.shape), self.current):
            lower[columns[gone]] = upper[columns[gone]] = 0.0
        return lower, upper


def oriented(program: CaseProgram) -> OrientedProgram:
    """The relaxation of a program in MW and $ whose islands are given by data."""
    return _Builder(program).build()


class _Builder:
    def __init__(self, program: CaseProgram) -> None:
        self.program, self.standard = program, program.standard
        self.vectors, network = program.vectors, program.microgrid.network
        self.network, self.switched = network, np.flatnonzero(network.switchable)
        self.slots = self.standard.tree.n
        self.line = {name: self.standard.columns(f"line.{name}") for name in ("p", "q", "l")}
        self.v = self.standard.columns("bus.v_sq")
        self.lower, self.upper = self.vectors.lower.copy(), self.vectors.upper.copy()
        self.rows = ArcRows()
        self.back_mva = self._back_mva()
        self.one_way = self.back_mva == 0.0
        falls = (network.tap == 1.0) & (network.r_pu >= 0.0) & (network.x_pu >= 0.0)
        if self.one_way and falls.all():
            roots = self.v[program.microgrid.forming]
            self.upper[self.v] = np.minimum(self.upper[self.v], self.upper[roots].max(0))

    def build(self) -> OrientedProgram:
        standard, shape = self.standard, (2, len(self.switched), self.slots)
        network, alive = self.network, self.program.situation.alive
        fixed = np.flatnonzero(~network.switchable)
        up = self.program.situation.line_up[fixed] * alive[network.from_bus[fixed]]
        lines = next(c for c in self.program.microgrid.components if isinstance(c, Lines))
        _, later, _ = parallel(lines)
        up = np.where(np.isin(fixed, later)[:, None], 0.0, up)  # however many: one link
        arcs, fixed_arcs = self._columns(shape, 1.0), self._columns((2, *up.shape), up)
        split = {name: self._columns(shape, 0.0) for name in ARC_COLUMNS}
        closed = standard.columns("line.closed")
        self._keep_rows()
        self._join(closed, arcs)
        self.rows.add([(c.ravel(), 1.0) for c in fixed_arcs], up.ravel(), up.ravel())
        self._parents(arcs, fixed_arcs, fixed)
        for k in range(2):
            self._arc(arcs[k], {name: c[k] for name, c in split.items()}, k)
        self._split(split)
        self._voltages(closed)
        width = len(self.lower)
        cost = np.append(self.vectors.cost, np.zeros(width - standard.n_columns))
        cones = ConeProgram(
            a=self.rows.matrix(width),
            numbers=Vectors(
                cost, self.vectors.offset, self.lower, self.upper,
                np.concatenate(self.rows.low), np.concatenate(self.rows.high),
            ),
            cones=(*self._kept_cones(width), *self._arc_cones(split, width)),
            boxed=self._boxed(split, width),
        )  # fmt: skip
        of_arc = np.stack([split[name] for name in ARC_COLUMNS], axis=1)
        current = self.line["l"][self.switched]
        return OrientedProgram(cones, self.lower, self.upper, closed, arcs, of_arc, current)

    def _columns(self, shape: tuple[int, ...], upper: Floats | float) -> Ints:
        """New columns of zero and more."""
        n = int(np.prod(shape))
        columns = len(self.lower) + np.arange(n).reshape(shape)
        self.lower = np.append(self.lower, np.zeros(n))
        self.upper = np.append(self.upper, np.broadcast_to(upper, shape).ravel())
        return columns

    def _back_mva(self) -> float:
        """What flows towards a root at most: fed in by whatever is no root for sure."""
        microgrid = self.program.microgrid
        names, capacity = bus_capacity(microgrid.fleets.values(), len(self.network.bus_names))
        profiles = [self.program.situation.profile(name).max() for name in names]
        feeds, _ = admittances(self.network)
        supply = capacity.supply @ np.array(profiles) + feeds * self.network.v_max_pu**2
        forming = microgrid.forming
        sure = microgrid.separate_grids | (forming & (forming.sum() == 1))
        return MARGIN * float(supply[~sure].sum())

    def _keep_rows(self) -> None:
        """The program's own rows, without those that arcs replace."""
        standard, v = self.standard, self.vectors
        keep = np.ones(standard.n_rows, bool)
        for name in REPLACED:
            keep[standard.rows(name).ravel()] = False
        self.rows.add_matrix(standard.a[keep], v.row_lower[keep], v.row_upper[keep])
        for name in ("topology.flow", "topology.feed"):
            columns = standard.columns(name).ravel()
            self.lower[columns] = self.upper[columns] = 0.0

    def _join(self, closed: Ints, arcs: Ints) -> None:
        terms = [(c.ravel(), 1.0) for c in arcs]
        self.rows.add([*terms, (closed.ravel(), -1.0)], 0.0, 0.0)

    def _parents(self, arcs: Ints, fixed_arcs: Ints, fixed: Ints) -> None:
        """Each live bus is a root or has one parent."""
        network, n = self.network, len(self.network.bus_names)
        ends = network.to_bus, network.from_bus  # that the arcs forth and back lead to
        alive, (rows, columns) = self.program.situation.alive, ([], [])
        for lines, pair in ((self.switched, arcs), (fixed, fixed_arcs)):
            for end, arc in zip(ends, pair, strict=True):
                rows.append((end[lines][:, None] * self.slots + np.arange(self.slots)).ravel())
                columns.append(arc.ravel())
        roots = np.array([network.bus_names.index(b) for b in
                          self.standard.labels("topology.root")])  # fmt: skip
        rows.append((roots[:, None] * self.slots + np.arange(self.slots)).ravel())
        columns.append(self.standard.columns("topology.root").ravel())
        row, column = np.concatenate(rows), np.concatenate(columns)
        shape = (n * self.slots, len(self.lower))
        block = sp.csr_array((np.ones(len(row)), (row, column)), shape=shape)
        self.rows.add_matrix(block, alive.ravel(), alive.ravel())

    def _arc(self, arc: Ints, split: dict[str, Ints], k: int) -> None:
        """Limits of one direction: what it may carry, back and forth, while it is on."""
        sign, network, lines = 1.0 - 2.0 * k, self.network, self.switched
        on, beside = arc.ravel(), self.line
        for name in ("p", "q"):
            column = beside[name][lines]
            limit = np.maximum(np.abs(self.lower[column]), np.abs(self.upper[column]))
            back = np.minimum(limit, self.back_mva)
            self.lower[split[name]], self.upper[split[name]] = (
                (-back, limit) if k == 0 else (-limit, back)
            )
            flow = split[name].ravel()
            self.rows.add([(flow, sign), (on, -limit.ravel())], -np.inf, 0.0)
            self.rows.add([(flow, -sign), (on, -back.ravel())], -np.inf, 0.0)
        self.upper[split["l"]] = self.upper[beside["l"][lines]]
        top = self.upper[self.v][network.from_bus[lines]] / network.tap[lines][:, None] ** 2
        self.upper[split["w"]] = top
        self.rows.add([(split["w"].ravel(), 1.0), (on, -top.ravel())], -np.inf, 0.0)
        if self.one_way:
            self._taken(arc, split, k)

    def _taken(self, arc: Ints, split: dict[str, Ints], k: int) -> None:
        """An arc delivers at least what the bus at its end takes, devices less what they feed."""
        network, lines, standard = self.network, self.switched, self.standard
        end = (network.to_bus if k == 0 else network.from_bus)[lines]
        lines_only = np.zeros(standard.n_columns, bool)
        for columns in self.line.values():
            lines_only[columns] = True
        for name, loss in (("p", network.r_pu), ("q", network.x_pu)):
            rows = standard.rows(f"balance.{name}")[end].ravel()
            devices = standard.a[rows] @ sp.diags_array((~lines_only).astype(float))
            sides = self.vectors.row_upper[rows]
            floor = _least(devices, self.lower, self.upper)
            demand = sides - floor
            # delivered - demand * arc + (devices - floor) >= 0
            arc_flow, on, lost = (c.ravel() for c in (split[name], arc, split["l"]))
            factor = np.repeat(loss[lines], self.slots)
            n, width = len(rows), len(self.lower)
            row = np.arange(n)
            flow = 1.0 if k == 0 else -1.0
            terms: list[tuple[Ints, Floats | float]] = [(arc_flow, flow), (on, -demand)]
            terms += [(lost, -factor)] if k == 0 else []
            block = sp.csr_array((devices.data, devices.indices, devices.indptr), (n, width))
            for columns, values in terms:
                data = np.broadcast_to(values, (n,))
                block = block + sp.csr_array((data, (row, columns)), shape=(n, width))
            useful = np.flatnonzero((demand > 0.0) & np.isfinite(floor))
            self.rows.add_matrix(block[useful], floor[useful], np.inf)

    def _split(self, split: dict[str, Ints]) -> None:
        """Flows and currents are those of the two arcs; the two have one voltage."""
        network, lines = self.network, self.switched
        for name in ("p", "q", "l"):
            terms = [(c.ravel(), 1.0) for c in split[name]]
            total = self.line[name][lines].ravel()
            self.rows.add([*terms, (total, -1.0)], 0.0, 0.0)
        v = self.v[network.from_bus[lines]].ravel()
        per_tap = -1.0 / np.repeat(network.tap[lines], self.slots) ** 2
        self.rows.add([*[(c.ravel(), 1.0) for c in split["w"]], (v, per_tap)], -np.inf, 0.0)

    def _voltages(self, closed: Ints) -> None:
        """What an open line may have between its ends, from the voltages that trees can have."""
        network, lines = self.network, self.switched
        labels = self.standard.labels("line.gap")
        places = [labels.index(network.line_names[k]) for k in lines]
        gap = self.standard.columns("line.gap")[places]
        i, j, square = network.from_bus[lines], network.to_bus[lines], network.tap[lines] ** 2
        low, high = self.lower[self.v], self.upper[self.v]
        width = np.maximum(high[j] - low[i] / square[:, None], high[i] / square[:, None] - low[j])
        width = np.minimum(width, self.upper[gap]).ravel()
        for sign in (1.0, -1.0):
            self.rows.add([(gap.ravel(), sign), (closed.ravel(), width)], -np.inf, width)

    def _boxed(self, split: dict[str, Ints], width: int) -> Bools:
        """(columns,) all but those of switchable lines, whose arcs have rows that say as much."""
        boxed = np.ones(width, bool)
        for columns in split.values():
            boxed[columns] = False
        for columns in self.line.values():
            boxed[columns[self.switched]] = False
        return boxed

    def _kept_cones(self, width: int) -> list[SecondOrderRows]:
        """The program's own second-order rows but those of switchable lines."""
        stated = []
        is_switched = np.zeros(len(self.network.line_names), bool)
        is_switched[self.switched] = True
        for unrolled in self.standard.structures_of(SecondOrder).values():
            cones = unrolled
            if unrolled.name == "line.flow":
                stays = ~np.tile(is_switched, len(unrolled.nodes))
                cones = unrolled.elements(np.flatnonzero(stays))
            matrices, consts = cones.structure.second_order(cones)
            if len(consts[0]):
                stated.append(SecondOrderRows([_wide(m, width) for m in matrices], consts))
        return stated

    def _arc_cones(self, split: dict[str, Ints], width: int) -> list[SecondOrderRows]:
        cones = []
        for k in range(2):
            p, q, current, w = (split[name][k].ravel() for name in ARC_COLUMNS)
            n = len(p)

            def rows(*terms: tuple[Ints, float], n: int = n) -> sp.csr_array:
                row = np.tile(np.arange(n), len(terms))
                columns = np.concatenate([c for c, _ in terms])
                values = np.repeat([value for _, value in terms], n)
                return sp.csr_array((values, (row, columns)), shape=(n, width))

            matrices = [
                rows((current, 1.0), (w, 1.0)), rows((p, 2.0)), rows((q, 2.0)),
                rows((current, 1.0), (w, -1.0)),
            ]  # fmt: skip
            cones.append(SecondOrderRows(matrices, [np.zeros(n)] * 4))
        return cones


def _least(a: sp.csr_array, lower: Floats, upper: Floats) -> Floats:
    """(rows,) least value of a @ z over a box."""
    n = a.shape[1]
    up, down = a.maximum(0.0), a.minimum(0.0)
    return np.asarray(up @ lower[:n] + down @ upper[:n])


def _wide(m: sp.csr_array, width: int) -> sp.csr_array:
    wide = m.copy()
    wide.resize(m.shape[0], width)
    return wide
