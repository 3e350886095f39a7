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

from dataclasses import dataclass, field

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.errors import SolverError
from resilience.models.backends.base import Status
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
    """

    gap: float = SCENARIO_GAP
    time_limit: float = np.inf
    workers: int = 1
    start: Floats | None = None
    discs: Discs = "outer"
    idle_trunk: Ints | None = None
    idle_branches: dict[int, Ints] = field(default_factory=dict)


def lshaped(two_stage: TwoStage, options: DecompositionOptions | None = None) -> TwoStageSolution:
    """Solves a two-stage program, integers and modes relaxed.

    Raises:
        InfeasibleError: the trunk, or a scenario behind it, has no point; it is named.
        SolverError: the solver failed.
        CertificateError: its bound lies above a plan.
    """
    options = options or DecompositionOptions()
    deadline = Deadline(options.time_limit)
    master = Master(two_stage, idle=options.idle_trunk, discs=options.discs)
    recourse = Recourse(
        two_stage, idle=options.idle_branches, discs=options.discs, workers=options.workers
    )
    trial = None if options.start is None else master.trunk_through(options.start)
    has_start = trial is not None
    trial = trial or master.solve()
    best: tuple[float, Trial, SecondStage, Floats] | None = None
    bound, start_cost, scale = -np.inf, None, two_stage.cost_scale
    for k in range(MAX_ROUNDS):
        with phase(
            "scenarios", f"round {k + 1}" + ("" if best is None else _so_far(best[0], bound))
        ):
            second = recourse.solve(trial.states)
        cost = trial.spent.copy()
        cost[:-1] += second.cost
        value = two_stage.risk.value(cost, master.probability)
        if k == 0 and has_start:
            start_cost = cost
        if best is None or value < best[0]:
            best = value, trial, second, cost
        reached = gap(best[0], bound, scale)
        if reached <= options.gap or (deadline.remaining_s <= 0 and np.isfinite(bound)):
            break
        master.add(second)
        with phase("first stage"):
            trial = master.solve()
        bound = max(bound, trial.bound)
        if gap(best[0], bound, scale) <= options.gap:
            break
    else:
        raise SolverError(f"the L-shaped method did not close its gap in {MAX_ROUNDS} rounds")
    value, trial, second, cost = best
    return TwoStageSolution(
        status_of(gap(value, bound, scale), options.gap),
        trial.z,
        second.points,
        cost,
        master.probability,
        value,
        bound,
        start_cost,
        k + 1,
    )


def _so_far(value: float, bound: float) -> str:
    return f", {value:.4f} $ against {bound:.4f}"
