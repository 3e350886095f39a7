"""Training: iterations, validation against the bound, checkpoints, and when to stop.

Iterations are counted, never timed, so that a run that is interrupted and one that is not are the
same bit by bit. A budget in seconds becomes a number of iterations once, before the first.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import torch

from resilience.arrays import Floats
from resilience.case import Case
from resilience.errors import SolverError, UsageError
from resilience.evaluation.clairvoyant import clairvoyant
from resilience.evaluation.compare import parse_error
from resilience.rl.algorithms.registry import Algorithm, algorithm
from resilience.rl.ground.env import BatchEnv
from resilience.rl.ground.episodes import EpisodeSampler
from resilience.rl.learning.learner import Learner, Progress
from resilience.rl.networks.nets import network
from resilience.rl.policy import Policy
from resilience.simulation.simulate import simulate
from resilience.simulation.world import World

TIMED_ITERATIONS = 3  # on a throwaway learner, to turn a budget into iterations
EXPLODED = 1e4  # times the first loss
DEVICES = ("cpu", "cuda")


@dataclass(frozen=True)
class TrainingOptions:
    """What a training is started with.

    Attributes:
        method: name of the algorithm.
        seed: of weights, episodes and noise.
        iterations: how many; None: as many as fit into the budget.
        budget_s: CPU-seconds of one thread, counted without validation.
        band: how outputs become MW; None: the algorithm's own.
        baseline: whose cost rewards are relative to.
        days: days of an episode.
        forecast_error: as in `compare`.
        known_centre: as in `compare`.
        validations: how often the policy is judged on the validation days.
        patience: validations without a better policy after which training ends; 0: never.
        device: cpu or cuda.
        settings: of the algorithm, where they are not its own.
    """

    method: str = "apg"
    seed: int = 0
    iterations: int | None = None
    budget_s: float = 120.0
    band: str | None = None
    baseline: str = "rule"
    days: int = 1
    forecast_error: str = "none"
    known_centre: bool = True
    validations: int = 10
    patience: int = 0
    device: str = "cpu"
    settings: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class LogRow:
    """A line of the log.

    Attributes:
        iteration: iterations done.
        cpu_s: CPU-seconds of training so far.
        loss: of the last iteration.
        cost_per_day: on the validation days, $.
        gap: over the bound on the validation days, relative.
        more: what else the algorithm reports.
    """

    iteration: int
    cpu_s: float
    loss: float
    cost_per_day: float
    gap: float
    more: dict[str, float]


class Training:
    """A training at work.

    Args:
        case: the case.
        options: how.
    """

    def __init__(self, case: Case, options: TrainingOptions) -> None:
        check_device(options.device)
        torch.set_num_threads(1)
        self.case, self.options = case, options
        self.algorithm: Algorithm = algorithm(options.method)
        self.settings = self.algorithm.settings_of(options.settings)
        self.sampler = EpisodeSampler(
            case,
            days=options.days,
            seed=options.seed,
            forecast_error=parse_error(options.forecast_error),
            known_centre=options.known_centre,
        )
        band, observer_name = self.algorithm.ground(self.settings)
        self.env = BatchEnv(
            self.sampler,
            options.band or band,
            options.baseline,
            options.device,
            observer_name=observer_name,
        )
        self.learner: Learner = self.algorithm.make(self.env, self.settings, options.seed)
        self.iteration, self.cpu_s = 0, 0.0
        schedule_length = getattr(self.learner, "iterations", None)
        self.iterations = (
            options.iterations or schedule_length or self._iterations_in(options.budget_s)
        )
        self.best_cost = math.inf
        self.worse = 0
        self.first_loss: float | None = None

    def run(self, on_row: Callable[[LogRow, bool], None], on_iteration: Callable[[], None]) -> str:
        """Trains to the end; returns why it ended, in words.

        Args:
            on_row: called with every line of the log, and whether its policy is the best so far.
            on_iteration: called after every iteration, when its line is in the log if it has one.

        Raises:
            SolverError: the loss or a weight is no number, or the loss has exploded.
        """
        due = self._validations()
        while self.iteration < self.iterations and not self.is_stuck:
            began = time.process_time()
            log = self.learner.iterate(Progress(self.iteration, self.iterations))
            self.cpu_s += time.process_time() - began
            self._check(log["loss"])
            self.iteration += 1
            if self.iteration in due:
                self.state()
                row = self._row(log)
                is_best = row.cost_per_day < self.best_cost
                self.best_cost = min(row.cost_per_day, self.best_cost)
                self.worse = 0 if is_best else self.worse + 1
                on_row(row, is_best)
            on_iteration()
        if self.is_stuck:
            return f"no better policy in {self.worse} validations"
        return f"all {self.iterations} iterations done"

    @property
    def is_stuck(self) -> bool:
        """Whether so many validations have brought nothing better that it is over."""
        return 0 < self.options.patience <= self.worse

    def state(self) -> dict[str, torch.Tensor]:
        """The learner's state.

        Raises:
            SolverError: a number in it is none.
        """
        state = self.learner.state()
        for name, value in state.items():
            if value.is_floating_point() and bool(torch.isnan(value).any()):
                raise SolverError(
                    f"training of {self.options.method} stopped after iteration "
                    f"{self.iteration}: {name} holds NaN",
                    hint="lower the learning rate",
                )
        return state

    def _validations(self) -> set[int]:
        """Numbers of iterations after which the policy is judged, the last among them."""
        marks = np.linspace(0, self.iterations, self.options.validations + 1)[1:]
        return {max(round(mark), 1) for mark in marks}

    def _check(self, loss: float) -> None:
        """Stops where numbers are none.

        Raises:
            SolverError: the loss is NaN, infinite, or has exploded.
        """
        if self.first_loss is None and math.isfinite(loss):
            self.first_loss = max(abs(loss), 1.0)
        if not math.isfinite(loss) or abs(loss) > EXPLODED * (self.first_loss or 1.0):
            raise SolverError(
                f"training of {self.options.method} stopped in iteration {self.iteration + 1}: its "
                f"loss is {loss:g}, after {self.first_loss or math.nan:g} in the first",
                hint="lower the learning rate",
            )

    def _iterations_in(self, budget_s: float) -> int:
        """How many iterations a budget allows, from timing a few of a learner that is let go."""
        trial = self.algorithm.make(self.env, self.settings, self.options.seed)
        trial.iterate(Progress(0, TIMED_ITERATIONS))
        began = time.process_time()
        for k in range(TIMED_ITERATIONS):
            trial.iterate(Progress(k, TIMED_ITERATIONS))
        iteration_s = (time.process_time() - began) / TIMED_ITERATIONS
        return max(int(budget_s / max(iteration_s, 1e-9)), 1)

    def policy(self, world: World) -> Policy:
        """The policy as it is now, in a world."""
        actor = network(self.learner.network(), self.env.size, self.env.units)
        actor.load_state_dict({k: v.cpu() for k, v in self.learner.weights().items()})
        env = self.env
        return Policy(self.options.method, world.setting, actor, env.band_name, env.observer_name)

    def _row(self, log: dict[str, float]) -> LogRow:
        world, bound = self.validation
        trajectory = simulate(world, self.policy(world))
        cost = trajectory.objective(world.end_value_per_mwh)
        per_day = world.scenarios.probability @ cost / self.validation_days
        proven = world.scenarios.probability @ bound / self.validation_days
        more = {name: value for name, value in log.items() if name != "loss"}
        gap = (per_day - proven) / abs(proven)
        return LogRow(self.iteration, self.cpu_s, log["loss"], float(per_day), float(gap), more)

    @cached_property
    def validation(self) -> tuple[World, Floats]:
        """The validation world, and (scenarios,) its proven bound, $."""
        world = self.sampler.validation_world()
        return world, clairvoyant(world).objective

    @property
    def validation_days(self) -> float:
        """Days of a validation episode."""
        case = self.validation[0].microgrid.case
        return case.slots * case.step_h / 24.0

    def config(self) -> dict[str, Any]:
        """Everything that it was started with, as plain data."""
        options = asdict(self.options) | {"iterations": self.iterations}
        return options | {
            "settings": asdict(self.settings),
            "band": self.env.band_name,
            "observer": self.env.observer_name,
        }


def check_device(device: str) -> None:
    """Refuses a device that there is not.

    Raises:
        UsageError: it is neither cpu nor cuda, or cuda without a GPU.
    """
    if device not in DEVICES:
        raise UsageError(
            f"device {device!r}; allowed: {', '.join(DEVICES)}", hint="cpu is the default"
        )
    if device == "cuda" and not torch.cuda.is_available():
        raise UsageError(
            "device 'cuda' without a GPU that torch can use; allowed here: cpu",
            hint="leave out --device; or install a build of torch for your GPU",
        )
