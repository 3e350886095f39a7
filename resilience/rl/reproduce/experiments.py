"""The experiments as data: who is compared with whom, in which world."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from resilience.models.simulator.simulator import RECOURSE, RecourseRule
from resilience.rl.algorithms.registry import ALGORITHMS
from resilience.rl.reproduce import published
from resilience.rl.reproduce.published import Published

MESH_CASE = "ieee14"


@dataclass(frozen=True)
class Effort:
    """How much is spent.

    Attributes:
        days: of an episode, the last of the profiles.
        draws: outage paths, an episode each.
        seeds: trainings of every learner.
        variant_seeds: the same in the experiments that train once more.
        budget_s: CPU-seconds of every training without a schedule of its own.
        episodes: of the paper's schedule.
    """

    days: int
    draws: int
    seeds: int
    variant_seeds: int
    budget_s: float
    episodes: int


FULL = Effort(days=16, draws=16, seeds=5, variant_seeds=3, budget_s=60.0, episodes=400)
QUICK = Effort(days=4, draws=4, seeds=1, variant_seeds=1, budget_s=20.0, episodes=200)
"""Half of the paper's schedule, after which it says that it has converged."""


@dataclass(frozen=True)
class Contender:
    """A row of an experiment.

    Attributes:
        label: what it is called.
        dispatcher: name of a dispatcher, or of the algorithm that is trained.
        settings: of the algorithm.
        failed: number of agents that have failed.
        paper: what the paper prints of it.
    """

    label: str
    dispatcher: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    failed: int = 0
    paper: Published | None = None

    @property
    def learns(self) -> bool:
        """Whether it is trained."""
        return self.dispatcher in ALGORITHMS


@dataclass(frozen=True)
class Experiment:
    """Contenders in one world.

    Attributes:
        name: of its files.
        title: what it is about; experiments in a row with the same title stand in one table.
        contenders: its rows.
        variant: what sets it apart from those of the same title.
        case: name of the case; empty: the one that is reproduced.
        shed_cost_per_mwh: price of all load; None: the case's.
        load: by how much all load is off its forecast, per unit.
        pv: the same of PV.
        recourse: how islands are closed.
        trains_anew: whether its learners are trained for it alone.
    """

    name: str
    title: str
    contenders: tuple[Contender, ...]
    variant: str = ""
    case: str = ""
    shed_cost_per_mwh: float | None = None
    load: float = 0.0
    pv: float = 0.0
    recourse: RecourseRule = "economic"
    trains_anew: bool = False


RULE = Contender("rule 0.5", "rule", paper=published.RULE)
MINLP = Contender("MINLP", "mpc-blind", paper=published.MINLP)
DDPG = Contender("DDPG", "ddpg", paper=published.DDPG)
MAPPO = Contender("MAPPO", "mappo", paper=published.MAPPO)
PROPOSED = Contender("MADDPG-GRU", "maddpg", {"variant": "paper"}, paper=published.PROPOSED)
FIVE = (RULE, MINLP, DDPG, MAPPO, PROPOSED)
FURTHER = (
    Contender("mpc", "mpc"),
    Contender("stochastic", "stochastic"),
    Contender("apg", "apg"),
)
"""Of this package."""


def _proposed(label: str, paper: Published | None, failed: int = 0) -> Contender:
    return replace(PROPOSED, label=label, failed=failed, paper=paper)


METHODS = Experiment("methods", "five methods, and three of this package", (*FIVE, *FURTHER))
EXPERIMENTS = (
    METHODS,
    Experiment(
        "methods-paper", "the same with the paper's recourse, eqs. 20-21", FIVE, recourse="paper"
    ),
    *(
        Experiment(
            f"shed-price-{price:g}-{recourse}",
            "price of shedding in $/MWh and recourse, MADDPG-GRU trained for it",
            (_proposed("MADDPG-GRU", paper if recourse == "paper" else None),),
            variant=f"{price:g}, {recourse}",
            shed_cost_per_mwh=price,
            recourse=recourse,
            trains_anew=True,
        )
        for recourse in RECOURSE
        for price, paper in published.SHED_PRICE.items()
    ),
    Experiment(
        "failed-agents",
        "agents that fail, their storage idle",
        tuple(
            _proposed(f"{number} failed" if number else "none failed", paper, number)
            for number, paper in published.FAILED.items()
        ),
    ),
    Experiment(
        "deviation",
        "PV 15 % below and load 15 % above forecast",
        (
            _proposed("MADDPG-GRU", published.DEVIATION),
            replace(RULE, paper=None),
            replace(MINLP, paper=None),
        ),
        load=0.15,
        pv=-0.15,
    ),
    Experiment(
        "mesh",
        "IEEE 14-bus mesh, the same devices",
        (
            _proposed("MADDPG-GRU", published.MESH),
            replace(RULE, paper=None),
            replace(MINLP, paper=None),
        ),
        case=MESH_CASE,
        trains_anew=True,
    ),
)
