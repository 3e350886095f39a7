"""What has no plan is refused with the names of the rows and slots in conflict."""

from datetime import datetime

import pytest

from resilience.case import Case
from resilience.case.document import Document
from resilience.case.load import build_case
from resilience.errors import InfeasibleError, UsageError
from resilience.models.case_program import horizon
from resilience.testing import small_case
from tests.known.solving import solved

GRID = {"import_max_mw": 10.0, "import_cost_per_mwh": 1.0}


def forced_feed_in() -> object:
    """3 MW that must be taken at the end of a line, and only from 01:00 on; v_2 <= 1.05 pu."""
    return small_case(
        slots=2,
        buses=2,
        lines=[(1, 2, 0.03, 0.03)],
        voltage_band_pu=(0.9, 1.05),
        profiles={"sun": [0.2, 1.0]},
        grid=[GRID | {"export_max_mw": 10.0}],
        pv=[{"bus": "2", "p_max_mw": 3.0, "curtailable": False, "profile": "sun"}],
    )


@pytest.mark.parametrize("method", ["lp", "milp", "socp", "nlp", "minlp"])
def test_a_voltage_that_must_rise_too_far(method: str) -> None:
    with pytest.raises(InfeasibleError) as error:
        solved(forced_feed_in(), method)  # type: ignore[arg-type]
    text = str(error.value)
    assert "bus.v_sq[2, 01:00]" in text or "line.voltage[1-2, 01:00]" in text
    assert "00:00" not in text
    assert "hint:" in text


def test_scip_names_them_too() -> None:
    pytest.importorskip("pyscipopt", reason="the extra `exact` is not installed")
    with pytest.raises(InfeasibleError, match=r"\[1-2, 01:00\]|\[2, 01:00\]"):
        solved(forced_feed_in(), "exact")  # type: ignore[arg-type]


@pytest.mark.parametrize("method", ["lp", "milp", "minlp"])
def test_a_unit_that_may_not_stop_yet(method: str) -> None:
    """At least 2 MW for another hour, 1 MW of load, and nowhere to put the rest."""
    unit = {"p_min_mw": 2.0, "p_max_mw": 3.0, "cost_per_mwh": 1.0, "min_up_h": 2.0}
    case = small_case(
        slots=2,
        load=[{"p_max_mw": 1.0, "shed_cost_per_mwh": 5.0}],
        generator=[unit | {"initial_on": True, "initial_hours": 1.0, "p_initial_mw": 2.0}],
    )
    with pytest.raises(InfeasibleError, match=r"generator[.\w]*\[generator1, 00:00\]"):
        solved(case, method, "copperplate")


def case14() -> Case:
    """The IEEE 14-bus network, which is meshed."""
    return build_case(
        Document(
            None,
            {
                "network": {"pandapower": "case14"},
                "time": {"start": datetime(2016, 7, 12), "slots": 1, "step_min": 60.0},
                "grid": [{"bus": "1", "import_max_mw": 3.0, "import_cost_per_mwh": 1.0}],
                "load": [{"name": "load", "bus": "9", "p_max_mw": 2.0, "shed_cost_per_mwh": 9.0}],
            },
        )
    )


@pytest.mark.parametrize("physics", ["lindistflow", "distflow"])
def test_a_meshed_network_is_refused_with_the_names_of_a_cycle(physics: str) -> None:
    """Where a line may be switched, the others have to be radial."""
    case = case14().with_line("7-9", switchable=True)
    with pytest.raises(UsageError) as error:
        horizon(case, physics)  # type: ignore[arg-type]
    named = str(error.value).partition("cycle: ")[2].partition("\n")[0].split(", ")
    network = case.network
    ends: dict[int, int] = {}
    for name in named:
        k = network.line(name)
        for bus in (network.from_bus[k], network.to_bus[k]):
            ends[bus] = ends.get(bus, 0) + 1
    assert len(named) >= 3
    assert set(ends.values()) == {2}


def test_a_meshed_network_can_be_a_copperplate() -> None:
    assert solved(case14(), "lp", "copperplate").objective == pytest.approx(2.0)


@pytest.mark.parametrize("method", ["lp", "milp"])
def test_linear_methods_refuse_cones(method: str) -> None:
    with pytest.raises(UsageError, match="allowed: copperplate, lindistflow"):
        solved(forced_feed_in(), method, "distflow")  # type: ignore[arg-type]
