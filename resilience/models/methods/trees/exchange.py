r"""Branch exchange: close an open line, open another in the loop that it makes; or two at once.

While the buses draw the currents of the last sweep, what any exchange saves is known without a
power flow (Civanlar et al. 1988). Closing a tie lets a current $t$ go round its loop
$c \in \{0, \pm 1\}$; a line $k$ of it is opened once
$J_k + t c_k = 0$. With $D = c^\top r J$ and $R = |c|^\top r$

$$ \Delta = 2 \operatorname{Re} \bar t D + |t|^2 R $$

and for two ties, whose loops share lines, likewise with the two currents that empty both lines:

$$ \Delta = 2 \operatorname{Re} (\bar t_1 D_1 + \bar t_2 D_2) + |t_1|^2 R_{11} + |t_2|^2 R_{22}
+ 2 \operatorname{Re} (\bar t_1 t_2) R_{12}, \qquad R = C \operatorname{diag}(r) \, C^\top $$

Loops that share nothing add nothing to single exchanges. The few that promise most are swept, and
the best is taken, until none of either kind is better. Losses of all slots of a task count, each at
its weight; so do voltages and flows out of their limits, far more.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from resilience.arrays import Bools, Complexes, Floats, Ints
from resilience.models.methods.trees.forest import Forest, TreeLines

SWEPT_SINGLES = 8
SWEPT_DOUBLES = 24
GAIN = 1e-7  # of the score, below which an exchange is rounding
LIMIT_WEIGHT = 100.0  # of a per unit out of a limit, over all power that is drawn


@dataclass(frozen=True)
class TreeTask:
    """What trees are to do: slots with the same lines and the same roots.

    Attributes:
        wires: the lines.
        up: (lines,) lines that can be closed.
        roots: buses that trees hang on.
        alive: (buses,) whatever a forest has to reach.
        drawn: (buses, slots) taken at the buses, MVA.
        v_root: (buses, slots) voltage of roots, pu.
        root_max: (buses, slots) most that a root can feed in, MW.
        weight: (slots,) of a MW lost.
    """

    wires: TreeLines
    up: Bools
    roots: Ints
    alive: Bools
    drawn: Complexes
    v_root: Floats
    root_max: Floats
    weight: Floats

    def slots(self, chosen: Ints) -> TreeTask:
        """The same for some of its slots."""
        names = ("drawn", "v_root", "root_max")
        columns = {name: getattr(self, name)[:, chosen] for name in names}
        return replace(self, **columns, weight=self.weight[chosen])


@dataclass(frozen=True)
class RatedForest:
    """A forest with its power flow and what it is worth.

    Attributes:
        forest: the forest.
        current: (lines, slots) pu.
        scores: (slots,) weighted losses and limits; inf without an operating point.
    """

    forest: Forest
    current: Complexes
    scores: Floats

    @property
    def score(self) -> float:
        """Of all slots."""
        return float(self.scores.sum())


def rated(task: TreeTask, closed: Bools) -> RatedForest:
    """Sweeps a forest.

    Args:
        task: what it is to do.
        closed: (lines,).
    """
    wires, slots = task.wires, task.drawn.shape[1]
    forest = Forest.from_closed(wires, closed, task.roots)
    flow = forest.swept(task.drawn, task.v_root)
    if flow is None or (task.alive & (forest.root < 0)).any():
        nothing = np.zeros((len(closed), slots), complex)
        return RatedForest(forest, nothing, np.full(slots, np.inf))
    voltage, current = flow
    lost = (forest.z.real[:, None] * np.abs(current) ** 2).sum(0)
    v = np.abs(voltage) * forest.gain[:, None]
    hangs = (forest.root >= 0) & (forest.root != np.arange(len(v)))
    low, high = wires.v_min[:, None] - v, v - wires.v_max[:, None]
    out = np.maximum(np.maximum(low, high), 0.0)[hangs].sum(0)
    sent = np.abs(voltage[wires.ends[:, 0]] * current)
    out += np.maximum(sent / wires.rating[:, None] - 1.0, 0.0).sum(0)
    out += _beyond_roots(task, forest, voltage, current)
    power = np.abs(task.drawn).sum(0)
    return RatedForest(forest, current, task.weight * (lost + LIMIT_WEIGHT * power * out))


def _beyond_roots(task: TreeTask, forest: Forest, voltage: Complexes, current: Complexes) -> Floats:
    """(slots,) share of what roots can feed in that is asked of them beyond."""
    ends, beyond = task.wires.ends, np.zeros(task.drawn.shape[1])
    for root in task.roots.tolist():
        out = (ends[:, 0] == root) & forest.closed
        into = (ends[:, 1] == root) & forest.closed
        leaving = current[out].sum(0) - current[into].sum(0)
        power = (voltage[root] * np.conj(leaving)).real + task.drawn[root].real
        room = np.maximum(task.root_max[root], 1e-6)
        beyond += np.maximum(power - room, 0.0) / np.maximum(room, np.abs(power))
    return beyond


def improved(task: TreeTask, closed: Bools, is_late: Callable[[], bool]) -> RatedForest:
    """A forest that no exchange of one line, or of two, is seen to improve; or the best by then.

    Args:
        task: what it is to do.
        closed: (lines,) a forest to begin with.
        is_late: whether time is up.
    """
    best = rated(task, closed)
    if not np.isfinite(best.score):
        return best
    while not is_late():
        exchanges = Exchanges(task, best)
        for promising in (exchanges.singles, exchanges.doubles):
            trials = [rated(task, trial) for trial in promising()]
            leader = min(trials, key=lambda trial: trial.score, default=best)
            if leader.score < best.score * (1.0 - GAIN):
                best = leader
                break
        else:
            break
    return best


class Exchanges:
    """Every exchange of one or two lines in a forest, and what it promises."""

    def __init__(self, task: TreeTask, forest: RatedForest) -> None:
        wires, closed, paths = task.wires, forest.forest.closed, forest.forest.paths
        ends, reached = wires.ends, forest.forest.root >= 0
        joins = reached[ends].all(1) & task.up & wires.switchable & ~closed
        self.ties = np.flatnonzero(joins)
        self.closed, self.lines = closed, np.flatnonzero(closed & wires.switchable)
        loops = paths[ends[self.ties, 0]] - paths[ends[self.ties, 1]]
        r = forest.forest.z.real
        current = forest.current * np.sqrt(task.weight)
        self.shared = (loops * r) @ loops.T + np.diag(r[self.ties])
        driven = (loops * r) @ current
        self.loops = loops[:, self.lines]
        branch = current[self.lines]
        self.worth = (np.conj(branch) @ driven.T).real  # (lines, ties)
        self.product = (np.conj(branch) @ branch.T).real  # (lines, lines)

    def singles(self) -> list[Bools]:
        """The single exchanges that promise most, as (lines,) closed."""
        square = np.diag(self.product)
        change = -2.0 * self.loops * self.worth.T + np.diag(self.shared)[:, None] * square
        change = np.where(self.loops != 0.0, change, np.inf)
        best = _lowest(change.ravel(), SWEPT_SINGLES)
        pairs = [np.unravel_index(k, change.shape) for k in best]
        return [self._after([(int(tie), int(line))]) for tie, line in pairs]

    def doubles(self) -> list[Bools]:
        """Likewise of two exchanges at once whose loops share lines."""
        pool: list[tuple[float, int, int, int, int]] = []
        for e, f in combinations(range(len(self.ties)), 2):
            if self.shared[e, f] == 0.0:
                continue
            k, m = np.flatnonzero(self.loops[e]), np.flatnonzero(self.loops[f])
            change = self._change(e, f, k, m)
            for place in _lowest(change.ravel(), SWEPT_DOUBLES):
                i, j = np.unravel_index(place, change.shape)
                pool.append((float(change[i, j]), e, f, int(k[i]), int(m[j])))
        pool.sort()
        chosen: dict[bytes, Bools] = {}
        for _, e, f, k_line, m_line in pool:
            closed = self._after([(e, k_line), (f, m_line)])
            chosen.setdefault(closed.tobytes(), closed)
            if len(chosen) == SWEPT_DOUBLES:
                break
        return list(chosen.values())

    def _change(self, e: int, f: int, k: Ints, m: Ints) -> Floats:
        """(k, m) what closing ties e and f for lines k and m changes; inf if no forest."""
        a, b = self.loops[e, k][:, None], self.loops[f, k][:, None]
        c, d = self.loops[e, m][None, :], self.loops[f, m][None, :]
        determinant = a * d - b * c
        kk, mm = np.diag(self.product)[k][:, None], np.diag(self.product)[m][None, :]
        km = self.product[np.ix_(k, m)]
        linear = d * self.worth[k, e][:, None] - b * self.worth[m, e][None, :]
        linear = linear - c * self.worth[k, f][:, None] + a * self.worth[m, f][None, :]
        first = d * d * kk - 2.0 * b * d * km + b * b * mm
        second = c * c * kk - 2.0 * a * c * km + a * a * mm
        mixed = -c * d * kk + (a * d + b * c) * km - a * b * mm
        r = self.shared
        square = r[e, e] * first + r[f, f] * second + 2.0 * r[e, f] * mixed
        with np.errstate(divide="ignore", invalid="ignore"):
            change = -2.0 * linear / determinant + square / determinant**2
        return np.where(determinant != 0.0, change, np.inf)

    def _after(self, exchanges: list[tuple[int, int]]) -> Bools:
        closed = self.closed.copy()
        for tie, line in exchanges:
            closed[self.ties[tie]], closed[self.lines[line]] = True, False
        return closed


def _lowest(values: Floats, n: int) -> list[int]:
    """Places of the n lowest finite values, the lowest first."""
    places = np.argpartition(values, n)[:n] if len(values) > n else np.arange(len(values))
    ordered = places[np.argsort(values[places], kind="stable")]
    return [int(k) for k in ordered if np.isfinite(values[k])]
