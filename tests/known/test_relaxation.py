"""Where binaries are really needed: the paper's "MINLP" without network is mostly its LP.

Storage that charges and discharges at once turns energy into heat. It pays only where a MWh too
many does harm: must-take PV on an island with full storage, or an export that costs. There, and
only there, `lp` adds binaries.
"""

import numpy as np
import pytest

from resilience.case import Case, load_case
from resilience.errors import InfeasibleError, SolverError
from resilience.testing import small_case
from tests.known.solving import Solved, solved

LOSSY = {"efficiency_charge": 0.95, "efficiency_discharge": 0.95}
PAPER = {"efficiency_charge": 0.999, "efficiency_discharge": 1 / 1.001}
DEGRADATION = 0.2
# Forms the island whatever is decided, and is too dear to run: the island is never left dark.
FORMING = {"p_max_mw": 0.3, "cost_per_mwh": 9.0}


def island(
    surplus_mw: float,
    efficiency: dict,
    *,
    full: bool = True,
    curtail: bool = False,
    forming: bool = True,
) -> Case:
    """1 MW of load, PV of a little more, storage of 2 MW and 4 MWh; 4 h."""
    storage = {
        "p_max_mw": 2.0,
        "e_mwh": 4.0,
        "soc_initial": 1.0 if full else 0.5,
        "degradation_cost_per_mwh": DEGRADATION,
    }
    return small_case(
        slots=4,
        load=[{"p_max_mw": 1.0, "shed_cost_per_mwh": 1.5}],
        pv=[{"p_max_mw": 1.0 + surplus_mw, "curtailable": curtail}],
        ess=[storage | efficiency],
        generator=[FORMING] if forming else [],
    )


def modes(found: Solved) -> int:
    """Mode binaries that were needed."""
    texts = [n for n in found.answer.notes if "mode binaries" in n]
    return int(texts[0].split()[0]) if texts else 0


@pytest.mark.parametrize("outages", ["", None])
def test_the_papers_minlp_without_network_is_its_lp(outages: str | None) -> None:
    case = load_case("ieee33") if outages is None else load_case("ieee33").replace(outages=outages)
    lp = solved(case, "lp", "copperplate")
    assert modes(lp) == 0
    assert not lp.answer.relaxed
    for method in ("milp", "minlp"):
        other = solved(case, method, "copperplate")
        assert other.objective == pytest.approx(lp.objective, rel=1e-6)
        assert not other.answer.relaxed


def test_cycling_burns_what_a_full_island_must_take() -> None:
    """c - d = 0.05 MW of surplus vanish at 0.95 c = d / 0.95: d = 0.05 * 0.9025 / 0.0975."""
    found = solved(island(0.05, LOSSY), "socp", "copperplate")
    discharge = 0.05 * 0.95**2 / (1 - 0.95**2)
    assert found["ess.discharge"].sum() == pytest.approx(4 * discharge, rel=1e-5)
    assert found.objective == pytest.approx(4 * DEGRADATION * discharge, rel=1e-6)
    (fact,) = found.answer.relaxed
    text, size = fact.removesuffix(" at most").rsplit(" by ", 1)
    assert text == "ess: 4 of 4 mode elements are in two modes at once,"
    assert 0.9 * discharge / (1 + 2.0) <= float(size) <= 2.0 / (1 + 2.0)  # 2 MW either way


@pytest.mark.parametrize("method", ["lp", "milp", "minlp", "nlp"])
def test_a_full_island_with_must_take_pv_has_no_plan(method: str) -> None:
    with pytest.raises(InfeasibleError) as error:
        solved(island(0.05, LOSSY), method, "copperplate")
    assert "balance.p[1, 00:00" in str(error.value)
    assert "ess.dynamics[ess1, 00:00" in str(error.value)
    assert "make PV curtailable" in error.value.hint


def test_ipopt_says_so_where_held_modes_leave_it_nothing() -> None:
    """The relaxation charges and discharges at once; held to one of both, the surplus is left."""
    with pytest.raises(SolverError, match="Ipopt found no plan, though the linear relaxation has"):
        solved(island(0.05, LOSSY, forming=False), "nlp", "copperplate")


@pytest.mark.parametrize("method", ["lp", "milp", "minlp", "exact"])
def test_a_full_island_that_only_its_storage_forms_is_left_dark(method: str) -> None:
    """The surplus has nowhere to go: the sun is spilled and 1 MW is shed for 4 h at 1.5 $/MWh."""
    found = solved(island(0.05, LOSSY, forming=False), method, "copperplate")
    assert found.objective == pytest.approx(6.0, rel=1e-6)
    assert found.bound == pytest.approx(6.0, rel=1e-6)
    assert found["pv.p"].max() == pytest.approx(0.0, abs=1e-6)
    assert not found.answer.relaxed


