"""`harden`: what to build before the storm, within a budget or against a year of storms."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from resilience.arrays import Floats
from resilience.case import Case, load_case
from resilience.errors import UsageError
from resilience.models.microgrid import Physics
from resilience.models.program.risk import Risk
from resilience.planning.hardening.draws import draw_options
from resilience.planning.hardening.finished import Finished
from resilience.planning.hardening.judging import Judge, chances, strongest, worth
from resilience.planning.hardening.options import options_of, strengths
from resilience.planning.hardening.program import Option, hardening_program
from resilience.planning.hardening.report import Hardening
from resilience.planning.hardening.search import HardeningSearch
from resilience.planning.hardening.season import Season, season_of
from resilience.planning.hardening.yearly import Years
from resilience.planning.tables import copperplate_notes
from resilience.planning.two_stage.lshaped import DecompositionOptions
from resilience.progress import interruptible, notice, phase, stopwatch
from resilience.tolerances import SLOT_TOLERANCE

STORMS = 200
NEW_STORMS = 300
STEP_MIN = 60.0
SEEDS_APART = 77_777
GAP = 1e-3
LINEAR: tuple[Physics, ...] = ("copperplate", "lindistflow")


def harden(  # noqa: PLR0913 every one is an option of the command line
    case: Case | str | Path,
    budget: float | None = None,
    *,
    storms: int = STORMS,
    seed: int = 0,
    risk: Risk | str | None = None,
    factor: float | None = None,
    cost: float = 1.0,
    lines: Sequence[str] | None = None,
    frontier: Sequence[float] = (),
    new_storms: int = NEW_STORMS,
    new_seed: int | None = None,
    shift: float = 0.0,
    physics: Physics = "copperplate",
    step_min: float | None = None,
    gap: float = GAP,
    time_limit: float = math.inf,
    workers: int | None = None,
    out: str | Path | None = None,
) -> Hardening:
    """Which lines to strengthen, and which units to build, before the storm.

    Within a budget, or, where `[plan]` says how many storms come in a year, as far as it pays. The
    choice is proven by an L-shaped method over storms that are drawn once, every line as it is
    and as it would be; then the choice, and those beside it, are judged on storms that it has not
    seen.

    Args:
        case: a case with a storm on its track, its file, or the name of an installed one.
        budget: $ that may be spent; the case's `[plan] budget` if omitted, and without end if
            `[plan] storms_per_year` holds what is built against what storms cost in a year.
        storms: how many are planned for.
        seed: of their draw.
        risk: the objective, `cvar:0.9:0.5` say; expected cost if omitted.
        factor: one option for every line in place of the case's: so many times as strong.
        cost: of that option, $.
        lines: those alone.
        frontier: further budgets, $, each with its proof.
        new_storms: how many the choices are judged on.
        new_seed: of their draw; another than `seed` if omitted.
        shift: of the common strength of poles, in both draws; see `storms.Sampling`.
        physics: of the storms, copperplate or lindistflow.
        step_min: steps of the storms, minutes; an hour if omitted, or the case's own where that is
            longer, does not divide the horizon, or profiles stand in the case itself.
        gap: relative, at which the search stops.
        time_limit: seconds for each budget.
        workers: threads that solve storms; as many as there are cores if omitted. The result does
            not depend on it.
        out: folder of the result; what is finished is kept in it, and the same call goes on from
            there. `Hardening.save` writes the result itself.

    Raises:
        CaseError: the case has mistakes; all of them are listed.
        UsageError: no budget, no storm, nothing to choose, or numbers out of range.
        OutOfTimeError: no choice was tried in time.
        SolverError: the solver failed.
    """
    with stopwatch() as seconds:
        with phase("case"):
            case = case if isinstance(case, Case) else load_case(case)
            spend = _budget(case, budget)
            _check(storms, new_storms, physics, frontier)
            _check_ties(case, physics)
            planned = in_steps(case, step_min)
            season = season_of(planned)
        options = options_of(planned, season.lines, factor=factor, cost=cost, lines=lines)
        parsed = Risk.parse(risk) if isinstance(risk, str) else risk or Risk()
        other_seed = seed + SEEDS_APART if new_seed is None else new_seed
        question = _Question(
            planned, options, season, parsed, physics, Years.of_plan(case.plan), (storms, seed),
            (new_storms, other_seed), shift,
        )  # fmt: skip
        threads = workers or os.cpu_count() or 1
        decomposition = DecompositionOptions(gap=gap, time_limit=time_limit, workers=threads)
        search, fails = question.search(spend, decomposition)
        finished = Finished(None if out is None else Path(out), question.facts)
        with interruptible(finished.note):
            answer = question.answer(search, fails, (spend, *frontier), finished)
        if finished.read:
            notice(f"{out}: {finished.read} of {finished.count} parts were there")
    return replace(answer, seconds=seconds, notes=tuple(_notes(case, planned, physics)))


@dataclass(frozen=True)
class _Question:
    """What to build against which storms.

    Attributes:
        case: in the steps of the plan.
        options: what may be built.
        season: the storms.
        risk: the objective over them.
        physics: of them.
        years: how often they come, where the case says so.
        draw: how many are planned for, and the seed of their draw.
        new_draw: likewise of those that choices are judged on.
        shift: of both draws.
    """

    case: Case
    options: tuple[Option, ...]
    season: Season
    risk: Risk
    physics: Physics
    years: Years | None
    draw: tuple[int, int]
    new_draw: tuple[int, int]
    shift: float

    @property
    def facts(self) -> list[object]:
        """What every part of the answer depends on."""
        tracks = [(member.track.name, member.winds) for member in self.season.storms]
        return [
            self.case, self.options, tracks, self.season.share, self.risk, self.physics,
            self.years, self.draw, self.shift,
        ]  # fmt: skip

    @cached_property
    def annual_cost(self) -> Floats | None:
        """(options,) $ a year for each; None where nobody says how many storms come."""
        return None if self.years is None else self.years.annual_cost(self.options)

    @property
    def per_year(self) -> float:
        """Storms that an objective is of: those of a year, or one."""
        return 1.0 if self.years is None else self.years.storms_per_year

    def search(
        self, budget: float, options: DecompositionOptions
    ) -> tuple[HardeningSearch, Floats]:
        """The search, and (options,) the chance that the line of each is down as it is."""
        with phase("storms"):
            draws = draw_options(self.season, strengths(self.options), *self.draw, self.shift)
        price = None if self.annual_cost is None else self.annual_cost / self.per_year
        with phase("model"):
            program = hardening_program(
                self.case, self.options, draws, budget, price=price, risk=self.risk,
                physics=self.physics,
            )  # fmt: skip
            return HardeningSearch(program, options), chances(self.options, draws)

    def answer(
        self,
        search: HardeningSearch,
        fails: Floats,
        budgets: tuple[float, ...],
        finished: Finished,
    ) -> Hardening:
        """What to build for each of some budgets, the first of them the plan's, and its worth."""
        spend, gap = budgets[0], search.options.gap
        path = finished.sets("greedy", [spend], lambda: search.greedy(spend))
        choice, *others = (
            finished.choice(limit, gap, partial(search.best, limit, path[1:]))
            for limit in (spend, *sorted({*map(float, budgets[1:])}))
        )
        sets = {
            "nothing": path[0],
            "plan": choice.chosen,
            "greedy": path[-1],
            "naive": search.in_order(np.nan_to_num(fails), spend),
            "all": strongest(self.options),
        }
        alone, beside = finished.arrays(
            "worth", [choice.chosen], lambda: worth(search, choice.chosen)
        )
        judge = Judge(self.case, self.season, self.options, self.physics, self.shift, finished)
        sample, unseen = judge.all_outcomes(sets, [self.draw, self.new_draw])
        uncrowded = judge.outcomes(choice.chosen, *self.draw, crews=False).value(self.risk)
        plans = sorted([*others, choice], key=lambda plan: plan.budget)
        n = self.per_year
        return Hardening(
            self.case, self.options, self.risk, choice.times(n), gap,
            tuple(plan.times(n) for plan in plans), sets, fails, alone * n, beside * n, sample,
            uncrowded, unseen, self.draw[0], self.new_draw[0], self.draw[1], self.new_draw[1],
            {}, (), self.season, self.years, self.annual_cost,
        )  # fmt: skip


