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
        clock: seconds that have passed since some moment; for tests.
    """

    gap: float = SCENARIO_GAP
    time_limit: float = np.inf
    workers: int = 1
    start: Floats | None = None
    discs: Discs = "outer"
    idle_trunk: Ints | None = None
    idle_branches: dict[int, Ints] = field(default_factory=dict)
    clock: Callable[[], float] = time.perf_counter


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
        self.iterations += 1
        return cost


def out_of_time(options: DecompositionOptions) -> OutOfTimeError:
    """The error where a time limit left nothing to show."""
    return OutOfTimeError(
        f"no plan for all scenarios was found within {options.time_limit:g} s",
        hint="raise --time-limit, or plan for fewer scenarios",
    )


def lshaped(two_stage: TwoStage, options: DecompositionOptions | None = None) -> TwoStageSolution:
    """Solves a two-stage program, integers and modes relaxed.

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
        _search_trunks(search)
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


def _search_trunks(search: TrunkSearch) -> None:
    """Trunk after trunk, with the cuts of all before."""
    two_stage, options = search.two_stage, search.options
    master = Master(two_stage, idle=options.idle_trunk, discs=options.discs, seconds=search.seconds)
    recourse = Recourse(
        two_stage,
        idle=options.idle_branches,
        discs=options.discs,
        workers=options.workers,
        seconds=search.seconds,
    )
    trial = None if options.start is None else master.trunk_through(options.start)
    has_start = trial is not None
    trial = trial or master.solve()
    for k in range(MAX_ROUNDS):
        with phase("scenarios", f"round {k + 1}{_so_far(search)}"):
            second = recourse.solve(trial.states)
        cost = search.offer(trial, second)
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


def _so_far(search: TrunkSearch) -> str:
    return "" if search.best is None else f", {search.value:.4f} $ against {search.bound:.4f}"
