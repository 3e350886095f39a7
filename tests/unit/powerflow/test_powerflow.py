"""Batched AC power flow: pandapower's numbers, whatever the islands and the batch."""

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from resilience.case import Case, Network, load_case
from resilience.errors import UsageError
from resilience.models.network.powerflow import MIN_MEMBERS, Flow, flow
from resilience.testing import small_case
from tests.unit.powerflow.oracle import oracle

BREAKPOINTS = ("2-19", "3-23", "6-26")
HEADS = ("19", "23", "26")
GRID = {"import_max_mw": 1.0, "import_cost_per_mwh": 1.0}


@pytest.fixture(scope="module")
def network() -> Network:
    return load_case("ieee33").network


@pytest.fixture(scope="module")
def baran_wu(network: Network) -> tuple[Network, Any, Any]:
    """The feeder with its own impedances and loads, (33, 1)."""
    import pandapower.networks

    load = pandapower.networks.case33bw().load
    p, q = np.zeros((33, 1)), np.zeros((33, 1))
    p[load.bus, 0], q[load.bus, 0] = -load.p_mw, -load.q_mvar
    full = replace(network, r_pu=network.r_pu / 0.394, x_pu=network.x_pu / 0.394, aliases={})
    return full, p, q


def drawn(network: Network, members: int, rng: Any, broken: float = 0.5) -> dict[str, Any]:
    """Random injections; each breakpoint out with a probability, its lateral then on its head."""
    p = rng.uniform(-0.3, 0.15, (33, members))
    up = np.repeat(network.in_service[:, None], members, axis=1)
    root = np.zeros((33, members), bool)
    root[0] = True
    for line, head in zip(BREAKPOINTS, HEADS, strict=True):
        out = rng.random(members) < broken
        up[network.line(line), out] = False
        root[network.bus(head), out] = True
    v = rng.uniform(0.98, 1.05, (33, members))
    return {"p_mw": p, "q_mvar": 0.4 * p, "line_up": up, "root": root, "v_root": v}


def member(given: dict[str, Any], k: int) -> dict[str, Any]:
    return {name: array[:, [k]] for name, array in given.items()}


def alike(found: Flow, k: int, other: Flow, at: int = 0, within: float = 1e-9) -> None:
    for f in fields(Flow):
        if f.name != "network":
            one, two = getattr(found, f.name)[..., k], getattr(other, f.name)[..., at]
            np.testing.assert_allclose(one, two, rtol=0, atol=within, err_msg=f.name)


def agree(found: Flow, k: int, given: dict[str, Any]) -> None:
    """Member `k` and pandapower, to 1e-6."""
    one = [given[name][:, k] for name in ("p_mw", "q_mvar", "line_up", "root", "v_root")]
    volts, loss, mva, fed = oracle(found.network, *one)
    np.testing.assert_allclose(found.v_pu[:, k], volts, atol=1e-6)
    np.testing.assert_allclose(found.s_line_mva[:, k], mva, atol=1e-6)
    np.testing.assert_allclose(found.p_root_mw[:, k], fed, atol=1e-6)
    assert found.loss_mw[k] == pytest.approx(loss, abs=1e-6)


def test_base_case_of_baran_and_wu(baran_wu: tuple[Network, Any, Any]) -> None:
    network, p, q = baran_wu
    root = np.arange(33) == 0
    found = flow(network, p, q, network.in_service, root)
    assert 1e3 * found.loss_mw[0] == pytest.approx(202.677, abs=1e-3)
    assert found.v_pu.min() == pytest.approx(0.91309, abs=1e-5)
    assert network.bus_names[int(found.v_pu.argmin())] == "18"
    given = {"p_mw": p, "q_mvar": q, "line_up": network.in_service[:, None], "root": root[:, None]}
    agree(found, 0, given | {"v_root": np.ones((33, 1))})


def test_two_islands_with_a_root_each(network: Network) -> None:
    given = drawn(network, 4, np.random.default_rng(1), broken=0.0)
    given["line_up"][network.line("6-26")] = False
    given["root"][network.bus("28")] = True
    given["root"][0], given["root"][network.bus("12")] = False, True
    found = flow(network, **given)
    assert found.converged.all()
    for k in range(4):
        agree(found, k, given)


def test_mixed_patterns_in_one_batch_are_the_members_one_by_one(network: Network) -> None:
    members = 3 * MIN_MEMBERS
    given = drawn(network, members, np.random.default_rng(2), broken=0.2)
    patterns = np.unique(given["line_up"], axis=1, return_counts=True)[1]
    assert patterns.max() >= MIN_MEMBERS > patterns.min()  # both ways of solving are at work
    found = flow(network, **given)
    assert found.converged.all()
    for k in range(members):
        alike(found, k, flow(network, **member(given, k)))
    for k in (0, 7, 31):
        agree(found, k, given)


def test_a_ring_is_no_obstacle(network: Network) -> None:
    given = drawn(network, 2, np.random.default_rng(3), broken=0.0)
    given["line_up"][:] = True
    found = flow(network, **given)
    for k in range(2):
        agree(found, k, given)


