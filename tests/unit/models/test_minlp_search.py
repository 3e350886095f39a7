"""The search of `minlp` by itself: solvers answer what a test says, rounds do what they should."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from resilience.arrays import Floats
from resilience.errors import InfeasibleError, SolverError
from resilience.models.backends.base import INFEASIBLE, NOTHING, Solution
from resilience.models.case_program import CaseProgram, horizon
from resilience.models.methods import MethodOptions
from resilience.models.methods.answer import NOTHING_NEW, OUT_OF_ROUNDS, OUT_OF_TIME, Deadline
from resilience.testing import small_case

minlp: Any = importlib.import_module("resilience.models.methods.minlp")


def program(*, units: bool = True) -> CaseProgram:
    """A unit that runs or does not, where asked for, and a store in one of two modes."""
    unit = {"p_min_mw": 0.3, "p_max_mw": 1.2, "cost_per_mwh": 2.0, "no_load_cost_per_h": 0.4}
    case = small_case(
        slots=2,
        load=[{"p_max_mw": 1.6, "shed_cost_per_mwh": 9.0}],
        ess=[{"p_max_mw": 0.8, "e_mwh": 1.9}],
        grid=[{"import_max_mw": 0.7, "import_cost_per_mwh": 3.0}],
        generator=[unit] if units else [],
    )
    return horizon(case, "distflow")


@dataclass
class Clock:
    """What it shows is what a test says, s."""

    now: float = 17.0

    def __call__(self) -> float:
        return self.now


def search(
    of: CaseProgram | None = None, *, best: float | None = None, clock: Clock | None = None
) -> Any:
    """A search with a limit of 8 s, a gap of 0.01 and a bound of 20 $, and a plan where asked."""
    options = MethodOptions(8.0, 0.01)
    of = of or program()
    plan = NOTHING if best is None else answer(of, best, 3.0)
    deadline = Deadline(8.0, clock or Clock())
    return minlp.ConicSearch(of, options, deadline, bound=20.0, best=plan)


def answer(of: CaseProgram, objective: float, bound: float, ones: float = 0.0) -> Solution:
    """A point, its integers at `ones`."""
    z = np.full(of.standard.n_columns, 0.25)
    z[of.standard.integer] = ones
    return Solution("feasible", z, objective, bound)


def test_a_gap_is_to_the_bound_that_is_meant() -> None:
    found = search(best=25.0)
    assert found.gap == pytest.approx(5.0 / 25.0)
    assert found.gap_of(found.best, 24.0) == pytest.approx(1.0 / 25.0)
    assert search().gap == np.inf


def test_it_is_done_when_the_gap_is_small_or_time_is_up() -> None:
    clock = Clock()
    near, far = search(best=20.1, clock=clock), search(best=25.0, clock=clock)
    assert near.done
    assert not far.done
    clock.now += 8.5
    assert far.done
    # Half a second later than the limit there is still time for a first plan.
    assert far.seconds() == 0.0
    assert search(clock=clock).seconds() == 9.0
    late = search()
    late.deadline.clock.now += 8.5
    assert late.seconds() == pytest.approx(0.5)


def test_the_bound_never_falls_and_never_passes_what_was_cut_off() -> None:
    found = search()
    found.learn(19.0)
    assert found.bound == 20.0
    found.exclude(answer(found.program, 30.0, 3.0).point, 27.0)
    found.exclude(answer(found.program, 30.0, 3.0, ones=1.0).point, 29.0)
    assert found.floor == 27.0
    found.learn(26.0)
    assert found.bound == 26.0
    found.learn(28.0)
    assert found.bound == 27.0


@dataclass
class Script:
    """Answers of solvers, one after the other, and what was asked.

    Attributes:
        masters: of the MILP.
        relaxed: of the conic program with a commitment.
        plans: made of these.
        broken: modes that the points of the conic program break.
        shares: of the time that remains, of every master.
        tangents: points to which tangents were asked for.
        judged: points that were asked for the modes that they break.
    """

    masters: Iterator[Solution] = field(default_factory=lambda: iter(()))
    relaxed: Iterator[Solution] = field(default_factory=lambda: iter(()))
    plans: Iterator[Solution] = field(default_factory=lambda: iter(()))
    broken: dict[int, Any] = field(default_factory=dict)
    shares: list[float] = field(default_factory=list)
    tangents: list[Floats] = field(default_factory=list)
    judged: list[Floats] = field(default_factory=list)


Play = Callable[..., Script]


@pytest.fixture
def play(monkeypatch: pytest.MonkeyPatch) -> Play:
    def prepare(**answers: Any) -> Script:
        script = Script(**{k: iter(v) if k != "broken" else v for k, v in answers.items()})

        def master(search: Any) -> Solution:
            script.shares.append(search.milp_share)
            return next(script.masters)

        def tangents(standard: Any, z: Floats, *rest: float) -> tuple[Any, Floats]:
            script.tangents.append(z)
            return true_tangents(standard, z, *rest)

        def broken_modes(standard: Any, z: Floats) -> dict[int, Any]:
            script.judged.append(z)
            return script.broken

        true_tangents = minlp.tangents
        monkeypatch.setattr(minlp, "_commitment", master)
        monkeypatch.setattr(minlp, "tangents", tangents)
        monkeypatch.setattr(minlp, "relaxation", lambda *_, **__: next(script.relaxed))
        monkeypatch.setattr(minlp, "with_all_held", lambda *_: next(script.plans))
        monkeypatch.setattr(minlp, "broken_modes", broken_modes)
        return script

    return prepare


def test_a_round_that_finds_a_better_plan_goes_on(play: Play) -> None:
    found = search(best=40.0)
    of = found.program
    master, relaxed, plan = answer(of, 21.0, 20.5), answer(of, 29.0, 28.5), answer(of, 30.0, 3.0)
    script = play(masters=[master], relaxed=[relaxed], plans=[plan])
    assert minlp._round(found, 3)
    assert (found.best, found.bound, found.floor) == (plan, 20.5, np.inf)
    (broken, touched), points = script.tangents, (master.point, relaxed.point)
    assert broken is points[0]
    assert touched is points[1]
    assert len(found.rows) == 2


def test_a_commitment_that_brings_nothing_is_cut_off_with_its_own_bound(play: Play) -> None:
    found = search(best=29.0)
    of = found.program
    master, relaxed = answer(of, 21.0, 20.5, ones=1.0), answer(of, 29.5, 28.5)
    play(masters=[master], relaxed=[relaxed], plans=[answer(of, 30.0, 3.0)])
    assert minlp._round(found, 3)
    assert (found.best.objective, found.bound, found.floor) == (29.0, 20.5, 28.5)
    row, side = found.rows[-1]
    assert (row @ master.point)[0] > side[0] >= (row @ relaxed.point)[0]


def test_one_whose_conic_program_has_no_point_is_cut_off_for_good(play: Play) -> None:
    found = search(best=29.0)
    play(masters=[answer(found.program, 21.0, 20.5, ones=1.0)], relaxed=[INFEASIBLE])
    assert minlp._round(found, 3)
    assert found.floor == np.inf
    assert len(found.rows) == 2


def test_more_modes_are_worth_a_round_of_the_same_commitment(play: Play) -> None:
    """The plan is far above its relaxation, which is in two modes at once: binaries before cuts."""
    found = search(best=29.0)
    of = found.program
    first, later = np.array([True, False]), np.array([False, True])
    for broken, n_modes in ((first, 1), (later, 2)):
        play(
            masters=[answer(of, 21.0, 20.5)],
            relaxed=[answer(of, 27.5, 27.0)] * 2,
            plans=[answer(of, 30.0, 3.0)],
            broken={0: broken},
        )
        assert minlp._round(found, 3)
        assert found.floor == np.inf
        assert found.n_modes == n_modes
    # Nothing new is broken: the commitment goes, with the bound that holds whatever modes do.
    play(
        masters=[answer(of, 21.0, 20.5)],
        relaxed=[answer(of, 26.5, 26.0), answer(of, 28.5, 28.0)],
        plans=[answer(of, 30.0, 3.0)],
        broken={0: later},
    )
    assert minlp._round(found, 3)
    assert found.floor == 26.0


def test_a_plan_near_its_relaxation_asks_for_no_modes(play: Play) -> None:
    found = search(best=29.0)
    of = found.program
    play(
        masters=[answer(of, 21.0, 20.5)],
        relaxed=[answer(of, 27.95, 27.95)],
        plans=[answer(of, 28.0, 3.0)],
        broken={0: np.array([True, False])},
    )
    assert minlp._round(found, 3)
    assert found.n_modes == 0


def test_modes_that_leave_the_conic_program_nothing_are_told_from_its_point(play: Play) -> None:
    found = search(best=29.0)
    of = found.program
    found.modes[0] = np.array([True, False])
    relaxed, held = answer(of, 27.5, 27.0), answer(of, 28.5, 28.0)
    for point, judged in ((INFEASIBLE, relaxed), (held, held)):
        script = play(
            masters=[answer(of, 21.0, 20.5)],
            relaxed=[relaxed, point],
            plans=[NOTHING],
            broken={0: np.array([False, True])},
        )
        assert minlp._round(found, 3)
        assert found.n_modes == 2
        assert script.judged[0] is judged.point


def test_without_a_choice_there_is_no_round(play: Play) -> None:
    script = play(masters=[NOTHING])
    found = search(program(units=False), best=40.0)
    assert not minlp._round(found, 3)
    found.modes[0] = np.array([True, False])
    assert minlp._round(found, 3)
    assert script.shares == [0.5]


def test_without_integers_there_is_nothing_to_cut_off(play: Play) -> None:
    found = search(program(units=False), best=29.0)
    of = found.program
    found.modes[0] = np.array([True, False])
    less, more = 20.5 * (1.0 + 0.5e-9), 20.5 * (1.0 + 2.5e-9)
    for bound, rises in ((20.5, True), (20.5, False), (less, False), (more, True)):
        play(
            masters=[answer(of, 21.0, bound)],
            relaxed=[answer(of, 28.5, 28.0)] * 2,
            plans=[answer(of, 30.0, 3.0)],
        )
        # As long as tangents raise the bound, another round may bring more.
        assert minlp._round(found, 3) == rises
        assert found.floor == np.inf


def test_a_master_in_time_trouble_gets_all_that_remains_and_then_ends(play: Play) -> None:
    nothing = replace(NOTHING, bound=22.0)
    script = play(masters=[nothing, replace(nothing, bound=23.0)])
    found = search(best=40.0)
    assert minlp._round(found, 3)
    assert not found.starved
    assert found.bound == 22.0
    assert not minlp._round(found, 4)
    assert found.starved
    assert found.bound == 23.0
    assert script.shares == [0.5, 1.0]


def test_a_master_is_solved_closer_than_the_gap_in_half_of_the_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of 8 s 3 are over; its rows are all tangents and cuts so far, one below the other."""
    clock = Clock()
    found, asked = search(clock=clock), list[dict[str, Any]]()
    for ones, bound in ((0.0, 22.0), (1.0, 23.0)):
        found.exclude(answer(found.program, 30.0, 3.0, ones=ones).point, bound)

    class Solver:
        def __init__(self, lowered: Any, **options: Any) -> None:
            asked.append(options)

        def update(self, vectors: Any) -> None:
            assert vectors is found.program.vectors

        def solve(self) -> Solution:
            return INFEASIBLE

    monkeypatch.setattr(minlp, "Highs", Solver)
    clock.now += 3.0
    assert minlp._commitment(found) is INFEASIBLE
    ((options),) = asked
    assert (options["gap"], options["time_limit"]) == (0.005, 2.5)
    assert [side.tolist() for side in options["rows"][1:]] == [[-1.0, 1.0]]
    clock.now += 5.0
    assert minlp._commitment(found) is NOTHING
    assert len(asked) == 1


