"""A linear program part by part against the whole of it."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from resilience.models.backends import parted
from resilience.models.backends.parted import Linear, optimum


def blocks(rng: np.random.Generator, sizes: tuple[int, ...]) -> Linear:
    """Feasible programs side by side, their columns shuffled, and a column in no row at all."""
    above = sp.block_diag([rng.normal(size=(n + 1, n)) for n in sizes], format="csr")
    equal = sp.block_diag([rng.normal(size=(1, n)) for n in sizes], format="csr")
    order = rng.permutation(above.shape[1] + 1)
    above, equal = (
        sp.csr_array(sp.hstack([a, sp.csr_array((a.shape[0], 1))], format="csr")[:, order])
        for a in (above, equal)
    )
    inside = rng.uniform(-1.0, 1.0, len(order))
    cost = rng.normal(size=len(order))
    room = rng.uniform(0.0, 1.0, above.shape[0])
    ends = np.full(len(order), 2.0)
    return Linear(cost, above, above @ inside + room, equal, equal @ inside, -ends, ends)


@pytest.mark.parametrize("at_least", [1, 4, 1000])
def test_the_optimum_is_that_of_the_whole(at_least: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parted, "PART_COLUMNS", at_least)
    rng = np.random.default_rng(at_least)
    for _ in range(10):
        linear = blocks(rng, (3, 1, 5, 2))
        whole = optimum(linear, 60.0, parted=False)
        by_part = optimum(linear, 60.0, parted=True)
        assert whole is not None
        assert by_part == pytest.approx(whole, abs=1e-6)


def test_parts_have_no_row_in_common_and_are_as_small_as_can_be(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(parted, "PART_COLUMNS", 1)
    linear = blocks(np.random.default_rng(2), (3, 1, 5, 2))
    number = parted.parts(linear)
    assert sorted(np.bincount(number)) == [1, 1, 2, 3, 5]
    for a in (linear.a_ub, linear.a_eq):
        assert all(len(set(number[row])) == 1 for row in np.split(a.indices, a.indptr[1:-1]))


def test_a_part_without_a_point_leaves_none_to_the_whole() -> None:
    linear = blocks(np.random.default_rng(3), (3, 2))
    wrong = linear._replace(b_eq=linear.b_eq + np.array([0.0, 1e3]))
    assert optimum(wrong, 60.0, parted=True) is None
    assert optimum(linear, 0.0, parted=True) is None
