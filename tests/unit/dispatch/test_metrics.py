"""Metrics of trajectories against hand values, edge rules and invariances."""

from dataclasses import asdict

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from resilience.errors import UsageError
from resilience.evaluation.measures import metrics, trapezoid
from resilience.tolerances import PERFORMANCE_TOLERANCE

# Two loads of 2 and 1 MW, four slots of 15 min, three members: no shedding; the second load out in
# slots 1 and 2; everything out in slot 0 and half of the first load in slot 3.
DEMAND = np.broadcast_to(np.array([2.0, 1.0])[:, None, None], (2, 4, 3))
SHED = np.stack(
    [
        np.zeros((2, 4)),
        np.array([[0.0, 0, 0, 0], [0, 1, 1, 0]]),
        np.array([[2.0, 0, 0, 1], [1, 0, 0, 0]]),
    ],
    axis=-1,
)
FIRST_IS_CRITICAL = np.array([True, False])
DT_H = 0.25


def random_trajectory(seed: int, loads: int = 3, slots: int = 12, members: int = 5):
    rng = np.random.default_rng(seed)
    demand = rng.uniform(0.5, 2, (loads, slots, members))
    return demand, demand * np.maximum(rng.uniform(-1, 1, demand.shape), 0)


def halved(array, axis: int):
    return np.repeat(array, 2, axis=axis)


def test_service_by_hand():
    found = metrics.service(
        DEMAND, SHED, DT_H, critical=FIRST_IS_CRITICAL, priority=np.array([3.0, 1.0])
    )
    assert found.ens_mwh.tolist() == [0, 0.5, 1.0]
    assert found.weighted_ens_mwh.tolist() == [0, 0.5, 3 * 0.75 + 0.25]
    assert found.shed_mw_slots.tolist() == [0, 2, 4]
    assert found.shed_h.tolist() == [0, 0.5, 0.5]
    assert found.shed_slot_share.tolist() == [0, 0.5, 0.5]
    assert found.served_share == pytest.approx([1, 1 - 2 / 12, 1 - 4 / 12])
    assert found.critical_served_share == pytest.approx([1, 1, 1 - 3 / 8])
    assert found.first_critical_shed_h.tolist() == [np.inf, np.inf, 0]


def test_adequacy_by_hand():
    p = np.array([0.5, 0.3, 0.2])
    found = metrics.adequacy(DEMAND, SHED, DT_H, critical=FIRST_IS_CRITICAL, probability=p)
    assert asdict(found) == pytest.approx(
        {
            "eens_mwh": 0.35,
            "weighted_eens_mwh": 0.35,
            "shed_mw_slots": 1.4,
            "lole_h": 0.25,
            "lolp_slots": 0.25,
            "lolp_members": 0.5,
            "served_share": 1 - 1.4 / 12,
            "critical_served_share": 1 - 0.6 / 8,
            "p_critical_served": 0.8,
        }
    )


def test_a_member_that_sheds_for_one_slot_loses_load():
    shed = SHED.copy()
    shed[1, 2, 1] = 0.0  # a quarter of an hour is left of half an hour
    found = metrics.adequacy(DEMAND, shed, DT_H, probability=np.array([0.5, 0.3, 0.2]))
    assert found.lolp_members == pytest.approx(0.5)
    assert found.lole_h == pytest.approx(0.3 * 0.25 + 0.2 * 0.5)


