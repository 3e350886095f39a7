"""Whatever a solver answers: a valid answer, or an error of ours that says what is wrong.

Every backend's solver is made to return zeros, a point off its rows, NaN or a bound that is 1000 $
too high, or to raise a foreign exception, at its first, its second or every call, under every
method and dispatcher. What comes out is held against the true optimum, found without faults. By
default a sample is run; `--junitxml FILE -o junit_family=xunit1` keeps what was valid or refused as
the property `outcome`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from itertools import product
from typing import TypeVar

import numpy as np
import pytest

import resilience as rs
from resilience.case import Case
from resilience.dispatch.comb import COMB, comb_plan
from resilience.dispatch.registry import DISPATCHERS
from resilience.errors import CertificateError, ResilienceError, SolverError
from resilience.evaluation.clairvoyant import clairvoyant
from resilience.fragility.outages.scenarios import Scenarios
from resilience.models.backends.highs import Highs
from resilience.simulation.simulate import simulate
from resilience.simulation.trajectory import Trajectory
from resilience.simulation.world import World
from resilience.testing import small_case, small_world
from tests.faults.injection import EXCESS, FAULTS, WHEN, inject, inject_master
from tests.unit.dispatch import blackouts

T = TypeVar("T")
Recorder = Callable[[str, object], None]

SOLVERS_OF = {
    "lp": ["HiGHS"],
    "milp": ["HiGHS"],
    "socp": ["Clarabel"],
    "nlp": ["Clarabel", "Ipopt"],
    "minlp": ["HiGHS", "Clarabel", "Ipopt"],
    "exact": ["Clarabel", "Ipopt", "SCIP"],
    "extensive": ["HiGHS"],
    "lshaped": ["HiGHS", "master"],
}
PLANS = [
    (method, solver, fault, when)
    for method, solvers in SOLVERS_OF.items()
    for solver, fault, when in product(solvers, FAULTS, WHEN)
]
DISPATCHED = list(product(DISPATCHERS, FAULTS, WHEN))
SAMPLED = 7  # every seventh is run by default; no length of an axis above divides by it


def sampled(cases: Sequence[tuple[str, ...]]) -> list[object]:
    """All of them, those that are not in the sample marked exhaustive."""
    whole = pytest.mark.exhaustive
    return [
        pytest.param(*case, marks=() if k % SAMPLED == 3 else whole, id="-".join(case))
        for k, case in enumerate(cases)
    ]


@cache
def island() -> Case:
    """Two buses, of which the second is cut off for an hour: storage and a committed generator."""
    return small_case(
        slots=4,
        buses=2,
        lines=[(1, 2, 0.02, 0.03)],
        profiles={"load": [0.7, 0.9, 0.8, 0.6], "price": [1.1, 1.7, 2.3, 0.9]},
        outages=["1-2@02:00-03:00"],
        terminal_value_per_mwh=0.6,
        load=[{"bus": "2", "p_max_mw": 1.3, "profile": "load", "shed_cost_per_mwh": 12.0}],
        pv=[{"bus": "2", "p_max_mw": 0.4}],
        ess=[{"bus": "2", "p_max_mw": 0.5, "e_mwh": 1.2, "soc_initial": 0.45,
              "efficiency_charge": 0.95, "efficiency_discharge": 0.92}],
        generator=[{"bus": "2", "p_min_mw": 0.3, "p_max_mw": 0.7, "cost_per_mwh": 3.0,
                    "start_cost": 0.25}],
        grid=[{"import_max_mw": 2.5, "import_cost_per_mwh": 1.5, "price_profile": "price"}],
    )  # fmt: skip


@cache
def storms() -> Scenarios:
    down = np.zeros((1, 4, 3), bool)
    down[0, 2:3, 1] = down[0, 1:4, 2] = True
    return Scenarios(("1-2",), down, np.array([0.5, 0.3, 0.2]))


def planned(method: str) -> rs.Plan | rs.ScenarioPlan:
    """The plan of a method, or of `stochastic` by an algorithm."""
    if method in ("extensive", "lshaped"):
        without_generator = island().replace(outages=(), generator=())
        return rs.solve(without_generator, "stochastic", scenarios=storms(), algorithm=method)
    return rs.solve(island(), method)


def attempt(answer: Callable[[], T]) -> tuple[T | None, ResilienceError | None]:
    """An answer, or the error of ours in its place; what is not ours is not caught."""
    try:
        return answer(), None
    except ResilienceError as error:
        return None, error


@cache
def true_plan(method: str) -> rs.Plan | rs.ScenarioPlan:
    return planned(method)


def valid(plan: rs.Plan | rs.ScenarioPlan, truth: rs.Plan | rs.ScenarioPlan) -> None:
    """Holds a plan against the true one: its bound below, and what is satisfied not below that."""
    room = 1e-5 * abs(truth.objective)
    assert truth.bound is not None
    assert np.isfinite(plan.objective)
    if plan.bound is not None:
        assert plan.bound <= truth.objective + room
    assert plan.objective >= truth.bound - room
    if plan.status == "optimal":
        assert plan.objective <= truth.objective + 2e-3 * abs(truth.objective)
    if not plan.relaxed:
        assert max(plan.audit.values()) <= 1e-5


@pytest.mark.parametrize(("method", "solver", "fault", "when"), sampled(PLANS))
def test_a_plan_is_valid_or_refused(
    monkeypatch: pytest.MonkeyPatch,
    record_property: Recorder,
    method: str,
    solver: str,
    fault: str,
    when: str,
) -> None:
    if method == "exact":
        pytest.importorskip("pyscipopt", reason="the extra `exact` is not installed")
    truth = true_plan(method)
    if solver == "master":
        counter = inject_master(monkeypatch, fault, when)
    else:
        counter = inject(monkeypatch, solver, fault, when)
    plan, error = attempt(lambda: planned(method))
    record_property("outcome", "refused" if plan is None else "valid")
    if plan is not None:
        valid(plan, truth)
        return
    assert counter.faults or fault == "high bound", error
    if fault in ("raising", "no numbers"):
        assert isinstance(error, SolverError)
        assert ("HiGHS" if solver == "master" else solver) in str(error)


def dispatched(world: World, name: str) -> Trajectory:
    return simulate(world, DISPATCHERS[name](world.setting))


def place(name: str) -> World:
    """Where a dispatcher acts: a comb knows blackouts alone."""
    return blackouts.world() if name == COMB else small_world()


@cache
def true_bound(name: str) -> np.ndarray:
    return clairvoyant(place(name)).objective


@pytest.fixture
def no_plan_kept() -> Iterator[None]:
    """Plans that are kept from call to call are made under the fault, and die with it."""
    comb_plan.cache_clear()
    yield
    comb_plan.cache_clear()


@pytest.mark.usefixtures("no_plan_kept")
@pytest.mark.parametrize(("name", "fault", "when"), sampled(DISPATCHED))
def test_a_trajectory_is_valid_or_refused(
    monkeypatch: pytest.MonkeyPatch, record_property: Recorder, name: str, fault: str, when: str
) -> None:
    """A wrong answer within a dispatcher makes a worse policy: what it did is valid all the same,
    by the referee of trajectories, and costs no less than the bound.
    """
    world, bound = place(name), true_bound(name)
    inject(monkeypatch, "HiGHS", fault, when)
    inject_master(monkeypatch, fault, when)
    for k, least in enumerate(bound):
        episode = world.with_scenarios(np.array([k]))
        run, error = attempt(partial(dispatched, episode, name))
        record_property("outcome", "refused" if run is None else "valid")
        if run is None:
            assert isinstance(error, SolverError)
        else:
            assert run.objective(world.end_value_per_mwh)[0] >= least - 1e-6


@pytest.mark.parametrize(("fault", "when"), sampled(list(product(FAULTS, WHEN))))
def test_a_comparison_is_valid_or_refused(
    monkeypatch: pytest.MonkeyPatch, record_property: Recorder, fault: str, when: str
) -> None:
    methods = ["greedy", "mpc-blind"]
    bound = true_bound(methods[0])
    inject(monkeypatch, "HiGHS", fault, when)
    report, error = attempt(lambda: rs.evaluate(small_world(), methods))
    record_property("outcome", "refused" if report is None else "valid")
    if report is None:
        assert isinstance(error, SolverError)
        return
    assert (report.bound <= bound + 1e-6).all()
    for objective in report.objective.values():
        assert (objective >= bound - 1e-6).all()


def test_a_bound_that_a_method_beats_ends_the_comparison(monkeypatch: pytest.MonkeyPatch) -> None:
    true = Highs.certified_bound

    def too_high(self: Highs, solution: object) -> float:
        return true(self, solution) + EXCESS  # type: ignore[arg-type]

    monkeypatch.setattr(Highs, "certified_bound", too_high)
    with pytest.raises(CertificateError, match=r"costs [\d.-]+ \$ in episode 0, where [\d.]+ \$"):
        rs.evaluate(small_world(), ["greedy"])


@pytest.mark.parametrize("method", ["lp", "milp", "extensive"])
def test_a_certified_bound_that_is_too_high_ends_a_plan(
    monkeypatch: pytest.MonkeyPatch, method: str
) -> None:
    true = Highs.certified_bound
    monkeypatch.setattr(Highs, "certified_bound", lambda self, s: true(self, s) + EXCESS)
    with pytest.raises(CertificateError, match="fault of the program or of the solver"):
        planned(method)


@pytest.mark.parametrize(("method", "solver"), [("lp", "HiGHS"), ("socp", "Clarabel")])
def test_rows_alone_are_enough_to_refuse_a_plan(
    monkeypatch: pytest.MonkeyPatch, method: str, solver: str
) -> None:
    """Where the energy left is worth nothing, costs and bound of a shifted point are the true."""
    case = island().replace(terminal_value_per_mwh=0.0, generator=(), outages=())
    inject(monkeypatch, solver, "shifted", "every")
    with pytest.raises(CertificateError, match=r"violates [a-z.]+\[.* by 0\.\d+ \(scaled"):
        rs.solve(case, method)
