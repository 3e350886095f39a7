"""A grid, a line and a bus: every optimum has a closed form.

Bus "1" is held at 1 pu by the grid, the line has r and x in pu on 1 MVA. At unity power factor and
with P sent from bus 1, P^2 = l and P - r l arrives.
"""

import math
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from resilience.case import Case
from resilience.testing import small_case
from tests.known.solving import solved

R, X = 0.02, 0.04
GRID = {"import_max_mw": 10.0, "export_max_mw": 10.0, "import_cost_per_mwh": 1.0}
SHED = 10.0


def line(r: float = R, x: float = X, rating: float | None = None, **devices: Any) -> Case:
    """One hour; every device but the grid stands at bus 2."""
    about = [] if rating is None else [{"name": "1-2", "rating_mva": rating}]
    band = devices.pop("band", (0.9, 1.1))
    grid = devices.pop("grid", {})
    placed: dict[str, Any] = {
        kind: [{"bus": "2", **t} for t in tables] for kind, tables in devices.items()
    }
    return small_case(
        slots=1,
        buses=2,
        lines=[(1, 2, r, x)],
        line_tables=about,
        voltage_band_pu=band,
        grid=[GRID | grid],
        **placed,
    )


def load(p_max_mw: float, **keys: Any) -> dict[str, Any]:
    return {"p_max_mw": p_max_mw, "shed_cost_per_mwh": SHED, **keys}


@pytest.mark.parametrize("method", ["socp", "nlp", "minlp"])
def test_losses_of_a_load(method: str) -> None:
    """P - r P^2 = 2 MW arrive: P = (1 - sqrt(1 - 8 r)) / (2 r), whatever x takes in Mvar."""
    found = solved(line(x=0.0, load=[load(2.0)]), method)
    sent = (1 - math.sqrt(1 - 4 * R * 2.0)) / (2 * R)
    assert found.objective == pytest.approx(sent, rel=1e-6)
    assert found.bound == pytest.approx(sent, rel=1e-6)
    assert solved(line(x=0.0, load=[load(2.0)]), "lp").objective == pytest.approx(2.0)


def surplus() -> Case:
    """3 MW of must-take PV and no load: all of it is exported, at a price as in the paper's |P|."""
    return line(
        x=0.0,
        pv=[{"p_max_mw": 3.0, "curtailable": False}],
        grid={"export_cost_per_mwh": 1.0},
    )


def test_lindistflow_is_no_bound_where_surplus_costs() -> None:
    """Losses spare the exporter money: E + r E^2 = 3 MW, and E < 3."""
    exported = (math.sqrt(1 + 4 * R * 3.0) - 1) / (2 * R)
    ac, linear = solved(surplus(), "nlp"), solved(surplus(), "lp")
    assert ac.objective == pytest.approx(exported, rel=1e-6)
    assert linear.objective == pytest.approx(3.0)
    assert linear.bound > ac.objective + 0.1
    assert linear.answer.bound_of == "lindistflow"


def test_the_cone_relaxation_is_a_bound_even_there() -> None:
    relaxed, plan = solved(surplus(), "socp"), solved(surplus(), "minlp")
    exported = (math.sqrt(1 + 4 * R * 3.0) - 1) / (2 * R)
    assert relaxed.bound <= relaxed.objective + 1e-9 < exported - 0.1
    assert plan.objective == pytest.approx(exported, rel=1e-6)
    assert plan.bound <= exported
    assert not plan.answer.relaxed
    assert plan.answer.status == "feasible"


def test_scip_closes_the_gap_that_the_relaxation_leaves() -> None:
    pytest.importorskip("pyscipopt", reason="the extra `exact` is not installed")
    exported = (math.sqrt(1 + 4 * R * 3.0) - 1) / (2 * R)
    found = solved(surplus(), "exact")
    assert found.answer.status == "optimal"
    assert found.objective == pytest.approx(exported, rel=1e-5)
    assert found.bound == pytest.approx(exported, rel=1e-5)