def test_shares_of_members_that_demand_differently():
    """Two loads, two slots, two members: expected energies are divided, not shares averaged."""
    demand = np.array([[[2.0, 5.0], [3.0, 8.0]], [[0.5, 1.5], [0.7, 2.5]]])
    shed = np.array([[[0.0, 2.0], [1.2, 3.0]], [[0.4, 0.0], [0.3, 0.9]]])
    p = np.array([0.3, 0.7])
    found = metrics.adequacy(demand, shed, 0.5, critical=np.array([False, True]), probability=p)
    # Members demand 6.2 and 17 MW-slots and go without 1.9 and 5.9; the critical load 1.2 and 4.
    assert found.served_share == pytest.approx(1 - (0.3 * 1.9 + 0.7 * 5.9) / (0.3 * 6.2 + 0.7 * 17))
    assert found.critical_served_share == pytest.approx(
        1 - (0.3 * 0.7 + 0.7 * 0.9) / (0.3 * 1.2 + 0.7 * 4.0)
    )
    assert found.eens_mwh == pytest.approx(0.5 * (0.3 * 1.9 + 0.7 * 5.9))
    each = metrics.service(demand, shed, 0.5)
    assert each.served_share == pytest.approx([1 - 1.9 / 6.2, 1 - 5.9 / 17])


def test_equal_weights_are_no_weights():
    demand, shed = random_trajectory(1)
    p = np.full(5, 0.2)
    weighted = metrics.adequacy(demand, shed, DT_H, probability=p)
    assert asdict(weighted) == pytest.approx(asdict(metrics.adequacy(demand, shed, DT_H)))


def test_a_member_twice_as_likely_is_that_member_twice():
    demand, shed = random_trajectory(2, members=2)
    twice = metrics.adequacy(demand[..., [0, 0, 1]], shed[..., [0, 0, 1]], DT_H)
    once = metrics.adequacy(demand, shed, DT_H, probability=np.array([2, 1]) / 3)
    assert asdict(once) == pytest.approx(asdict(twice))


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_halving_the_step_changes_only_the_mw_slots(seed):
    demand, shed = random_trajectory(seed)
    coarse = asdict(metrics.service(demand, shed, 1.0))
    fine = asdict(metrics.service(halved(demand, 1), halved(shed, 1), 0.5))
    assert fine.pop("shed_mw_slots") == pytest.approx(2 * coarse.pop("shed_mw_slots"))
    for name, value in coarse.items():
        assert fine[name] == pytest.approx(value), name
    whole = metrics.interruption_indices(demand, shed, 1.0)
    parts = metrics.interruption_indices(halved(demand, 1), halved(shed, 1), 0.5)
    assert parts.asifi == pytest.approx(whole.asifi)
    assert parts.asidi_h == pytest.approx(whole.asidi_h)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_a_batch_is_its_members_one_by_one(seed):
    demand, shed = random_trajectory(seed, members=4)
    batch = asdict(metrics.service(demand, shed, DT_H))
    level = metrics.served_ratio(demand, shed)
    curves = asdict(trapezoid.trapezoid(level, DT_H))
    for k in range(4):
        one = slice(k, k + 1)
        for name, value in asdict(metrics.service(demand[..., one], shed[..., one], DT_H)).items():
            assert value == pytest.approx(batch[name][one]), name
        for name, value in asdict(trapezoid.trapezoid(level[:, one], DT_H)).items():
            assert value == pytest.approx(curves[name][one], nan_ok=True), name


def test_demand_alike_for_all_members_may_be_given_once():
    once = metrics.adequacy(DEMAND[..., :1], SHED, DT_H)
    assert once == metrics.adequacy(DEMAND, SHED, DT_H)


def test_where_nothing_is_demanded_everything_is_served():
    nothing = np.zeros((1, 2, 1))
    found = metrics.adequacy(nothing, nothing, DT_H)
    assert (found.served_share, found.p_critical_served) == (1, 1)
    assert metrics.served_ratio(nothing, nothing).tolist() == [[1], [1]]
    assert metrics.interruption_indices(nothing, nothing, DT_H).asidi_h.tolist() == [0]


def test_without_critical_loads_none_is_shed():
    found = metrics.adequacy(DEMAND, SHED, DT_H, critical=np.zeros(2, bool))
    assert (found.critical_served_share, found.p_critical_served) == (1, 1)


def test_rounding_of_a_solver_is_no_loss_of_load():
    found = metrics.adequacy(DEMAND, SHED * 0 + 1e-8, DT_H)
    assert (found.lole_h, found.lolp_members, found.p_critical_served) == (0, 0, 1)