def in_steps(case: Case, step_min: float | None) -> Case:
    """The case in steps of so many minutes, see `harden`.

    Raises:
        UsageError: steps that the horizon, or its profiles, cannot be cut into.
    """
    step = STEP_MIN if step_min is None else step_min
    slots = case.slots * case.step_min / step if step > 0.0 else 0.0
    fits = slots >= 1.0 and abs(slots - round(slots)) < SLOT_TOLERANCE
    if step_min is None:
        inline = bool(case.source.get("profiles", {}).get("columns"))
        if case.step_min >= step or not fits or inline:
            return case
    elif not fits:
        raise UsageError(
            f"steps of {step_min:g} min; allowed: a part of the horizon, {case.window}",
            hint="60 is usual",
        )
    if step == case.step_min:
        return case
    return case.replace(step_min=step, slots=round(slots))


def _budget(case: Case, budget: float | None) -> float:
    """$ that may be spent; infinite where only a year of storms is to be paid for.

    Raises:
        UsageError: nobody says how much, or it is out of range.
    """
    spend = case.plan.budget if budget is None and case.plan is not None else budget
    if spend is None and Years.of_plan(case.plan) is not None:
        return math.inf
    if spend is None or not 0.0 <= spend < math.inf:
        raise UsageError(
            f"a budget of {'nothing' if spend is None else f'{spend:g} $'}; allowed: 0 $ or more",
            hint="give --budget, or state budget or storms_per_year in [plan]",
        )
    return float(spend)