def test_lindistflow_is_no_bound_where_an_upper_voltage_binds() -> None:
    """Given what the PV feeds in, losses lower its voltage, so AC lets more in.

    With E = I exported, V_2 = 1 + r I <= 1.05 and E + r E^2 = 2.625 MW, against 2 r P <= 1.05^2 - 1
    and 2.5625 MW.
    """
    case = line(x=0.0, pv=[{"p_max_mw": 4.0, "cost_per_mwh": -1.0}], band=(0.9, 1.05))
    current = 0.05 / R
    fed_in = current + R * current**2
    linear = (1.05**2 - 1) / (2 * R)
    assert solved(case, "lp").objective == pytest.approx(-linear)
    for method in ("nlp", "minlp"):
        assert solved(case, method).objective == pytest.approx(-fed_in, rel=1e-6)
    assert solved(case, "lp").bound > solved(case, "nlp").objective + 0.05
    assert solved(case, "socp").bound <= -fed_in + 1e-6


def test_and_it_is_one_where_neither_does() -> None:
    for mw in (0.5, 2.0, 4.0):
        case = line(load=[load(mw)], pv=[{"p_max_mw": 1.0}])
        linear, ac = solved(case, "lp"), solved(case, "nlp")
        assert linear.bound <= ac.objective + 1e-8


def served(found: Any) -> float:
    return float(found.problem.data["load.demand"].sum() - found["load.shed"].sum())


TAN = math.tan(math.acos(0.9))
PF = {"power_factor": 0.9}
V_MIN = 0.95


@pytest.mark.parametrize("method", ["lp", "milp", "minlp"])
def test_a_low_voltage_limits_what_is_served(method: str) -> None:
    """LinDistFlow: 2 (r + x tan phi) P <= 1 - V_min^2."""
    case = line(load=[load(3.0, **PF)], band=(V_MIN, 1.1))
    found = solved(case, method, "lindistflow")
    most = (1 - V_MIN**2) / (2 * (R + X * TAN))
    assert served(found) == pytest.approx(most, rel=1e-6)
    assert found.objective == pytest.approx(most + SHED * (3.0 - most), rel=1e-6)


@pytest.mark.parametrize("kind", ["pv", "ess", "generator"])
def test_reactive_power_at_the_far_end_serves_more(kind: str) -> None:
    """0.4 Mvar there take 0.4 x off the drop: P = ((1 - V_min^2) / 2 + 0.4 x) / (r + x tan phi)."""
    units: dict[str, dict[str, Any]] = {
        "pv": {"p_max_mw": 0.4, "s_mva": 0.4, "profile": "dark"},
        "ess": {"p_max_mw": 0.4, "e_mwh": 1.0, "soc_initial": 0.0, "s_mva": 0.4},
        "generator": {"p_max_mw": 0.0, "q_max_mvar": 0.4},
    }
    devices: dict[str, Any] = {kind: [{"bus": "2", **units[kind]}]}
    case = small_case(
        slots=1,
        buses=2,
        lines=[(1, 2, R, X)],
        profiles={"dark": [0.0]},
        voltage_band_pu=(V_MIN, 1.1),
        grid=[GRID],
        load=[{"bus": "2", **load(3.0, **PF)}],
        **devices,
    )
    most = ((1 - V_MIN**2) / 2 + 0.4 * X) / (R + X * TAN)
    found = solved(case, "lp")
    assert served(found) == pytest.approx(most, rel=1e-6)
    assert found[f"{kind}.q"].sum() == pytest.approx(0.4, rel=1e-6)


def test_a_unit_without_rating_keeps_to_unity_power_factor() -> None:
    case = line(load=[load(3.0, **PF)], pv=[{"p_max_mw": 0.4}], band=(V_MIN, 1.1))
    assert not solved(case, "lp").problem.standard.has("pv.q")


