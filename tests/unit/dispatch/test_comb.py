"""The optimum where nothing but the end of a blackout is unknown."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

import resilience as rs
from resilience.arrays import Floats
from resilience.dispatch.comb import COMB, Comb, CombTree, beyond_comb, comb_optimum
from resilience.dispatch.registry import factory_of
from resilience.errors import UsageError
from resilience.evaluation.clairvoyant import clairvoyant
from resilience.fragility.outages.blackout import case_blackout
from resilience.simulation.causality import check_causality
from resilience.simulation.simulate import simulate
from resilience.simulation.world import World
from tests.unit.dispatch.blackouts import DEMAND, FIRST, SLOTS, dark, world

METHODS = ("idle", "rule", "rule-0.9", "greedy", "mpc-blind", "mpc", "stochastic")


def expected(judged: World, name: str) -> float:
    """Mean cost of a dispatcher over all ends, $."""
    done = simulate(judged, factory_of(name)(judged.setting))
    return float(judged.scenarios.probability @ done.objective(judged.end_value_per_mwh))


def extensive_form() -> float:
    """The same optimum by scipy, scenario by scenario, tied as long as nobody can tell them apart.

    Written from the case's numbers: a battery of 4 MWh and 1 MW without losses, a unit of 2 MW at
    2 $/MWh and 0.25 m³/MWh, 2 m³ of fuel and 0.5 more at 09:00, loads of 0.7 and 1.3 MW at 150 and
    30 $/MWh, a grid of 5 MW at 0.3 $/MWh, and 0.5 $ for a MWh left.
    """
    storms = case_blackout(dark()).every_end()
    n, keys = storms.n, ("charge", "discharge", "unit", "shed1", "shed2", "grid", "energy", "fuel")
    size = len(keys) * SLOTS

    def at(k: int, key: str, t: int) -> int:
        return k * size + keys.index(key) * SLOTS + t

    cost, bounds = np.zeros(n * size), [(0.0, 0.0)] * (n * size)
    equal: list[tuple[dict[int, float], float]] = []
    below: list[tuple[dict[int, float], float]] = []
    for k, p in enumerate(storms.probability):
        for t in range(SLOTS):
            price = {"unit": 2.0, "shed1": 150.0, "shed2": 30.0, "grid": 0.3}
            limit = {
                "charge": 1.0, "discharge": 1.0, "unit": 2.0, "energy": 4.0, "fuel": 2.0,
                "shed1": 0.7 * DEMAND[t], "shed2": 1.3 * DEMAND[t],
                "grid": 0.0 if storms.down[0, t, k] else 5.0,
            }  # fmt: skip
            for key in keys:
                cost[at(k, key, t)] = p * price.get(key, 0.0)
                bounds[at(k, key, t)] = (0.0, limit[key])
            supply = {at(k, key, t): 1.0 for key in ("discharge", "unit", "shed1", "shed2", "grid")}
            equal.append((supply | {at(k, "charge", t): -1.0}, 2.0 * DEMAND[t]))
            stored = {at(k, "energy", t): 1.0, at(k, "charge", t): -1.0, at(k, "discharge", t): 1.0}
            burnt = {at(k, "fuel", t): 1.0, at(k, "unit", t): 0.25}
            if t:
                stored[at(k, "energy", t - 1)] = burnt[at(k, "fuel", t - 1)] = -1.0
            equal.append((stored, 0.0 if t else 4.0))
            below.append((burnt, (0.5 if t == 9 else 0.0) + (0.0 if t else 2.0)))
        cost[at(k, "energy", SLOTS - 1)] -= p * 0.5
        for other in range(k):  # both are dark up to the end of the shorter one
            shorter = FIRST + int(min(storms.down[0, :, [k, other]].sum(axis=1)))
            for t in range(shorter):
                equal += [({at(k, key, t): 1.0, at(other, key, t): -1.0}, 0.0) for key in keys]
    a_eq, b_eq = rows(equal, n * size)
    a_ub, b_ub = rows(below, n * size)
    return float(linprog(cost, a_ub, b_ub, a_eq, b_eq, bounds).fun)


def rows(entries: list[tuple[dict[int, float], float]], columns: int) -> tuple[Floats, Floats]:
    import scipy.sparse as sp

    matrix = sp.lil_array((len(entries), columns))
    for i, (row, _) in enumerate(entries):
        for j, value in row.items():
            matrix[i, j] = value
    return matrix.tocsr(), np.array([side for _, side in entries])


def test_it_is_the_optimum_of_tied_scenarios() -> None:
    assert comb_optimum(world().setting) == pytest.approx(extensive_form(), rel=1e-7)


def test_what_it_does_costs_what_it_says() -> None:
    assert expected(world(), COMB) == pytest.approx(comb_optimum(world().setting), rel=1e-7)


def test_it_lies_between_foresight_and_everybody_else() -> None:
    judged = world()
    optimum = comb_optimum(judged.setting)
    foresight = float(judged.scenarios.probability @ clairvoyant(judged).objective)
    assert foresight < optimum - 1.0
    for name in METHODS:
        assert expected(judged, name) > optimum - 1e-6, name


def test_nobody_is_told_when_the_blackout_ends() -> None:
    check_causality(world(), {COMB: factory_of(COMB)})


def test_one_end_makes_it_the_clairvoyant() -> None:
    judged = world(dark(law="fixed", hours=[9.0]))
    assert judged.scenarios.n == 1
    assert comb_optimum(judged.setting) == pytest.approx(clairvoyant(judged).objective[0])


def test_the_tree_is_a_comb() -> None:
    blackout = case_blackout(dark())
    comb = CombTree.of_blackout(blackout)
    ends = np.flatnonzero(blackout.chance) + 1 + FIRST
    trunk = int(ends[-1])
    assert comb.tree.n == trunk + int((SLOTS - ends).sum())
    assert comb.is_dark.sum() == trunk - FIRST
    assert comb.tree.probability[:FIRST].tolist() == [1.0] * FIRST
    lasting = 1.0 - np.append(0.0, np.cumsum(blackout.chance))[: trunk - FIRST]
    assert comb.tree.probability[FIRST:trunk] == pytest.approx(lasting)


def test_a_return_that_the_law_excludes_is_refused() -> None:
    other = case_blackout(dark(law="fixed", hours=[17.0], longest_h=18.0)).every_end()
    judged = world(storms=other)
    with pytest.raises(UsageError, match="when its law has them down"):
        simulate(judged, Comb(judged.setting))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"forecast_error": "ar1"}, "load and PV are not as forecast"),
        ({"physics": "lindistflow"}, "lines have limits"),
        ({"reset_daily": True}, "reset at midnight"),
    ],
)
def test_where_more_is_unknown_it_is_refused(changes: dict[str, object], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        rs.compare(dark(), ["comb"], draws=2, **changes)  # type: ignore[arg-type]


def test_a_case_without_a_blackout_has_none() -> None:
    assert beyond_comb(world().setting) == ""
    report = rs.compare("ieee33-tou", ["rule"], days=1, draws=2)
    assert report.comb is None
    assert COMB not in report.objective
    with pytest.raises(UsageError, match="has no \\[blackout\\]"):
        rs.compare("ieee33-tou", ["comb"], days=1, draws=2)


def test_a_comparison_shows_it_unasked() -> None:
    report = rs.compare(dark(), ["rule"], draws=4)
    optimum = comb_optimum(report.world.setting)
    assert report.comb == pytest.approx(optimum)
    over = report.frame()["over_comb_percent"]
    assert over["comb"] == 0.0
    assert over["rule"] > 0.0
    assert np.isnan(over["clairvoyant"])
    assert report.summary()["comb_per_day"] == pytest.approx(optimum * 24 / SLOTS)


def test_the_fan_is_within_five_percent_of_it_on_ieee33_fuel() -> None:
    """On four draws; over all ends with their probabilities it is 0.06 %."""
    over = rs.compare("ieee33-fuel", ["stochastic"], draws=4).frame()["over_comb_percent"]
    assert over["stochastic"] < 5.0 < over["rule-0.9"]