def test_the_root_gives_what_is_left_over(network: Network) -> None:
    given = drawn(network, 50, np.random.default_rng(4))
    found = flow(network, **given)
    left = given["p_mw"].sum(axis=0) + found.p_root_mw.sum(axis=0)
    np.testing.assert_allclose(found.loss_mw, left, atol=1e-9)
    assert (found.loss_mw > 0).all()
    assert not found.p_root_mw[~given["root"]].any()


@pytest.mark.parametrize("members", [12, 4 * MIN_MEMBERS])
@pytest.mark.parametrize("bad", [-1e4, np.nan, np.inf])
def test_a_member_without_solution_is_masked_and_disturbs_no_other(
    network: Network, members: int, bad: float
) -> None:
    given = drawn(network, members, np.random.default_rng(5))
    clean = flow(network, **given)
    given["p_mw"][5, 3] = bad
    found = flow(network, **given)
    assert np.flatnonzero(~found.converged).tolist() == [3]
    for f in fields(Flow)[2:]:
        assert np.isnan(getattr(found, f.name)[..., 3]).all(), f.name
    for k in set(range(members)) - {3}:
        alike(found, k, clean, k, within=1e-12)


def test_all_members_fail(network: Network) -> None:
    given = drawn(network, 2, np.random.default_rng(6), broken=0.0)
    found = flow(network, **(given | {"p_mw": given["p_mw"] * 1e5}))
    assert not found.converged.any()
    assert np.isnan(found.v_pu).all()


def test_an_island_without_root_is_dead(network: Network) -> None:
    given = drawn(network, 3, np.random.default_rng(7), broken=0.0)
    given["line_up"][network.line("6-26"), 1] = False
    given["p_mw"][network.bus("30"), 1] = np.nan  # nobody reads what a dead bus is given
    found = flow(network, **given)
    dead = [network.bus(str(k)) for k in range(26, 34)]
    assert found.converged.all()
    assert np.flatnonzero(np.isnan(found.v_pu[:, 1])).tolist() == dead
    assert not np.isnan(found.v_pu[:, [0, 2]]).any()
    assert not found.s_line_mva[network.line("28-29"), 1]
    assert found.s_line_mva[network.line("28-29"), 0] > 0


def test_nothing_alive_is_nothing_to_solve(network: Network) -> None:
    nothing = np.zeros((33, 2))
    found = flow(network, nothing, nothing, network.in_service, np.zeros(33, bool))
    assert found.converged.all()
    assert np.isnan(found.v_pu).all()
    assert not found.loss_mw.any()


def test_one_bus_and_no_members_are_networks_too(network: Network) -> None:
    alone = small_case(grid=[GRID]).network
    p = np.array([[0.3, -0.2]])
    found = flow(alone, p, p, np.zeros(0, bool), np.ones(1, bool), 1.01)
    assert found.v_pu[0] == pytest.approx([1.01, 1.01])
    assert found.p_root_mw[0] == pytest.approx([-0.3, 0.2])
    empty = np.zeros((33, 0))
    none = flow(network, empty, empty, network.in_service, np.arange(33) == 0)
    assert none.v_pu.shape == (33, 0)
    assert none.converged.shape == (0,)


def two_levels() -> Case:
    return small_case(buses=3, lines=[(1, 2, 0.02, 0.05), (2, 3, 0.0, 0.0)], grid=[GRID])


def test_rated_voltages_do_not_matter_in_per_unit() -> None:
    network = two_levels().network
    other = replace(network, vn_kv=np.array([10.0, 0.4, 0.4]), aliases={})
    p = np.array([[0.0], [-0.4], [-0.3]])
    up, root = np.ones(2, bool), np.array([True, False, False])
    one, two = flow(network, p, 0.5 * p, up, root, 1.02), flow(other, p, 0.5 * p, up, root, 1.02)
    alike(one, 0, two)
    assert one.v_pu[2, 0] == pytest.approx(one.v_pu[1, 0], abs=1e-7)  # no impedance, no drop
    assert one.v_pu[1, 0] < 1.0 < one.v_pu[0, 0]


def test_excess_over_limits() -> None:
    network = replace(two_levels().network, rating_mva=np.array([0.5, np.inf]), aliases={})
    p = np.array([[0.0, 0.0], [-0.1, -3.0], [-0.1, 0.0]])
    found = flow(network, p, 0.0 * p, np.ones(2, bool), np.array([True, False, False]), 0.92)
    assert found.overload_mva[:, 0].tolist() == [0.0, 0.0]
    assert found.overload_mva[0, 1] == pytest.approx(found.s_line_mva[0, 1] - 0.5)
    assert not found.v_violation_pu[:, 0].any()
    assert found.v_violation_pu[1, 1] == pytest.approx(0.9 - found.v_pu[1, 1])


def test_two_roots_in_one_island_are_refused(network: Network) -> None:
    nothing = np.zeros((33, 1))
    with pytest.raises(UsageError, match=r"member 0 has the roots 1, 5; allowed: one"):
        flow(network, nothing, nothing, network.in_service, np.isin(np.arange(33), [0, 4]))


@pytest.mark.parametrize("name", ["p_mw", "q_mvar", "line_up", "root", "v_root"])
def test_arrays_that_do_not_fit_are_refused(network: Network, name: str) -> None:
    given = drawn(network, 3, np.random.default_rng(8))
    given[name] = given[name][:-1]
    with pytest.raises(UsageError, match=r"has the shape \(.*; allowed: \("):
        flow(network, **given)
