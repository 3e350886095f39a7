r"""Lines that can be strengthened before the storm: the status each would have, and the choice.

Of an option $k$ of line $l$ it is known when the line would be down: failures are drawn once, and
strength moves those of its own line alone. What is chosen, $h_k$, is a design: the same in every
slot of every storm, one option a line at most. As the line is without any, $\hat z_0 = 1$ where it
is up, and $\hat z_k$ with the option. The status of the line is

$$ z = \hat z_0 \Bigl(1 - \sum_k h_k\Bigr) + \sum_k \hat z_k h_k $$

where $\hat z$ are data. Data stand in no matrix, so the status is a column that is held from both
sides,

$$ z \le \hat z_0 + \sum_k h_k, \quad z \le \hat z_k + 1 - h_k, \qquad
z \ge \hat z_0 - \sum_k h_k, \quad z \ge \hat z_k - 1 + h_k $$

which is the same for every choice of whole options. A side that holds whatever is chosen has room
of its own, so that no multiplier comes to rest on it.

With a part of an option a line carries a part of all it ever could, which is more than loads need.
So loads $C$ of a part of the network have rows of their own (`cover`): what lies inside feeds them,
$G$, or the lines $L$ that lead there,

$$ \sum_{i \in C} (d_i - s_i) \le \sum_{l \in L} z_l \sum_{i \in C} \overline{d}_i
   + \sum_{g \in G} p_g^+ $$

They cut nothing off with whole options, and are what proves that a choice is the best: without them
the bound of 50 storms on `ieee33_rammasun` stands at a half of the optimum after as many rounds.

| symbol | name | unit |
|---|---|---|
| $h_k$ | `line.strength`, per option | 1 |
| $z$ | `line.stands` | 1 |
| $\hat z$ | `line.bare`, `line.strong` (data): the most of $z$, 2 where that says nothing | 1 |
| | `line.bare_least`, `line.strong_least` (data): the least, -1 where that says nothing | 1 |
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Bools, Floats, Ints
from resilience.models.algebra import Affine, Labels, stack
from resilience.models.components.fleet import DeviceFleet, in_roles
from resilience.models.components.line import Lines
from resilience.models.language.stage import Stage
from resilience.models.network.graph import sides
from resilience.models.network.situation import Situation


@dataclass(frozen=True)
class Strengthened:
    """The lines that can be strengthened, and how.

    Attributes:
        lines: their names.
        options: a name per option, as `12-13 x1.5`.
        line_of: (options,) index in `lines` of the line of each.
        cost: (options,) $ in the objective, paid once.
        bare: (lines, nodes) whether a line is up as it is; only where data are made.
        strong: (options, nodes) whether its line is up with the option.
    """

    lines: Labels
    options: Labels
    line_of: Ints
    cost: Floats
    bare: Bools = field(default_factory=lambda: np.ones((0, 0), bool), repr=False)
    strong: Bools = field(default_factory=lambda: np.ones((0, 0), bool), repr=False)

    def emit(self, stage: Stage) -> None:
        """Declares what is chosen and the status that follows."""
        h = stage.design(
            "line.strength", self.options, 0.0, 1.0, self.cost,
            unit="1", about="whether an option is chosen", integer=True,
        )  # fmt: skip
        low, high = (
            stage.data(f"line.stands_{end}", self.lines, unit="1", about=f"{end} status")
            for end in ("least", "most")
        )
        z = stage.var("line.stands", self.lines, low, high, unit="1", about="carries power")
        any_option = h.mapped(self._by_line, self.lines)
        of_option = z[self.line_of]
        bare, strong = (
            (
                stage.data(f"line.{name}", labels, unit="1", about=f"most status, {words}"),
                stage.data(f"line.{name}_least", labels, unit="1", about=f"least status, {words}"),
            )
            for name, labels, words in (
                ("bare", self.lines, "no option chosen"),
                ("strong", self.options, "the option chosen"),
            )
        )
        stage.le("line.stands.bare", z - any_option, bare[0])
        stage.le("line.stands.strong", of_option + h, strong[0] + 1.0)
        if not stage.reactive:
            return  # a line that carries less than it may is as good as one that is down
        stage.le("line.stands.bare_least", bare[1] - any_option, z)
        stage.le("line.stands.strong_least", strong[1] + h - 1.0, of_option)

    def cover(
        self, stage: Stage, lines: Lines, fleets: Sequence[DeviceFleet], demand_mw: Floats
    ) -> None:
        """Rows that follow from all others with whole options, and say more with parts of them.

        Args:
            stage: with all devices and statuses.
            lines: of the network.
            fleets: all devices.
            demand_mw: (loads,) the most that each asks for in the stage, fleet by fleet.
        """
        loads = in_roles(fleets, "load")
        if not loads or any(len(fleet.cold) for fleet in loads):
            return
        tables = [table for fleet in loads for table in fleet.tables]
        price = np.array([getattr(table, "shed_price_per_mwh", 0.0) for table in tables])
        bus = np.concatenate([fleet.bus for fleet in loads])
        served = stack([stage[fleet.demand] - stage[fleet.shed] for fleet in loads])
        fed, fed_bus = _sources(stage, fleets)
        for kind, inside, cut in self._parts(lines, bus):
            for rank, threshold in enumerate(np.unique(price)):
                if kind != "bus" and rank == 0:
                    continue  # of all loads behind a line, its own limit says nearly as much
                dear = inside[:, bus] & (price >= threshold)
                names = tuple(f"{kind} {k + 1}" for k in range(len(inside)))
                through = cut * (dear @ demand_mw)[:, None]
                stage.le(
                    f"line.cover{rank}.{kind}",
                    served.mapped(sp.csr_array(dear.astype(float)), names)
                    - stage["line.stands"].mapped(sp.csr_array(through), names),
                    fed.mapped(sp.csr_array(inside[:, fed_bus].astype(float)), names),
                )

    def _parts(self, lines: Lines, bus: Ints) -> list[tuple[str, Bools, Bools]]:
        """Parts of the network that only lines of choice join to the rest.

        Per kind of part its name, (parts, buses) what lies inside, and (parts, lines of choice)
        which of them lead there: single buses with loads, and both sides of every line of a tree.
        """
        rows = np.array([lines.names.index(name) for name in self.lines], np.intp)
        n = int(max(bus.max(), lines.from_bus.max(), lines.to_bus.max())) + 1
        hub = np.unique(bus)[:, None]
        ends = (lines.from_bus == hub) | (lines.to_bus == hub)
        alone = ends.sum(axis=1) == ends[:, rows].sum(axis=1)
        parts = [("bus", (np.arange(n) == hub)[alone], ends[alone][:, rows])]
        behind = sides(n, lines.from_bus, lines.to_bus)
        if behind is not None:
            line = np.eye(len(rows), dtype=bool)
            parts += [("from", ~behind[rows], line), ("to", behind[rows], line)]
        return parts

    def choose(self, stage: Stage) -> None:
        """One option a line at most, in the stage in which it is chosen."""
        several = np.flatnonzero(np.bincount(self.line_of, minlength=len(self.lines)) > 1)
        chosen: Affine = stage["line.strength"].mapped(self._by_line, self.lines)
        stage.le("line.strength.one", chosen[several], 1.0)

    @property
    def _by_line(self) -> sp.csr_array:
        """(lines, options) 1 where an option is of a line."""
        n = len(self.options)
        entries = (np.ones(n), (self.line_of, np.arange(n)))
        return sp.csr_array(entries, shape=(len(self.lines), n))

    def data(self, situation: Situation) -> dict[str, Floats]:
        """Statuses, as sides that hold where they say something.

        Raises:
            ValueError: statuses of another number of nodes.
        """
        shapes = {self.bare.shape[1], self.strong.shape[1]}
        if shapes != {situation.n}:
            raise ValueError(f"statuses of {shapes} nodes in a situation of {situation.n}")
        highest, lowest = self.bare.copy(), self.bare.copy()
        for option, line in enumerate(self.line_of):
            highest[line] |= self.strong[option]
            lowest[line] &= self.strong[option]
        open_bare = highest & ~lowest
        open_strong = open_bare[self.line_of]
        return {
            "line.stands_least": lowest.astype(float),
            "line.stands_most": highest.astype(float),
            "line.bare": np.where(open_bare & ~self.bare, 0.0, 2.0),
            "line.bare_least": np.where(open_bare & self.bare, 1.0, -1.0),
            "line.strong": np.where(open_strong & ~self.strong, 0.0, 2.0),
            "line.strong_least": np.where(open_strong & self.strong, 1.0, -1.0),
        }

    def start(self) -> dict[str, Floats]:
        """None: what is chosen has no value at the start."""
        return {}


def _sources(stage: Stage, fleets: Sequence[DeviceFleet]) -> tuple[Affine, Ints]:
    """All that devices but loads may feed in, MW, each from nothing up, and its bus."""
    pairs = [
        (stage[name], fleet.bus)
        for fleet in fleets
        if fleet.role != "load"
        for name, sign in fleet.flows.items()
        if sign > 0.0
    ]
    none = np.empty(0, np.intp)
    powers = [Affine.constant(0.0, 0), *(power for power, _ in pairs)]
    return stack(powers), np.concatenate([none, *(bus for _, bus in pairs)])