def test_time_to_first_shed_counts_from_the_start_given():
    assert metrics.time_to_first_shed(SHED, DT_H).tolist() == [np.inf, 0.25, 0]
    assert metrics.time_to_first_shed(SHED, DT_H, start=1).tolist() == [np.inf, 0, 0.5]
    slots = SHED.shape[1]
    assert metrics.time_to_first_shed(SHED, DT_H, start=slots).tolist() == [np.inf] * 3


def test_survival_falls_with_the_hours():
    first = metrics.time_to_first_shed(SHED, DT_H)
    p = np.array([0.5, 0.3, 0.2])
    found = [metrics.survival(first, hours, p) for hours in (0, 0.25, 0.5, np.inf)]
    assert found == pytest.approx([1, 0.8, 0.5, 0.5])


def test_interruption_indices_by_hand():
    # Member 2: 3 of 3 MW go out for one slot, then half of the first load: 1 MW.
    found = metrics.interruption_indices(DEMAND, SHED, DT_H)
    assert found.asifi == pytest.approx([0, 1 / 3, 4 / 3])
    assert found.asidi_h == pytest.approx([0, 0.5 / 3, 1 / 3])


def test_interruptions_count_by_the_load_connected():
    found = metrics.interruption_indices(DEMAND, SHED, DT_H, connected_mw=np.array([1.0, 3.0]))
    assert found.asifi == pytest.approx([0, 3 / 4, (4 + 0.5) / 4])


def test_resilience_of_the_paper_is_minus_the_shed_cost():
    found = metrics.paper_resilience(SHED, np.array([6.0, 3.0]), DT_H, np.array([2.0, 1.0]))
    assert found == pytest.approx([0, -0.5 * 3, -(0.75 * 12 + 0.25 * 3)])


# R(t), dt = 0.5 h: phi, lambda, E, pi, area, onset, restored
CURVES = {
    "no drop": ([1, 1, 1, 1], (0, 0, 0, np.nan, 2, np.nan, True)),
    "one slot": ([1, 0.4, 1, 1], (-0.6 / 0.5, 0.6, 0.5, 0.6 / 0.5, 1.7, 0.5, True)),
    "two steps down, three up": (
        [1, 0.6, 0.2, 0.2, 0.5, 0.8, 1, 1],
        (-0.8 / 1.0, 0.8, 1.0, 0.8 / 1.5, 2.65, 0.5, True),
    ),
    "never restored": ([1, 0.5, 0.25, 0.5], (-0.75, 0.75, 0.5, 0, 1.125, 0.5, False)),
    "down from the start": ([0.5, 0.5, 1, 1], (-1, 0.5, 1, 1, 1.5, 0, True)),
    "down throughout": ([0, 0, 0], (-2, 1, 1.5, 0, 0, 0, False)),
    "a plateau in between": ([1, 0.2, 0.5, 0.2, 1], (-1.6, 0.8, 1.5, 1.6, 1.45, 0.5, True)),
    "deepest of two": ([0.9, 1, 0.5, 1], (-1, 0.5, 0.5, 1, 1.7, 1, True)),
    "first of equals": ([0.5, 1, 0.5, 1], (-1, 0.5, 0.5, 1, 1.5, 0, True)),
}


@pytest.mark.parametrize("name", CURVES)
def test_trapezoid_by_hand(name):
    level, expected = CURVES[name]
    found = trapezoid.trapezoid(np.array(level, float)[:, None], 0.5)
    names = ("phi_per_h", "lambda_share", "e_h", "pi_per_h", "area_h", "onset_h", "restored")
    assert [getattr(found, n)[0] for n in names] == pytest.approx(expected, nan_ok=True)
    assert found.dropped[0] == (name != "no drop")