@pytest.mark.parametrize(("surplus_mw", "burns"), [(0.0039, True), (0.0041, False)])
def test_the_papers_efficiencies_burn_two_per_mille_of_the_rating(
    surplus_mw: float, burns: bool
) -> None:
    """2 MW in and 2 * 0.999 / 1.001 MW out leave 0.003996 MW; a wider surplus needs no binary."""
    case = island(surplus_mw, PAPER)
    if burns:
        assert solved(case, "socp", "copperplate").answer.relaxed
    else:
        with pytest.raises(InfeasibleError):
            solved(case, "socp", "copperplate")
    with pytest.raises(InfeasibleError):
        solved(case, "lp", "copperplate")


@pytest.mark.parametrize("efficiency", [LOSSY, PAPER])
def test_a_curtailable_island_needs_no_binary(efficiency: dict) -> None:
    lp, milp = (
        solved(island(0.5, efficiency, curtail=True), m, "copperplate") for m in ("lp", "milp")
    )
    assert lp.objective == pytest.approx(0.0, abs=1e-9) == milp.objective
    assert modes(lp) == 0
    assert lp["pv.p"].sum() == pytest.approx(4.0)


@pytest.mark.parametrize("efficiency", [LOSSY, PAPER])
def test_room_in_the_storage_needs_no_binary(efficiency: dict) -> None:
    found = solved(island(0.05, efficiency, full=False), "lp", "copperplate")
    assert modes(found) == 0
    stored = 2.0 + 4 * 0.05 * efficiency["efficiency_charge"]
    assert found["ess.energy"][0, -1] == pytest.approx(stored)
    assert found.objective == pytest.approx(0.0, abs=1e-9)


def dear_export() -> Case:
    """1 MW of must-take PV for an hour, full storage without wear, export at 1 $/MWh."""
    return small_case(
        slots=1,
        pv=[{"p_max_mw": 1.0, "curtailable": False}],
        ess=[{"p_max_mw": 2.0, "e_mwh": 4.0, "soc_initial": 1.0}
             | {"efficiency_charge": 0.9, "efficiency_discharge": 0.9}],
        grid=[{"import_max_mw": 5.0, "export_max_mw": 5.0, "import_cost_per_mwh": 1.0}
              | {"export_cost_per_mwh": 1.0}],
    )  # fmt: skip


def test_binaries_are_added_where_cycling_would_pay() -> None:
    """Relaxed, 2 MW in and 1.62 MW out burn 0.38 MW and 0.62 MW is exported; in truth 1 MW is."""
    relaxed = solved(dear_export(), "socp", "copperplate")
    assert relaxed.objective == pytest.approx(0.62, rel=1e-6)
    assert relaxed.answer.relaxed
    for method in ("lp", "milp", "minlp"):
        found = solved(dear_export(), method, "copperplate")
        assert found.objective == pytest.approx(1.0, rel=1e-6)
        assert found.bound == pytest.approx(1.0, rel=1e-6)
        assert not found.answer.relaxed
    assert modes(solved(dear_export(), "lp", "copperplate")) >= 1


@pytest.mark.parametrize("method", ["lp", "milp", "minlp"])
def test_export_paid_above_import_is_no_money_machine(method: str) -> None:
    """Buying at 0.3 and selling at 0.5 in the same hour would earn 0.2 * 5; a connection cannot."""
    grid = {"import_max_mw": 5.0, "export_max_mw": 5.0, "import_cost_per_mwh": 0.3}
    case = small_case(
        slots=2,
        load=[{"p_max_mw": 1.0, "shed_cost_per_mwh": 1.5}],
        grid=[grid | {"export_cost_per_mwh": -0.5}],
    )
    found = solved(case, method, "copperplate")
    assert found.objective == pytest.approx(0.6, rel=1e-6)
    assert found["grid.export"].max() == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("efficiency", [LOSSY, PAPER])
def test_a_negative_import_price_needs_no_binary_while_curtailing_is_free(efficiency: dict) -> None:
    grid = {"import_max_mw": 5.0, "import_cost_per_mwh": 1.0, "price_profile": "price"}
    case = small_case(
        slots=4,
        profiles={"price": [-0.1, -0.1, 0.3, 0.3]},
        load=[{"p_max_mw": 1.0, "shed_cost_per_mwh": 1.5}],
        ess=[{"p_max_mw": 2.0, "e_mwh": 4.0, "degradation_cost_per_mwh": 0.2} | efficiency],
        grid=[grid],
    )
    lp, milp = (solved(case, m, "copperplate") for m in ("lp", "milp"))
    assert lp.objective == pytest.approx(milp.objective, rel=1e-9)
    assert lp["ess.energy"][0, 1] == pytest.approx(4.0)


def test_no_plan_has_both_modes_at_once() -> None:
    for method in ("lp", "milp", "minlp"):
        found = solved(load_case("analytic/arbitrage"), method, "copperplate")
        assert np.minimum(found["ess.charge"], found["ess.discharge"]).max() < 1e-6
        assert np.minimum(found["grid.import"], found["grid.export"]).max() < 1e-6
