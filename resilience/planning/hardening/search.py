"""The search for what to build: the proven choice, and those that people would make without it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from resilience.arrays import Bools, Floats
from resilience.models.program.gate import gap
from resilience.planning.hardening.draws import StrengthOption
from resilience.planning.hardening.program import HardeningProgram
from resilience.planning.hardening.sites import UnitOption
from resilience.planning.two_stage.lshaped import (
    DecompositionOptions,
    Machinery,
    TwoStageSolution,
    lshaped,
)
from resilience.progress import meter

SPARE = 1e-9  # of a budget: sums of costs are rounded


@dataclass(frozen=True)
class Choice:
    """What is built for a budget.

    Attributes:
        budget: $ that might be spent, infinite where nothing but their price holds choices.
        chosen: (options,) which are built.
        value: $ of the risk over the storms of the program, and of the price of what is built.
        bound: $ that no choice within the budget stays below in that program.
        gap: relative, of value and bound.
        rounds: how often the storms were solved.
    """

    budget: float
    chosen: Bools
    value: float
    bound: float
    gap: float
    rounds: int

    def times(self, storms: float) -> Choice:
        """The same with the $ of so many storms."""
        return replace(self, value=self.value * storms, bound=self.bound * storms)


@dataclass
class HardeningSearch:
    """A program, and all that was learnt of it so far.

    Attributes:
        program: what to build, and the storms.
        options: how to search, and when to stop.
    """

    program: HardeningProgram
    options: DecompositionOptions
    _machinery: Machinery = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._machinery = Machinery.without_cuts(self.program.two_stage, self.options)

    def costs(self, chosen: Bools) -> Floats:
        """(storms of the program,) $ of each with options (options,) built."""
        z = self.program.trunk_with(chosen)
        trial = self._machinery.master.trial_of(z)
        return self._machinery.recourse.solve(trial.states).cost

    def value(self, chosen: Bools) -> float:
        """$ of the risk with options (options,) built, and of their price."""
        two_stage = self.program.two_stage
        probability = np.array([branch.probability for branch in two_stage.branches])
        risk = two_stage.risk.value(self.costs(chosen), probability)
        return risk + float(self.program.price @ chosen)

    def best(self, budget: float, tries: Iterable[Bools] = ()) -> Choice:
        """The best choice within a budget, with its proof; `tries` are looked at first.

        Raises:
            OutOfTimeError: nothing was tried in time.
            SolverError: the solver failed.
        """
        program, master = self.program, self._machinery.master
        master.change_data(program.data_with(budget))
        first = [] if master.has_floors else [np.zeros(len(program.options), bool)]
        inside = [*first, *(chosen for chosen in tries if self._fits(chosen, budget))]
        designs = np.array([program.trunk_with(chosen) for chosen in inside])
        options = replace(self.options, designs=designs)
        solution: TwoStageSolution = lshaped(program.two_stage, options, self._machinery)
        chosen = self.pruned(solution.trunk[program.design_columns] > 0.5)
        value = self.value(chosen)
        reached = gap(value, solution.bound, program.two_stage.cost_scale)
        return Choice(budget, chosen, value, solution.bound, reached, solution.iterations)

    def pruned(self, chosen: Bools) -> Bools:
        """The same without what costs something and saves nothing."""
        useful, value = chosen.copy(), self.value(chosen)
        for k in np.flatnonzero(chosen):
            without = useful.copy()
            without[k] = False
            if self.value(without) <= value + SPARE * abs(value):
                useful = without
        return self._in_turn(useful)

    def greedy(self, budget: float) -> list[Bools]:
        """Choices, each with one option more than the one before: what saves most per $."""
        chosen = np.zeros(len(self.program.options), bool)
        value, path = self.value(chosen), [chosen]
        while True:
            after = self.additions(chosen, budget)
            open_ = np.flatnonzero(np.isfinite(after))
            if not len(open_):
                return path
            price = np.maximum(self.program.cost[open_], 1e-300)
            best = int(open_[np.argmax((value - after[open_]) / price)])
            if value - after[best] <= SPARE * abs(value):
                return path
            chosen, value = chosen.copy(), float(after[best])
            chosen[best] = True
            path.append(chosen)

    def additions(self, chosen: Bools, budget: float = np.inf) -> Floats:
        """(options,) $ of the risk with one more option; inf of those that cannot be added."""
        after = np.full(len(chosen), np.inf)
        with meter("one more", len(chosen)) as progress:
            for k in range(len(chosen)):
                more = chosen.copy()
                more[k] = True
                if not chosen[k] and self._fits(more, budget):
                    after[k] = self.value(more)
                progress.advance(1)
        return after

    def in_order(self, rank: Floats, budget: float) -> Bools:
        """Options (options,) taken by falling rank, as far as the budget goes."""
        chosen = np.zeros(len(rank), bool)
        for k in np.argsort(-rank, kind="stable"):
            more = chosen.copy()
            more[k] = True
            if rank[k] > 0.0 and self._fits(more, budget):
                chosen = more
        return chosen

    def _fits(self, chosen: Bools, budget: float) -> bool:
        """Whether one option a line at most is chosen, units in turn, and the budget is kept."""
        options = [self.program.options[k] for k in np.flatnonzero(chosen)]
        lines = [option.line for option in options if isinstance(option, StrengthOption)]
        in_turn = bool((self._in_turn(chosen) == chosen).all())
        spent = float(self.program.cost @ chosen)
        return len(set(lines)) == len(lines) and in_turn and spent <= budget * (1.0 + SPARE)

    def _in_turn(self, chosen: Bools) -> Bools:
        """The same choice (options,) with the first units of every site in place of as many."""
        ordered, built = chosen.copy(), Counter[str]()
        units = [(k, o) for k, o in enumerate(self.program.options) if isinstance(o, UnitOption)]
        for k, option in units:
            built[option.site] += int(chosen[k])
        for k, option in units:
            ordered[k] = option.number <= built[option.site]
        return ordered
