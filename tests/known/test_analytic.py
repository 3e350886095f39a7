"""The cases in `cases/analytic`: each file derives its optimum by hand, here it must come out."""

import numpy as np
import pytest

from resilience.case import case_names, load_case
from tests.known.solving import Solved, solved

OPTIMA = {
    "discharge-island": 0.2 * 2.4 / 1.001 + 1.5 * (4 - 2.4 / 1.001),
    "precharge": 0.3 * (2 + 2 * 1.001 / 0.999) + 0.2 * 2,
    "generator-undercuts": 1.6,
    "drain": 0.2 * 2.4 / 1.001 + 0.3 * (4 - 2.4 / 1.001),
    "arbitrage": 10 * 4 / 0.9 - 50 * 4 * 0.9,
    "two-islands": 4.52,
}
PUBLISHED = {
    "discharge-island": 2.883116883,
    "precharge": 1.601201201,
    "generator-undercuts": 1.6,
    "drain": 0.960239760,
    "arbitrage": -135.5556,
}


def plan(name: str, method: str, physics: str | None = None) -> Solved:
    return solved(load_case(f"analytic/{name}"), method, physics)  # type: ignore[arg-type]


def test_every_analytic_case_is_tested() -> None:
    names = {n.partition("/")[2] for n in case_names() if n.startswith("analytic/")}
    assert names == set(OPTIMA)


@pytest.mark.parametrize("name", PUBLISHED)
def test_closed_forms_are_the_published_figures(name: str) -> None:
    assert OPTIMA[name] == pytest.approx(PUBLISHED[name], abs=5e-5 if name == "arbitrage" else 1e-9)


@pytest.mark.parametrize("name", OPTIMA)
@pytest.mark.parametrize("physics", ["copperplate", "lindistflow"])
@pytest.mark.parametrize("method", ["lp", "milp"])
def test_linear_methods(name: str, method: str, physics: str) -> None:
    found = plan(name, method, physics)
    assert found.objective == pytest.approx(OPTIMA[name], rel=1e-9)
    assert found.bound == pytest.approx(OPTIMA[name], rel=1e-9)
    assert found.answer.status == "optimal"
    assert not found.answer.relaxed
    assert found.answer.bound_of == physics


@pytest.mark.parametrize("name", OPTIMA)
@pytest.mark.parametrize("physics", ["copperplate", "distflow"])
@pytest.mark.parametrize("method", ["socp", "nlp", "minlp"])
def test_conic_methods(name: str, method: str, physics: str) -> None:
    found = plan(name, method, physics)
    assert found.objective == pytest.approx(OPTIMA[name], rel=1e-6)
    assert found.bound == pytest.approx(OPTIMA[name], rel=1e-6)
    assert found.bound <= OPTIMA[name] + 1e-9 * abs(OPTIMA[name])
    if method == "minlp":
        assert not found.answer.relaxed


@pytest.mark.parametrize("name", OPTIMA)
def test_scip(name: str) -> None:
    pytest.importorskip("pyscipopt", reason="the extra `exact` is not installed")
    assert plan(name, "exact").objective == pytest.approx(OPTIMA[name], rel=1e-6)


def test_an_empty_storage_is_charged_before_the_outage_and_no_later() -> None:
    found = plan("precharge", "lp")
    charge, discharge = found["ess.charge"][0] / 4, found["ess.discharge"][0] / 4
    assert charge[:8].sum() == pytest.approx(2 * 1.001 / 0.999)
    assert discharge[8:].sum() == pytest.approx(2.0)
    assert found["load.shed"].sum() == pytest.approx(0.0)


def test_a_cheaper_generator_leaves_the_storage_alone() -> None:
    found = plan("generator-undercuts", "lp")
    assert found["ess.charge"].sum() == pytest.approx(0.0, abs=1e-9)
    assert found["generator.p"].sum() / 4 == pytest.approx(2.0)


def test_a_look_ahead_without_terminal_value_ends_empty() -> None:
    assert plan("drain", "lp")["ess.energy"][0, -1] == pytest.approx(0.1 * 6)


def test_a_terminal_value_above_the_grid_price_refills_instead() -> None:
    case = load_case("analytic/drain").replace(terminal_value_per_mwh=0.35)
    found = solved(case, "lp")
    assert found["ess.energy"][0, -1] == pytest.approx(0.9 * 6)
    bought = 4 + 0.4 * 6 / 0.999
    assert found.objective == pytest.approx(0.3 * bought - 0.35 * 0.9 * 6, rel=1e-9)


def test_the_islands_do_not_help_each_other() -> None:
    found = plan("two-islands", "lp")
    assert found.of("load.shed", "homes").sum() == pytest.approx(0.4)
    assert found.of("load.shed", "clinic").sum() == pytest.approx(0.0, abs=1e-9)
    assert found.of("generator.p", "generator") == pytest.approx(np.array([0, 0, 1.5, 1.5]))
    assert found.of("ess.charge", "ess") == pytest.approx(np.array([1, 1, 0, 0]))


def test_without_outages_the_two_islands_are_one_grid() -> None:
    case = load_case("analytic/two-islands").replace(outages="")
    assert solved(case, "lp").objective == pytest.approx(0.3 * 4 * 2.5)