def _check(storms: int, new_storms: int, physics: Physics, further: Sequence[float]) -> None:
    """Refuses what is out of range.

    Raises:
        UsageError: all of it.
    """
    wrong = []
    if storms < 1 or new_storms < 2:
        wrong.append(f"{storms} storms and {new_storms} new ones; allowed: 1, and 2, or more")
    if physics not in LINEAR:
        wrong.append(f"physics {physics!r}; allowed: {', '.join(LINEAR)}")
    if not all(0.0 <= b < math.inf for b in further):
        wrong.append(f"budgets {', '.join(f'{b:g}' for b in further)}; allowed: 0 $ or more")
    if wrong:
        raise UsageError("; ".join(wrong), hint="200 storms, and 300 new ones, are usual")


def _check_ties(case: Case, physics: Physics) -> None:
    """Refuses lines that may be switched where voltages are planned with.

    Raises:
        UsageError: there are some.
    """
    names = [line.name for line in case.line if line.switchable or line.tie_cost is not None]
    if names and physics != "copperplate":
        raise UsageError(
            f"physics {physics!r} with lines that may be switched, {', '.join(names)}; allowed: "
            "copperplate",
            hint="loops that switches close need voltages around them; leave out --physics",
        )


def _notes(case: Case, planned: Case, physics: Physics) -> list[str]:
    """What a reader should know of the figures."""
    notes = [
        "each storm is met by an operator who knows it from its start: whoever does not pays more, "
        "with and without what is built",
        "the choice is proven in a program with crews without limit in which every island lives; "
        "costs are those with the crews of the case, islands without a source dark",
    ]
    if planned.step_min != case.step_min:
        notes.append(
            f"steps of {planned.step_min:g} min, of the case {case.step_min:g}: a line that is "
            "down in a part of a step is down in all of it"
        )
    if len(case.plan.storm if case.plan is not None else ()) > 1 and _has_cloud(case):
        notes.append("the sun is that under the case's own storm, in all storms")
    if any(line.switchable or line.tie_cost is not None for line in case.line):
        notes.append(
            "switchable lines and ties are not strengthened, and switched as is best, in parts "
            "too; in the program they may close loops"
        )
    if any(line.tie_cost is not None for line in case.line):
        notes.append("ties stand in every storm, as lines do that are open at first")
    return [*notes, *copperplate_notes(case, physics)]


def _has_cloud(case: Case) -> bool:
    return case.storm is not None and case.storm.cloud is not None
