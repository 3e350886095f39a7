"""`harden`: which lines to strengthen before the storm, within a budget."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from resilience.arrays import Bools, Floats
from resilience.case import Case, load_case
from resilience.errors import UsageError
from resilience.fragility.chain import Storm, storm
from resilience.models.microgrid import Physics
from resilience.models.program.risk import Risk
from resilience.planning.hardening.draws import (
    StrengthDraws,
    StrengthOption,
    draw_options,
    drawn_with,
)
from resilience.planning.hardening.evaluation import StormOutcomes, outcomes_of
from resilience.planning.hardening.options import options_of
from resilience.planning.hardening.program import hardening_program
from resilience.planning.hardening.report import Hardening
from resilience.planning.hardening.search import HardeningSearch
from resilience.planning.tables import copperplate_notes
from resilience.planning.two_stage.lshaped import DecompositionOptions
from resilience.progress import meter, phase, stopwatch
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
) -> Hardening:
    """Which lines to strengthen before the storm, within a budget.

    The choice is proven by an L-shaped method over storms that are drawn once, every line as it is
    and as it would be; then the choice, and those beside it, are judged on storms that it has not
    seen.

    Args:
        case: a case with a storm on its track, its file, or the name of an installed one.
        budget: $ that may be spent; the case's `[plan] budget` if omitted.
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
            planned = in_steps(case, step_min)
            storm_of_case = storm(planned)
        fallible = storm_of_case.lines.names
        options = options_of(planned, fallible, factor=factor, cost=cost, lines=lines)
        parsed = Risk.parse(risk) if isinstance(risk, str) else risk or Risk()
        with phase("storms"):
            draws = draw_options(storm_of_case, options, storms, seed, shift)
        with phase("model"):
            program = hardening_program(
                planned, options, draws, spend, risk=parsed, physics=physics
            )
            threads = workers or os.cpu_count() or 1
            search = HardeningSearch(
                program, DecompositionOptions(gap=gap, time_limit=time_limit, workers=threads)
            )
        fails = _fails(options, draws)
        path = search.greedy(spend)
        choice = search.best(spend, path[1:])
        others = [search.best(further, path[1:]) for further in sorted({*map(float, frontier)})]
        sets = {
            "nothing": path[0],
            "plan": choice.chosen,
            "greedy": path[-1],
            "naive": search.in_order(fails, spend),
            "all": _strongest(options),
        }
        alone, beside = _worth(search, choice.chosen)
        other_seed = seed + SEEDS_APART if new_seed is None else new_seed
        judge = _Judge(planned, storm_of_case, options, physics, shift)
        with meter("judging", 2 * len(sets) + 1) as progress:
            sample, unseen = {}, {}
            for name, chosen in sets.items():
                sample[name] = judge.outcomes(chosen, storms, seed)
                progress.advance(1)
                unseen[name] = judge.outcomes(chosen, new_storms, other_seed)
                progress.advance(1)
            uncrowded = judge.outcomes(choice.chosen, storms, seed, crews=False)
            progress.advance(1)
    plans = tuple(sorted([*others, choice], key=lambda plan: plan.budget))
    return Hardening(
        planned, options, parsed, choice, gap, plans, sets, fails, alone, beside, sample,
        uncrowded.value(parsed), unseen, storms, new_storms, seed, other_seed, seconds,
        tuple(_notes(case, planned, physics)),
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
    """$ that may be spent.

    Raises:
        UsageError: nobody says how much, or it is out of range.
    """
    spend = case.plan.budget if budget is None and case.plan is not None else budget
    if spend is None or not 0.0 <= spend < math.inf:
        raise UsageError(
            f"a budget of {'nothing' if spend is None else f'{spend:g} $'}; allowed: 0 $ or more",
            hint="give --budget, or state budget in [plan]",
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


def _fails(options: Sequence[StrengthOption], draws: StrengthDraws) -> Floats:
    """(options,) probability that the line of each is down at all, as it is."""
    ever = draws.scenarios.down.any(axis=1) @ draws.scenarios.probability
    chance = dict(zip(draws.scenarios.lines, ever.tolist(), strict=True))
    return np.array([chance[option.line] for option in options])


def _strongest(options: Sequence[StrengthOption]) -> Bools:
    """(options,) the strongest of every line."""
    best = {option.line: option for option in sorted(options, key=lambda o: o.factor)}
    return np.array([best[option.line] is option for option in options])


def _worth(search: HardeningSearch, chosen: Bools) -> tuple[Floats, Floats]:
    """(options,) $ that each saves alone, and beside what is chosen; NaN: it cannot be added."""
    nothing = np.zeros(len(chosen), bool)
    alone = search.value(nothing) - search.additions(nothing)
    value, after = search.value(chosen), search.additions(chosen)
    beside = np.where(np.isfinite(after), value - after, np.nan)
    for k in np.flatnonzero(chosen):
        without = chosen.copy()
        without[k] = False
        beside[k] = search.value(without) - value
    return alone, beside


@dataclass(frozen=True)
class _Judge:
    """Tells what storms cost with something built, each set once."""

    case: Case
    storm: Storm
    options: tuple[StrengthOption, ...]
    physics: Physics
    shift: float
    _known: dict[tuple[bytes, int, int, bool], StormOutcomes] = field(default_factory=dict)

    def outcomes(self, chosen: Bools, n: int, seed: int, *, crews: bool = True) -> StormOutcomes:
        """`n` storms of a draw, with options (options,) built."""
        key = chosen.tobytes(), n, seed, crews
        if key not in self._known:
            built = [self.options[k] for k in np.flatnonzero(chosen)]
            scenarios = drawn_with(self.storm, built, n, seed, self.shift, crews=crews)
            self._known[key] = outcomes_of(self.case, scenarios, self.physics)
        return self._known[key]


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
    if any(line.switchable for line in case.line):
        notes.append("switchable lines are not strengthened, and switched as is best, in parts too")
    return [*notes, *copperplate_notes(case, physics)]