@pytest.mark.parametrize("name", CURVES)
def test_what_is_normal_before_the_event_may_be_less_than_all(name):
    """At 0.8 of every level falls and rises are 0.8 of what they are, and take as long."""
    level, (phi, lost, e_h, pi, area_h, onset_h, restored) = CURVES[name]
    found = trapezoid.trapezoid(0.8 * np.array(level, float)[:, None], 0.5, normal=0.8)
    names = ("phi_per_h", "lambda_share", "pi_per_h", "area_h")
    shrunk = [0.8 * value for value in (phi, lost, pi, area_h)]
    assert [getattr(found, n)[0] for n in names] == pytest.approx(shrunk, nan_ok=True)
    kept = [found.e_h[0], found.onset_h[0], found.restored[0]]
    assert kept == pytest.approx([e_h, onset_h, restored], nan_ok=True)


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_depth_duration_and_area_do_not_depend_on_the_step(seed):
    level = np.random.default_rng(seed).integers(0, 5, (9, 6)) / 4
    coarse, fine = trapezoid.trapezoid(level, 1.0), trapezoid.trapezoid(halved(level, 0), 0.5)
    for name in ("lambda_share", "e_h", "area_h", "onset_h", "restored"):
        assert getattr(fine, name) == pytest.approx(getattr(coarse, name), nan_ok=True), name


def test_a_level_is_the_lowest_up_to_the_tolerance():
    """The lowest for two slots, though one is higher by as much as rounding may be."""
    low = 0.3
    level = np.array([0.9, low + PERFORMANCE_TOLERANCE, low, 0.9])[:, None]
    found = trapezoid.trapezoid(level, 0.5, normal=0.9)
    assert (found.e_h[0], found.onset_h[0]) == pytest.approx((2 * 0.5, 0.5))


def test_area_and_triangle_fill_the_horizon():
    level = np.random.default_rng(3).uniform(0, 1, (10, 4))
    loss = trapezoid.triangle(level, 0.5)
    assert loss.loss_h + trapezoid.trapezoid(level, 0.5).area_h == pytest.approx([5.0] * 4)
    assert loss.resilience_share == pytest.approx(1 - loss.loss_h / 5)
    assert trapezoid.triangle(np.array([[1.0], [0.5]]), 0.5).loss_h == pytest.approx([0.25])


def test_operational_and_infrastructure_curves():
    assert metrics.served_ratio(DEMAND, SHED)[:, 2] == pytest.approx([0, 1, 1, 2 / 3])
    up = np.ones((4, 3, 1), bool)
    up[0, 1:], up[1, 2] = False, False
    level = trapezoid.lines_up_ratio(up)
    assert level[:, 0].tolist() == [1, 0.75, 0.5]
    assert trapezoid.trapezoid(level, 1.0).pi_per_h.tolist() == [0]
    assert trapezoid.lines_up_ratio(up[:0]).tolist() == [[1]] * 3


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: metrics.service(DEMAND, SHED[:, :, 0], DT_H), "put the members last"),
        (lambda: metrics.service(DEMAND[:, :3], SHED, DT_H), "demand has the shape"),
        (lambda: metrics.service(DEMAND, SHED, 0.0), "dt_h is 0"),
        (lambda: metrics.service(DEMAND, SHED * 2, DT_H), "allowed: 0 to the demand"),
        (lambda: metrics.service(DEMAND, SHED * np.nan, DT_H), "is nan MW"),
        (lambda: trapezoid.triangle(np.full((3, 1), np.nan), DT_H), "failed members"),
        (lambda: metrics.service(DEMAND, SHED, DT_H, priority=np.ones(3)), "one per load"),
        (lambda: metrics.adequacy(DEMAND, SHED, DT_H, probability=np.ones(3)), "add up to 3"),
        (lambda: metrics.adequacy(DEMAND, SHED, DT_H, probability=np.ones(1)), "the shape"),
        (lambda: trapezoid.trapezoid(np.ones(3), DT_H), "put the members last"),
        (lambda: trapezoid.triangle(np.ones((3, 1)), -1.0), "dt_h is -1"),
    ],
)
def test_what_cannot_be_measured_is_refused(call, words):
    with pytest.raises(UsageError, match=words):
        call()
