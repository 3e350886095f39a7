"""What a line can be asked to carry: never less than its two sides can exchange."""

import itertools

import numpy as np
import pytest

from resilience.case import Case, load_case
from resilience.models.microgrid import MARGIN
from resilience.models.network.graph import exchange
from resilience.testing import small_case
from tests.known.solving import solved


def random_case(rng: np.random.Generator, ring: bool) -> Case:
    """Seven buses on a random tree, with one line more if it is to have a ring."""
    lines = [(int(rng.integers(1, k)), k, 0.01, 0.01) for k in range(2, 8)]
    if ring:
        free = set(itertools.combinations(range(1, 8), 2)) - {line[:2] for line in lines}
        lines.append((*sorted(free)[int(rng.integers(len(free)))], 0.01, 0.01))
    load = [{"p_max_mw": 1.0, "shed_cost_per_mwh": 1.0}]
    grid = [{"import_max_mw": 1.0, "import_cost_per_mwh": 1.0}]
    return small_case(buses=7, lines=lines, load=load, grid=grid)


def sides(case: Case, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Buses on either side of line k of a tree."""
    network = case.network
    reached = np.zeros(7, bool)
    reached[network.from_bus[k]] = True
    for _ in range(7):
        for i, (a, b) in enumerate(zip(network.from_bus, network.to_bus, strict=True)):
            if i != k and (reached[a] or reached[b]):
                reached[[a, b]] = True
    return reached, ~reached


@pytest.mark.parametrize("seed", range(5))
def test_in_a_tree_it_is_what_the_two_sides_can_send_each_other(seed: int) -> None:
    rng = np.random.default_rng(seed)
    case = random_case(rng, ring=False)
    supply, demand = rng.uniform(0, 3, 7), rng.uniform(0, 3, 7)
    for k, limit in enumerate(exchange(case.network, supply, demand)):
        one, other = sides(case, k)
        there = min(supply[one].sum(), demand[other].sum())
        back = min(supply[other].sum(), demand[one].sum())
        assert limit == pytest.approx(max(there, back))


@pytest.mark.parametrize("seed", range(5))
def test_in_a_mesh_it_is_enough_for_any_two_groups_of_buses(seed: int) -> None:
    rng = np.random.default_rng(seed)
    case = random_case(rng, ring=True)
    supply, demand = rng.uniform(0, 1, 7), rng.uniform(0, 1, 7)
    supply[0] = 20.0
    limit = exchange(case.network, supply, demand)
    for group in itertools.product((False, True), repeat=7):
        one = np.array(group)
        assert min(supply[one].sum(), demand[~one].sum()) <= limit.min() + 1e-12
    assert limit.max() <= demand.sum()


@pytest.mark.parametrize("name", ["ieee33", "analytic/two-islands", "analytic/precharge"])
def test_with_its_margin_it_never_binds(name: str) -> None:
    """It is there to keep relaxations from burning energy, not to be a rating."""
    found = solved(load_case(name), "minlp", gap=1e-3)
    limit = found.problem.vectors.upper[found.problem.standard.columns("line.p")]
    flow = np.abs(found["line.p"])
    assert (flow <= limit / MARGIN * 1.1 + 1e-6).all()
    reactive = np.abs(found["line.q"])
    assert (reactive <= limit / MARGIN * 1.1 + 1e-6).all()
