"""What a line can be asked to carry: never less than its two sides can exchange, or draw."""

import itertools

import numpy as np
import pytest

from resilience.case import Case, load_case
from resilience.models.network.limits import MARGIN, Capacity, current_limits, lossless_limits
from resilience.testing import small_case
from tests.known.solving import solved

BUSES, PROFILES = 7, 3
GROUPS = [np.array(group) for group in itertools.product((False, True), repeat=BUSES)]


def random_case(rng: np.random.Generator, ring: bool) -> Case:
    """Seven buses on a random tree, with one line more if it is to have a ring."""
    lines = [(int(rng.integers(1, k)), k, 0.01, 0.01) for k in range(2, BUSES + 1)]
    if ring:
        free = set(itertools.combinations(range(1, BUSES + 1), 2)) - {line[:2] for line in lines}
        lines.append((*sorted(free)[int(rng.integers(len(free)))], 0.01, 0.01))
    load = [{"p_max_mw": 1.3, "shed_cost_per_mwh": 1.1}]
    grid = [{"import_max_mw": 1.2, "import_cost_per_mwh": 1.4}]
    return small_case(buses=BUSES, lines=lines, load=load, grid=grid)


def random_capacity(rng: np.random.Generator) -> Capacity:
    """Some of the buses have much, most little, and some nothing of it."""
    shape = BUSES, PROFILES
    values = rng.uniform(0, 3, (3, *shape)) * rng.choice([0.0, 0.2, 1.0, 20.0], (3, *shape))
    return Capacity(*values)


def first_side(case: Case, k: int) -> np.ndarray:
    """Buses on the side of the first end of line k of a tree."""
    network = case.network
    reached = np.zeros(BUSES, bool)
    reached[network.from_bus[k]] = True
    for _ in range(BUSES):
        for i, (a, b) in enumerate(zip(network.from_bus, network.to_bus, strict=True)):
            if i != k and (reached[a] or reached[b]):
                reached[[a, b]] = True
    return reached


@pytest.mark.parametrize("seed", range(5))
def test_in_a_tree_it_is_what_one_side_feeds_in_and_the_other_takes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    case, capacity = random_case(rng, ring=False), random_capacity(rng)
    forth, back = lossless_limits(case.network, capacity)
    supply, demand = capacity.supply, capacity.demand
    for profile in (np.ones(PROFILES), rng.uniform(0, 2, PROFILES)):
        for k in range(BUSES - 1):
            one = first_side(case, k)
            out = supply[one].sum(0) @ profile, demand[~one].sum(0) @ profile
            into = supply[~one].sum(0) @ profile, demand[one].sum(0) @ profile
            assert forth[k] @ profile >= MARGIN * min(out) - 1e-9
            assert back[k] @ profile >= MARGIN * min(into) - 1e-9
            if (profile == 1.0).all():
                assert forth[k] @ profile == pytest.approx(MARGIN * min(out), abs=1e-9)
                assert back[k] @ profile == pytest.approx(MARGIN * min(into), abs=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_in_a_mesh_it_is_enough_for_any_two_groups_of_buses(seed: int) -> None:
    rng = np.random.default_rng(seed)
    case, capacity = random_case(rng, ring=True), random_capacity(rng)
    forth, back = lossless_limits(case.network, capacity)
    supply, demand = capacity.supply, capacity.demand
    for profile in (np.ones(PROFILES), rng.uniform(0, 2, PROFILES)):
        limit = np.minimum(forth @ profile, back @ profile).min()
        for one in GROUPS:
            sent = min(supply[one].sum(0) @ profile, demand[~one].sum(0) @ profile)
            assert MARGIN * sent <= limit + 1e-9
    assert forth.sum(1).max() <= MARGIN * demand.sum() + 1e-9


@pytest.mark.parametrize("ring", [False, True])
@pytest.mark.parametrize("seed", range(5))
def test_the_current_is_what_the_devices_of_a_side_draw(seed: int, ring: bool) -> None:
    rng = np.random.default_rng(seed)
    case, capacity = random_case(rng, ring), random_capacity(rng)
    v_min = rng.uniform(0.6, 0.95, BUSES)
    limits = current_limits(case.network, capacity, v_min)
    for profile in (np.ones(PROFILES), rng.uniform(0, 2, PROFILES)):
        drawn = capacity.apparent @ profile / v_min
        for k, limit in enumerate(limits @ profile):
            groups = GROUPS if ring else [first_side(case, k)]
            least = max(min(drawn[one].sum(), drawn[~one].sum()) for one in groups)
            assert MARGIN * least <= limit + 1e-9
            if not ring and (profile == 1.0).all():
                assert limit == pytest.approx(MARGIN * least)


@pytest.mark.parametrize("method", ["milp", "minlp"])
@pytest.mark.parametrize("name", ["ieee33", "analytic/two-islands", "analytic/precharge"])
def test_no_plan_of_a_shipped_case_comes_near(name: str, method: str) -> None:
    """Limits are there for solvers; what they bound is not zero for that."""
    found = solved(load_case(name), method, gap=1e-3)
    standard, vectors = found.problem.standard, found.problem.vectors
    assert found.near_limits.keys() >= {"line.p"}
    assert max(found.near_limits.values()) == 0.0
    flow, limit = np.abs(found["line.p"]), vectors.upper[standard.columns("line.p")]
    back = -vectors.lower[standard.columns("line.p")]
    assert (flow <= np.maximum(limit, back) / MARGIN + 1e-6).all()
    assert flow.max() > 0.0
