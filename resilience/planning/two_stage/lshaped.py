r"""Two-stage programs cut at the trunk: the multi-cut L-shaped method (Van Slyke and Wets 1969).

The master decides the trunk and holds, for every scenario, a variable $\theta_s$ below which its
recourse cost is not believed to lie. At the trunk's states every scenario is solved; the dual of
those states gives a cut that holds everywhere,

$$ \theta_s \ge Q_s(\hat x) + \beta_s^\top (x - \hat x), \qquad \beta_s \in \partial Q_s(\hat x), $$

and the master is solved again. Its optimum is a proven lower bound, the best trunk met so far with
its true recourse cost an upper one; the two meet. Cuts are evaluated from multipliers
(`models.program.dual_bound`), so the bound does not lean on solver tolerances. Recourse is
taken to be feasible everywhere, as it is where loads can be shed; where it is not, the scenario is
named.

Where something is built in units (`Stage.design`), cuts are first gathered with parts of units, of
which the master is a linear program, then with whole ones, of which it is a tree search. Recourse
is convex in what is built, so the cuts of both hold for both. What every scenario costs at the
least, whatever is built, holds its theta up from the start, and a scenario costs no cut where the
master knows its cost already.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.errors import SolverError
from resilience.models.backends.base import OutOfTimeError, Status
from resilience.models.methods.answer import Deadline
from resilience.models.program.gate import gap, status_of
from resilience.models.structures import Discs
from resilience.planning.two_stage.master import Master, Trial
from resilience.planning.two_stage.recourse import Recourse, SecondStage
from resilience.planning.two_stage.two_stage import TwoStage
from resilience.progress import phase
from resilience.tolerances import SCENARIO_GAP

MAX_ROUNDS = 200
MOST_OF_PARTS = 40  # rounds with parts of units, at most
PARTS_GAP = 1e-3  # relative, at which whole units take their place


@dataclass(frozen=True)
class TwoStageSolution:
    """A two-stage program, solved.

    Attributes:
        status: optimal (within the gap wanted) or feasible.
        trunk: values of the trunk's columns.
        points: values of every branch in the columns of its program; steps before it are zero.
        cost: (branches + 1,) $ of every scenario, the one that stays on the trunk last.
        probability: (branches + 1,) of every scenario.
        objective: of the risk over these costs, $.
        bound: proven lower bound, $.
        start_cost: (branches + 1,) $ with the trunk that the search began from, if it had one.
        iterations: how often the second stage was solved.
    """

    status: Status
    trunk: Floats
    points: list[Floats]
    cost: Floats
    probability: Floats
    objective: float
    bound: float
    start_cost: Floats | None = None
    iterations: int = 1


@dataclass
class DecompositionOptions:
    """How to search.

    Attributes:
        gap: relative gap at which to stop.
        time_limit: seconds; the best trunk so far is then the answer.
        workers: threads that solve scenarios.
        start: (trunk nodes, states) of a trunk to begin from.
        discs: polygons within the discs or around them.
        idle_trunk: columns of the trunk to hold at zero (modes to keep to).
        idle_branches: by the index of a branch, columns of its program to hold at zero.
        designs: (trunks, columns of the trunk) whole designs to try before all others.
        clock: seconds that have passed since some moment; for tests.
        total_time_limit: seconds of which `time_limit` is what is left, for messages.
    """

    gap: float = SCENARIO_GAP
    time_limit: float = np.inf
    workers: int = 1
    start: Floats | None = None
    discs: Discs = "outer"
    idle_trunk: Ints | None = None
    idle_branches: dict[int, Ints] = field(default_factory=dict)
    designs: Floats | None = None
    clock: Callable[[], float] = time.perf_counter
    total_time_limit: float | None = None


@dataclass
class Machinery:
    """Master and recourse of a program, which may be solved again with other data of the trunk.

    Attributes:
        master: the trunk, with all cuts so far.
        recourse: the branches, with all their bases.
    """

    master: Master
    recourse: Recourse

    @classmethod
    def without_cuts(cls, two_stage: TwoStage, options: DecompositionOptions) -> Machinery:
        """New ones, without cuts."""
        return cls(
            Master(two_stage, idle=options.idle_trunk, discs=options.discs),
            Recourse(
                two_stage,
                idle=options.idle_branches,
                discs=options.discs,
                workers=options.workers,
            ),
        )


@dataclass
class TrunkSearch:
    """What is known so far.

    Attributes:
        two_stage: what to solve.
        options: how, and when to stop.
        deadline: when time is up.
        probability: (branches + 1,) of every scenario.
        bound: proven lower bound, $.
        value: of the risk over the costs of the best trunk, $.
        best: that trunk, its second stage, and (branches + 1,) what every scenario costs with it.
        start_cost: the same of the trunk that the search began from, if it had one.
        iterations: how often the second stage was solved.
    """

    two_stage: TwoStage
    options: DecompositionOptions
    deadline: Deadline
    probability: Floats
    bound: float = -np.inf
    value: float = np.inf
    best: tuple[Trial, SecondStage, Floats] | None = None
    start_cost: Floats | None = None
    iterations: int = 0

    @property
    def gap(self) -> float:
        """Relative gap of the best trunk."""
        return gap(self.value, self.bound, self.two_stage.cost_scale)

    @property
    def done(self) -> bool:
        """Whether the gap wanted is reached, or time is up and there is something to show."""
        late = self.deadline.late and np.isfinite(self.bound)
        return self.best is not None and (self.gap <= self.options.gap or late)

    def seconds(self) -> float:
        """Seconds for one more solve: to the hard stop until there are a plan and a bound."""
        shown = self.best is not None and np.isfinite(self.bound)
        return self.deadline.remaining_s if shown else self.deadline.final_s

    def offer(self, trial: Trial, second: SecondStage) -> Floats:
        """Keeps a trunk that is better than the best; (branches + 1,) what it costs."""
        cost = trial.spent.copy()
        cost[:-1] += second.cost
        value = self.two_stage.risk.value(cost, self.probability)
        if self.best is None or value < self.value:
            self.value, self.best = value, (trial, second, cost)
        return cost


def out_of_time(options: DecompositionOptions) -> OutOfTimeError:
    """The error where a time limit left nothing to show."""
    seconds = options.time_limit if options.total_time_limit is None else options.total_time_limit
    return OutOfTimeError(
        f"no plan for all scenarios was found within {seconds:g} s",
        hint="raise --time-limit, or plan for fewer scenarios",
    )


def lshaped(
    two_stage: TwoStage,
    options: DecompositionOptions | None = None,
    machinery: Machinery | None = None,
) -> TwoStageSolution:
    """Solves a two-stage program, integers and modes relaxed but those of what is built.

    Args:
        two_stage: the program.
        options: how to search.
        machinery: of an earlier search of the same program, whose cuts are kept.

    Raises:
        InfeasibleError: the trunk, or a scenario behind it, has no point; it is named.
        OutOfTimeError: no trunk was tried in time.
        SolverError: the solver failed.
        CertificateError: its bound lies above a plan.
    """
    options = options or DecompositionOptions()
    deadline = Deadline(options.time_limit, options.clock)
    probability = np.append([b.probability for b in two_stage.branches], two_stage.staying)
    search = TrunkSearch(two_stage, options, deadline, probability)
    try:
        _search_trunks(search, machinery or Machinery.without_cuts(two_stage, options))
    except OutOfTimeError:
        if search.best is None:
            raise out_of_time(options) from None
    assert search.best is not None
    trial, second, cost = search.best
    return TwoStageSolution(
        status_of(search.gap, options.gap),
        trial.z,
        second.points,
        cost,
        probability,
        search.value,
        search.bound,
        search.start_cost,
        search.iterations,
    )


def _search_trunks(search: TrunkSearch, machinery: Machinery) -> None:
    """Trunk after trunk, with the cuts of all before."""
    options, master, recourse = search.options, machinery.master, machinery.recourse
    master.seconds = recourse.seconds = search.seconds
    if len(master.units):
        _search_designs(search, master, recourse)
        return
    trial = None if options.start is None else master.trunk_through(options.start)
    has_start = trial is not None
    trial = trial or master.solve()
    for k in range(MAX_ROUNDS):
        with phase("scenarios", f"round {k + 1}{_so_far(search)}"):
            second = recourse.solve(trial.states)
        cost = search.offer(trial, second)
        search.iterations += 1
        if k == 0 and has_start:
            search.start_cost = cost
        if search.done:
            return
        master.add(second)
        with phase("first stage"):
            trial = master.solve()
        search.bound = max(search.bound, trial.bound)
        if search.done:
            return
    raise SolverError(f"the L-shaped method did not close its gap in {MAX_ROUNDS} rounds")


def _search_designs(search: TrunkSearch, master: Master, recourse: Recourse) -> None:
    """As `_search_trunks`, where something is built in units: first parts of them, then whole."""
    options = search.options
    if not master.has_floors:
        with phase("scenarios", "all of it built"):
            master.hold_up(recourse.floors(_starts(search.two_stage)))
    for z in () if options.designs is None else options.designs:
        _try(search, master, recourse, master.trial_of(z))
    parts, trial = True, master.solve()
    for k in range(MAX_ROUNDS):
        search.bound = max(search.bound, trial.bound)
        if search.done:
            return
        value = _try(search, master, recourse, trial, k + 1)
        if search.done:
            return
        parts = parts and k < MOST_OF_PARTS and value - trial.bound > PARTS_GAP * abs(value)
        with phase("first stage", "parts of units" if parts else "whole units"):
            start = None if search.best is None else search.best[0].z
            trial = master.solve() if parts else master.solve_whole(start, options.gap / 2.0)
    raise SolverError(f"the L-shaped method did not close its gap in {MAX_ROUNDS} rounds")


def _try(
    search: TrunkSearch, master: Master, recourse: Recourse, trial: Trial, number: int = 0
) -> float:
    """Solves the second stage at a trial and adds the cuts that are news; $ of the risk there."""
    with phase("scenarios", f"round {number}{_so_far(search)}"):
        second = recourse.solve(trial.states)
    search.iterations += 1
    news = master.violated(trial, second)
    master.add(second, news)
    if trial.is_whole:
        master.add_falling(trial, second, news)
    cost = trial.spent.copy()
    cost[:-1] += second.cost
    if trial.is_whole:
        search.offer(trial, second)
    return search.two_stage.risk.value(cost, search.probability)


def _starts(two_stage: TwoStage) -> Floats:
    """(branches, states) at the start, nothing built."""
    x0 = np.zeros(two_stage.first.n_states)
    for name, columns in two_stage.first.initial.items():
        x0[columns] = two_stage.x0.get(name, 0.0)
    return np.tile(x0, (len(two_stage.branches), 1))


def _so_far(search: TrunkSearch) -> str:
    return "" if search.best is None else f", {search.value:.4f} $ against {search.bound:.4f}"