def test_a_low_voltage_limits_what_is_served_under_ac() -> None:
    """With P and Q arriving, v^2 + (2 (r P + x Q) - 1) v + (r^2 + x^2)(P^2 + Q^2) = 0."""

    def excess(p: float) -> float:
        v, q = V_MIN**2, p * TAN
        return v**2 + (2 * (R * p + X * q) - 1) * v + (R**2 + X**2) * (p**2 + q**2)

    most = brentq(excess, 0.0, 3.0)
    case = line(load=[load(3.0, **PF)], band=(V_MIN, 1.1))
    for method in ("socp", "nlp", "minlp"):
        assert served(solved(case, method)) == pytest.approx(most, rel=1e-5)
    assert most < (1 - V_MIN**2) / (2 * (R + X * TAN))


def test_a_rating_holds_the_apparent_power() -> None:
    """P^2 (1 + tan^2 phi) <= S^2: 2 MVA carry 1.8 MW at a power factor of 0.9."""
    case = line(rating=2.0, load=[load(3.0, **PF)])
    exact = 1.8 + SHED * 1.2
    assert solved(case, "minlp", "lindistflow").objective == pytest.approx(exact, rel=1e-6)
    assert served(solved(case, "minlp", "lindistflow")) == pytest.approx(1.8, rel=1e-6)


@pytest.mark.parametrize("method", ["lp", "milp"])
def test_linear_methods_reach_it_by_tangents(method: str) -> None:
    """Polygons of twelve sides alone would leave up to 3.5 % between plan and bound."""
    case = line(rating=2.0, load=[load(3.0, **PF)])
    found, optimum = solved(case, method), 1.8 + SHED * 1.2
    assert found.bound <= optimum * (1 + 1e-7)
    assert found.objective == pytest.approx(optimum, rel=1e-6)
    assert found.bound == pytest.approx(optimum, rel=1e-6)
    hasty = solved(case, method, gap=0.05)
    assert hasty.bound <= optimum <= hasty.objective
    assert hasty.objective > optimum * 1.001
    assert not hasty.answer.relaxed


def test_a_compensated_load_may_use_the_whole_rating() -> None:
    """With its reactive power made on the spot, 2 MVA carry 2 MW."""
    unit = {"p_max_mw": 0.0, "q_max_mvar": 5.0}
    case = line(rating=2.0, load=[load(3.0, **PF)], generator=[unit])
    assert served(solved(case, "lp")) == pytest.approx(2.0, rel=1e-6)


@pytest.mark.parametrize("method", ["socp", "nlp", "minlp"])
def test_a_rating_holds_at_both_ends(method: str) -> None:
    """2 MVA sent, 2 - 4 r arrive; and the other way round what is fed in is the larger end."""
    found = solved(line(x=0.0, rating=2.0, load=[load(3.0)]), method)
    assert served(found) == pytest.approx(2.0 - 4 * R, rel=1e-5)
    case = line(
        x=0.0, rating=2.0, pv=[{"p_max_mw": 3.0}], grid={"export_cost_per_mwh": -0.5}
    )  # fmt: skip
    back = solved(case, method)
    assert back["pv.p"].sum() == pytest.approx(2.0, rel=1e-5)


def test_copperplate_knows_ratings_but_no_voltage() -> None:
    case = line(rating=2.0, load=[load(3.0, **PF)], band=(0.99, 1.1))
    assert served(solved(case, "lp", "copperplate")) == pytest.approx(2.0)
    unrated = line(load=[load(3.0, **PF)], band=(0.99, 1.1))
    assert served(solved(unrated, "lp", "copperplate")) == pytest.approx(3.0)
    assert served(solved(unrated, "lp")) < 1.0


def test_transformers_without_resistance_keep_their_cones_closed() -> None:
    """Pure reactance costs nothing but Mvar, which nobody pays for; the plan still obeys Ohm."""
    case = line(r=0.0, x=0.1, load=[load(2.0)])
    found = solved(case, "minlp")
    assert not found.answer.relaxed
    v, p, q = found["bus.v_sq"][:, 0], found["line.p"][0, 0], found["line.q"][0, 0]
    assert found["line.l"][0, 0] == pytest.approx((p**2 + q**2) / v[0], rel=1e-5)
    assert q == pytest.approx(0.1 * found["line.l"][0, 0], rel=1e-6)
    assert np.sqrt(v[1]) < 1.0
