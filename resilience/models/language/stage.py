"""One time step, described symbolically: the only language that components speak.

A stage holds affine rows, bounds, a cost in $ per step, states with a value now and next, and a few
named structures, the only non-affine things there are. Data enters bounds, right-hand sides and
prices, never the matrix, so that a built problem is re-solved by changing vectors alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from resilience.arrays import Bools, Floats, Ints
from resilience.models.algebra import Affine, Labels
from resilience.models.structures import Adjacent, Angle, Cone, Disc, Largest, Split, Structure


@dataclass(frozen=True)
class Block:
    """A named group of columns or data: one entry per label.

    Attributes:
        name: as `ess.charge`.
        labels: the devices, buses or lines it has an entry for.
        start: id of the first entry; ids of variables and of data are counted apart.
        unit: of the entries, as `MW`.
        about: what it is, in words; may be empty.
        kind: `variable`, `binary`, `now` for a state at the start of the step, `design`, or `data`.
    """

    name: str
    labels: Labels
    start: int
    unit: str = ""
    about: str = ""
    kind: str = "variable"

    @property
    def n(self) -> int:
        """Number of entries."""
        return len(self.labels)

    @property
    def slice(self) -> slice:
        """Where the block lies in the numbering it belongs to."""
        return slice(self.start, self.start + self.n)


@dataclass(frozen=True)
class Row:
    """`expression == 0` or `expression <= 0`, one per label.

    Attributes:
        name: as `balance.p`.
        labels: one per entry of the expression.
        expression: columns and data.
        equality: whether it is `== 0`.
    """

    name: str
    labels: Labels
    expression: Affine
    equality: bool


@dataclass(frozen=True)
class Cost:
    """`sum(price * term)` in $ per step.

    Attributes:
        name: as `load.shed`.
        term: what is paid for.
        price: $ per unit of each entry, constant or data.
    """

    name: str
    term: Affine
    price: Affine


@dataclass(frozen=True)
class Design:
    """What is built once: a state that never changes, and whose start is to be chosen.

    Attributes:
        block: its columns.
        lower, upper: (labels,) what may be built.
        cost: (labels,) $ per unit, paid once, whatever the tree.
    """

    block: Block
    lower: Floats
    upper: Floats
    cost: Floats


@dataclass
class Stage:
    """One step.

    Attributes:
        dt: its length, h.
        reactive: whether reactive power is carried; components look here.
        variables: blocks of columns, in the order of their ids.
        datums: blocks of exogenous data, in the order of theirs.
        rows: equations and inequalities.
        costs: what is minimised.
        penalties: terms that close relaxations when weighted slightly.
        tiebreaks: columns and weights of |x| by which equally good points are told apart.
        structures: the non-affine facts.
        states: per state its block at the start of the step and at its end; one block of a design.
        designs: the states among them that never change.
        lower: per block of variables its lower bound, constant or data.
        upper: likewise its upper bound.
        integer: likewise whether it is integer.
        auxiliary: by name of a variable, (labels,) which of its bounds are there for solvers alone:
            no plan of the model reaches them, and the referee looks whether one did.
    """

    dt: float
    reactive: bool = False
    variables: list[Block] = field(default_factory=list)
    datums: list[Block] = field(default_factory=list)
    rows: list[Row] = field(default_factory=list)
    costs: list[Cost] = field(default_factory=list)
    penalties: list[Affine] = field(default_factory=list)
    tiebreaks: list[tuple[Affine, Floats]] = field(default_factory=list)
    structures: list[Structure] = field(default_factory=list)
    states: list[tuple[Block, Block]] = field(default_factory=list)
    designs: list[Design] = field(default_factory=list)
    lower: list[Affine] = field(default_factory=list)
    upper: list[Affine] = field(default_factory=list)
    integer: list[bool] = field(default_factory=list)
    auxiliary: dict[str, Bools] = field(default_factory=dict)
    _named: dict[str, Affine] = field(default_factory=dict)

    def __getitem__(self, name: str) -> Affine:
        """The variable, datum or expression of that name, as some other component declared it."""
        return self._named[name]

    def __contains__(self, name: str) -> bool:
        return name in self._named

    def var(
        self,
        name: str,
        labels: Sequence[str],
        lower: Any = 0.0,
        upper: Any = np.inf,
        *,
        unit: str = "MW",
        about: str = "",
        integer: bool = False,
        kind: str = "variable",
    ) -> Affine:
        """One column per label, within bounds that may be data."""
        self._check_fresh(name)
        labels = tuple(labels)
        block = Block(name, labels, self._width(self.variables), unit, about, kind)
        self.variables.append(block)
        self.lower.append(self._data_only(lower, block))
        self.upper.append(self._data_only(upper, block))
        self.integer.append(integer)
        return self._remember(name, np.arange(block.start, block.start + block.n), labels)

    def mark_auxiliary(self, name: str, chosen: Bools | None = None) -> None:
        """Says that the bounds of a variable, or of its entries `chosen`, are there for solvers."""
        block = next(block for block in self.variables if block.name == name)
        self.auxiliary[name] = np.ones(block.n, bool) if chosen is None else chosen

    def binary(
        self, name: str, labels: Sequence[str], upper: Any = 1.0, *, about: str = ""
    ) -> Affine:
        """One 0/1 column per label."""
        return self.var(
            name, labels, 0.0, upper, unit="1", about=about, integer=True, kind="binary"
        )

    def data(
        self, name: str, labels: Sequence[str], *, unit: str = "MW", about: str = ""
    ) -> Affine:
        """Exogenous values, one per label: for bounds, right-hand sides and prices."""
        self._check_fresh(name)
        labels = tuple(labels)
        block = Block(name, labels, self._width(self.datums), unit, about, "data")
        self.datums.append(block)
        return self._remember(name, ~np.arange(block.start, block.start + block.n), labels)

    def state(
        self,
        name: str,
        labels: Sequence[str],
        lower: Any,
        upper: Any,
        *,
        unit: str,
        about: str = "",
        integer: bool = False,
    ) -> tuple[Affine, Affine]:
        """Value at the start of the step and at its end; the bounds hold at the end."""
        now = self.var(name + ".now", labels, -np.inf, np.inf, unit=unit, about=about, kind="now")
        before = self.variables[-1]
        after = self.var(name, labels, lower, upper, unit=unit, about=about, integer=integer)
        self.states.append((before, self.variables[-1]))
        return now, after

    def design(
        self,
        name: str,
        labels: Sequence[str],
        lower: ArrayLike,
        upper: ArrayLike,
        cost: ArrayLike,
        *,
        unit: str,
        about: str = "",
        integer: bool = False,
    ) -> Affine:
        """What is built before the first step: a state that never changes, its start free.

        All nodes of a tree share its columns. `cost` is $ per unit, paid once.
        """
        n = len(labels)
        self.var(
            name, labels, -np.inf, np.inf, unit=unit, about=about, integer=integer, kind="design"
        )
        block = self.variables[-1]
        low, high, price = (np.broadcast_to(np.asarray(x, float), n) for x in (lower, upper, cost))
        self.states.append((block, block))
        self.designs.append(Design(block, low, high, price))
        return self._named[name]

    def define(self, name: str, x: Affine) -> None:
        """Makes an expression known by a name, for components that come later."""
        self._check_fresh(name)
        self._named[name] = x

    def eq(self, name: str, x: Affine, right: Any = 0.0) -> None:
        """`x == right` for every label of x."""
        self._row(name, x - right, True)

    def le(self, name: str, x: Affine, right: Any = 0.0) -> None:
        """`x <= right` for every label of x."""
        self._row(name, x - right, False)

    def cost(self, name: str, term: Affine, price: Any = 1.0) -> None:
        """Adds `sum(price * term)` $ per step under `name`; `price` may be data."""
        worth = price if isinstance(price, Affine) else Affine.constant(price, term.n)
        if worth.n != term.n:
            raise ValueError(f"cost {name!r}: {worth.n} prices for {term.n} terms")
        if worth.has_variables or (worth.has_data and term.has_data):
            raise ValueError(f"cost {name!r}: a price may be data, but only of pure variables")
        self.costs.append(Cost(name, term, worth))

    def penalty(self, term: Affine) -> None:
        """A term that closes relaxations when weighted slightly; never part of the objective."""
        self.penalties.append(term.sum())

    def tiebreak(self, x: Affine, weight: Floats) -> None:
        """Among equally good points, one with a small `sum(weight * |x|)` is wanted; x: columns."""
        self.tiebreaks.append((x, weight))

    def split(
        self,
        name: str,
        labels: Sequence[str],
        bounds: tuple[Any, Any],
        limits: tuple[ArrayLike, ArrayLike],
        *,
        parts: tuple[str, str] = ("pos", "neg"),
    ) -> tuple[Affine, Affine]:
        """Columns pos, neg >= 0 with pos * neg = 0: x = pos - neg gives |x|, max(x, 0), a mode.

        `bounds` of the two may be data; `limits` are the constants they never exceed.
        """
        pos = self.var(f"{name}.{parts[0]}", labels, 0.0, bounds[0], about=f"power, {parts[0]}")
        neg = self.var(f"{name}.{parts[1]}", labels, 0.0, bounds[1], about=f"power, {parts[1]}")
        constants = tuple(np.broadcast_to(np.asarray(x, float), (pos.n,)) for x in limits)
        self.structure(Split, name, (pos, neg), constants)
        return pos, neg

    def cone(self, name: str, u: Affine, v: Affine, *xs: Affine) -> None:
        """`u * v = sum(x^2)` with u, v >= 0: the branch flow equation."""
        self.structure(Cone, name, (u, v, *xs))

    def angle(
        self, name: str, theta: Affine, re: Affine, im: Affine, squares: tuple[Affine, Affine]
    ) -> None:
        """`theta = atan2(im, re)`, re >= 0, in rad: what closes the loops of a mesh.

        `squares` are those of the two numbers that make re + j im, one times the conjugate of the
        other: multiples of one column each, and for relaxations alone.
        """
        self.structure(Angle, name, (theta, re, im, *squares))

    def disc(self, name: str, radius: ArrayLike, *xs: Affine) -> None:
        """`|(x1, x2, ...)| <= radius`: inverter and line ratings."""
        bound = np.broadcast_to(np.asarray(radius, float), (xs[0].n,))
        self.structure(Disc, name, xs, (bound,))

    def switch(self, name: str, x: Affine, on: Affine, limit: ArrayLike) -> None:
        """`|x| <= limit * on` for a binary `on`: commitment, tie lines."""
        self.le(name + ".upper", x, on * limit)
        self.le(name + ".lower", -x, on * limit)

    def largest(self, name: str, y: Affine, *xs: Affine) -> None:
        """`y = max(xs)`, where a smaller y is never worse: rows y >= x, made tight afterwards."""
        for k, x in enumerate(xs):
            self.le(f"{name}.above{k}", x, y)
        self.structure(Largest, name, (y, *xs))

    def piecewise(
        self, name: str, x: Affine, xs: Floats, ys: Floats, unit: str, total: Any = 1.0
    ) -> Affine:
        """y = f(x) through the points (xs, ys) of shape (n, k), straight between them.

        `total` is 1, or a binary that switches both x and y off.
        """
        labels = x.labels or ()
        weights = [
            self.var(f"{name}.weight{k}", labels, 0.0, 1.0, unit="1") for k in range(xs.shape[1])
        ]
        zero = Affine.constant(0.0, x.n)
        self.eq(name + ".one", sum(weights, zero), total)
        self.eq(name + ".x", x, sum((w * xs[:, k] for k, w in enumerate(weights)), zero))
        y = self.var(
            name, labels, np.minimum(ys.min(1), 0.0), np.maximum(ys.max(1), 0.0), unit=unit
        )
        self.eq(name + ".y", y, sum((w * ys[:, k] for k, w in enumerate(weights)), zero))
        self.structure(Adjacent, name, tuple(weights))
        return y

    def structure(
        self,
        kind: type[Structure],
        name: str,
        args: tuple[Affine, ...],
        limits: tuple[Floats, ...] = (),
    ) -> None:
        """Adds a structure of any class; the methods above do it for those that we have.

        Raises:
            ValueError: arguments of different lengths, or with data in them.
        """
        if args[0].n == 0:
            return
        labels = next((arg.labels for arg in args if arg.labels), _numbers(args[0].n))
        self.structures.append(kind(name, labels, args, limits))

    def _row(self, name: str, expression: Affine, equality: bool) -> None:
        if expression.n:
            labels = expression.labels or _numbers(expression.n)
            self.rows.append(Row(name, labels, expression, equality))

    def _remember(self, name: str, ids: Ints, labels: Labels) -> Affine:
        self._named[name] = Affine.of_ids(ids, labels)
        return self._named[name]

    def _check_fresh(self, name: str) -> None:
        if name in self._named:
            raise ValueError(f"{name!r} is declared twice in this stage")

    @staticmethod
    def _data_only(bound: Any, block: Block) -> Affine:
        limit = bound if isinstance(bound, Affine) else Affine.constant(bound, block.n)
        if limit.has_variables or limit.n != block.n:
            raise ValueError(f"a bound of {block.name!r} must be {block.n} numbers or data")
        return limit

    @staticmethod
    def _width(blocks: list[Block]) -> int:
        return blocks[-1].start + blocks[-1].n if blocks else 0


def _numbers(n: int) -> Labels:
    return tuple(str(i + 1) for i in range(n))
