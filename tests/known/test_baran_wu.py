"""Baran and Wu's 33-bus feeder: base case, and the reconfiguration of least loss.

Published: 202.68 kW and 0.9131 pu with the ties open; 139.55 kW with lines 7, 9, 14, 32, 37 open.
"""

import numpy as np
import pytest

from resilience.case.document import Document
from resilience.case.load import build_case
from tests.known.feeder33 import (
    BASE_OPEN,
    BEST_OPEN,
    LOAD_MW,
    TREES,
    all_trees,
    case33,
    exchanges,
    feeder,
    losses_kw,
    net,
)
from tests.known.solving import Solved, solved, watch_that_is_late

OPTIMUM_KW = 139.55135


def loss_kw(found: Solved) -> float:
    return 1e3 * (float(found["grid.import"].sum()) - LOAD_MW)


def opened(found: Solved) -> tuple[int, ...]:
    """Open lines, numbered as in the literature."""
    return tuple(int(k) + 1 for k in np.flatnonzero(found["line.closed"][:, 0] < 0.5))


def test_line_names_are_in_the_order_of_the_literature() -> None:
    names = case33().network.line_names
    assert names == tuple(f"{i + 1}-{j + 1}" for i, j in feeder().ends)
    assert [names[k - 1] for k in BEST_OPEN] == ["7-8", "9-10", "14-15", "32-33", "25-29"]
    assert [names[k - 1] for k in BASE_OPEN] == ["21-8", "9-15", "12-22", "18-33", "25-29"]


@pytest.mark.parametrize("method", ["socp", "nlp", "minlp"])
def test_base_case(method: str) -> None:
    found = solved(case33(), method)
    voltage = np.sqrt(found["bus.v_sq"][:, 0])
    assert loss_kw(found) == pytest.approx(202.677, abs=1e-3)
    assert voltage.min() == pytest.approx(0.91309, abs=1e-5)
    assert case33().network.bus_names[voltage.argmin()] == "18"
    assert 1e3 * (found.bound - LOAD_MW) == pytest.approx(202.677, abs=1e-3)


def test_base_case_is_what_pandapower_finds() -> None:
    import pandapower

    pandapower.runpp(net(), numba=False, tolerance_mva=1e-10)
    found = solved(case33(), "nlp")
    assert loss_kw(found) == pytest.approx(1e3 * net().res_line.pl_mw.sum(), abs=1e-3)
    vm = np.sqrt(found["bus.v_sq"][:, 0])
    assert vm == pytest.approx(net().res_bus.vm_pu.to_numpy(), abs=1e-6)
    losses, lowest = losses_kw([BASE_OPEN])
    assert losses[0] == pytest.approx(1e3 * net().res_line.pl_mw.sum(), abs=1e-5)
    assert lowest[0] == pytest.approx(net().res_bus.vm_pu.min(), abs=1e-8)


def test_lindistflow_neglects_the_losses() -> None:
    found = solved(case33(), "lp")
    assert found.objective == pytest.approx(LOAD_MW)
    v = np.sqrt(found["bus.v_sq"][:, 0])
    assert 0.91309 < v.min() < 0.93


def test_no_single_branch_exchange_improves_the_optimum() -> None:
    neighbours = exchanges(BEST_OPEN)
    losses, lowest = losses_kw(neighbours)
    order = np.argsort(losses)
    assert len(neighbours) == 54
    assert neighbours[order[0]] == BEST_OPEN
    assert losses[order[0]] == pytest.approx(OPTIMUM_KW, abs=1e-5)
    assert lowest[order[0]] == pytest.approx(0.93782, abs=1e-5)
    assert neighbours[order[1]] == (7, 9, 14, 28, 32)
    assert losses[order[1]] == pytest.approx(139.978, abs=1e-3)


@pytest.mark.exhaustive
def test_no_tree_at_all_improves_the_optimum() -> None:
    trees = all_trees()
    losses, _ = losses_kw(trees)
    assert len(trees) == TREES
    assert trees[np.argmin(losses)] == BEST_OPEN
    assert losses.min() == pytest.approx(OPTIMUM_KW, abs=1e-5)


@pytest.mark.parametrize("method", ["minlp", "exact"])
def test_branch_and_bound_proves_the_optimum(method: str) -> None:
    """To 1e-5 of load and losses, and to a thousandth of the losses where they are all that counts:
    the second best tree loses three times as much more."""
    if method == "exact":
        pytest.importorskip("pyscipopt", reason="the extra `exact` is not installed")
    found = solved(case33(switchable=True), method, time_limit=600, gap=1e-5)
    assert found.answer.status == "optimal"
    assert opened(found) == BEST_OPEN
    assert loss_kw(found) == pytest.approx(OPTIMUM_KW, rel=1e-5)
    assert 1e3 * (found.bound - LOAD_MW) == pytest.approx(OPTIMUM_KW, rel=5e-4)
    document = case33(switchable=True).source | {"loss_cost_per_mwh": 1.0}
    document["grid"] = [document["grid"][0] | {"import_cost_per_mwh": 0.0}]
    of_losses = solved(build_case(Document(None, document)), method, time_limit=600, gap=1e-3)
    assert opened(of_losses) == BEST_OPEN
    assert 1e3 * of_losses.objective == pytest.approx(OPTIMUM_KW, rel=1e-5)
    assert 1e3 * of_losses.bound == pytest.approx(OPTIMUM_KW, rel=1e-3)


def test_minlp_in_a_hurry_stays_honest(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = watch_that_is_late(monkeypatch)
    found = solved(case33(switchable=True), "minlp", time_limit=0.25, clock=clock)
    losses, _ = losses_kw([opened(found)])
    assert found.answer.status == "feasible"
    assert "best plan found" in " ".join(found.answer.notes)
    assert not found.answer.relaxed
    assert loss_kw(found) == pytest.approx(losses[0], abs=1e-2)
    assert found.bound <= LOAD_MW + OPTIMUM_KW / 1e3 <= found.objective + 1e-8


@pytest.mark.parametrize("method", ["lp", "milp"])
def test_without_losses_every_tree_is_as_good(method: str) -> None:
    found = solved(case33(switchable=True), method)
    assert found.objective == pytest.approx(LOAD_MW)
    assert np.isfinite(losses_kw([opened(found)])[0][0])