def test_modes_with_binaries_are_held_as_the_master_has_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The store charges in the master's first hour: discharging is held at zero there, not in the
    second, where its mode is free.
    """
    found = search(best=29.0)
    of = found.program
    charge, discharge = (of.standard.columns(f"ess.{way}")[0] for way in ("charge", "discharge"))
    modes = minlp.broken_modes(of.standard, busy(of, 0.25, 0.25).point)
    (store,) = (k for k in modes if of.standard.structures[k].name == "ess")
    found.modes[store] = np.array([True, False])
    asked = []

    def relaxation(program: Any, vectors: Any, *, seconds: float) -> Solution:
        asked.append(vectors)
        return INFEASIBLE

    monkeypatch.setattr(minlp, "relaxation", relaxation)
    minlp._plan(found, answer(of, 27.5, 27.0), of.vectors, busy(of, 0.75, 0.25).point)
    (vectors,) = asked
    assert vectors.upper[discharge].tolist() == [0.0, of.vectors.upper[discharge[1]]]
    assert (vectors.upper[charge] == of.vectors.upper[charge]).all()


def busy(of: CaseProgram, charge: float, discharge: float) -> Solution:
    """A point whose store charges and discharges at once."""
    z = np.zeros(of.standard.n_columns)
    z[of.standard.columns("ess.charge")] = charge
    z[of.standard.columns("ess.discharge")] = discharge
    return Solution("feasible", z, 30.0, 3.0)


def test_a_bound_that_meets_the_plan_ends_the_round(play: Play) -> None:
    """Nothing of its commitment is tried: the script would have no answer."""
    found = search(best=40.0)
    play(masters=[answer(found.program, 39.8, 39.8)])
    assert minlp._round(found, 3)
    assert found.done


def test_when_no_commitment_remains_the_floor_is_the_bound(play: Play) -> None:
    found = search(best=40.0)
    found.floor = 39.0
    play(masters=[INFEASIBLE, INFEASIBLE])
    assert minlp._round(found, 3)
    assert found.bound == 39.0
    assert not minlp._round(found, 4)


def test_no_commitment_at_all_is_infeasible_unless_some_were_cut_off(play: Play) -> None:
    for floor, best, raises in ((np.inf, None, True), (33.0, None, False), (np.inf, 40.0, False)):
        found = search(best=best)
        found.floor = floor
        if raises:
            with pytest.raises(InfeasibleError):
                minlp._try(found, INFEASIBLE)
        else:
            assert not minlp._try(found, INFEASIBLE)


@pytest.mark.parametrize(("fraction", "starts"), [(0.5, 1), (1.0, 0)])
def test_a_relaxation_with_whole_units_is_the_first_commitment(
    monkeypatch: pytest.MonkeyPatch, fraction: float, starts: int
) -> None:
    """With a unit that runs by half, any commitment is; both leave tangents of the relaxation."""
    of, sought, touched = program(), list[Any](), list[Any]()
    true_tangents = minlp.tangents
    first, any_one = answer(of, 19.0, 19.0, fraction), answer(of, 31.0, -np.inf, ones=1.0)

    def any_point(*_: Any) -> Solution:
        sought.append(any_one)
        return any_one

    def planned(program: Any, point: Solution, *_: Any) -> Solution:
        assert point is (any_one if starts else first)
        return answer(of, 25.0, 3.0)

    def tangents(*asked: Any) -> Any:
        touched.append(asked)
        return true_tangents(*asked)

    monkeypatch.setattr(minlp, "tangents", tangents)
    monkeypatch.setattr(minlp, "root", lambda *_: first)
    monkeypatch.setattr(minlp, "any_point", any_point)
    monkeypatch.setattr(minlp, "relaxation", lambda *_, **__: any_one)
    monkeypatch.setattr(minlp, "with_all_held", planned)
    monkeypatch.setattr(minlp, "broken_modes", lambda *_: {})
    monkeypatch.setattr(minlp, "_round", lambda *_: False)
    assert minlp.minlp(of, MethodOptions(8.0, 0.01, Clock())).objective == 25.0
    assert len(sought) == starts
    assert touched == [(of.standard, first.z)]


def test_a_start_that_finds_nothing_leaves_it_to_the_rounds(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = search()
    monkeypatch.setattr(minlp, "any_point", lambda *_: NOTHING)
    minlp._commit(found, None)
    assert found.best is NOTHING
    monkeypatch.setattr(minlp, "any_point", lambda *_: answer(found.program, 31.0, 3.0))
    monkeypatch.setattr(minlp, "relaxation", lambda *_, **__: INFEASIBLE)
    minlp._commit(found, None)
    assert found.best is NOTHING
    monkeypatch.setattr(minlp, "any_point", lambda *_: INFEASIBLE)
    with pytest.raises(InfeasibleError):
        minlp._commit(found, None)


@pytest.mark.parametrize(
    ("seconds", "starved", "said"),
    [
        (0.0, False, "minlp found no plan, though the linear relaxation has one"),
        (9.0, False, "minlp found no plan within 8 s"),
        (0.0, True, "minlp found no plan within 8 s"),
    ],
)
def test_without_a_plan_it_says_whether_time_was_short(
    monkeypatch: pytest.MonkeyPatch, seconds: float, starved: bool, said: str
) -> None:
    clock, of = Clock(), program()

    def one_round(search: Any, k: int) -> bool:
        clock.now += seconds
        search.starved = starved
        return False

    monkeypatch.setattr(minlp, "root", lambda *_: answer(of, 19.0, 19.0))
    monkeypatch.setattr(minlp, "_round", one_round)
    monkeypatch.setattr(minlp, "with_all_held", lambda *_: NOTHING)
    with pytest.raises(SolverError, match=said):
        minlp.minlp(of, MethodOptions(8.0, 0.01, clock))


@pytest.mark.parametrize(
    ("rounds", "seconds", "starved", "status", "reason"),
    [
        ([True, False], 0.0, False, "feasible", NOTHING_NEW),
        ([True] * 20, 0.0, False, "feasible", OUT_OF_ROUNDS),
        ([True] * 3, 3.0, False, "feasible", OUT_OF_TIME),
        ([True, False], 0.0, True, "feasible", OUT_OF_TIME),
    ],
)
def test_the_reason_why_it_ended(
    monkeypatch: pytest.MonkeyPatch,
    rounds: list[bool],
    seconds: float,
    starved: bool,
    status: str,
    reason: str,
) -> None:
    of, clock, script, asked = program(), Clock(), iter(rounds), list[int]()
    first = answer(of, 19.0, 19.0)

    def one_round(search: Any, k: int) -> bool:
        asked.append(k)
        search.starved = starved
        clock.now += seconds
        return next(script)

    monkeypatch.setattr(minlp, "root", lambda *_: first)
    monkeypatch.setattr(minlp, "_round", one_round)
    monkeypatch.setattr(minlp, "with_all_held", lambda *_: answer(of, 25.0, 3.0))
    found = minlp.minlp(of, MethodOptions(8.0, 0.01, clock))
    assert asked == list(range(1, len(rounds) + 1))
    assert (found.objective, found.bound, found.status) == (25.0, 19.0, status)
    assert found.notes == [reason]
