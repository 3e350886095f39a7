"""Affine expressions against dense matrices: whatever is done to one is done to the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from resilience.arrays import Floats
from resilience.models.algebra import Affine, scatter, stack
from tests.property.random_cases import quick

WIDTH = 4  # variables, and as many data


@dataclass
class Pair:
    """The same vector twice: as triplets, and as coefficients (n, variables | data) + constant."""

    affine: Affine
    dense: Floats
    const: Floats

    def check(self) -> None:
        found = np.zeros_like(self.dense)
        ids = np.where(self.affine.ids >= 0, self.affine.ids, WIDTH + ~self.affine.ids)
        np.add.at(found, (self.affine.rows, ids), self.affine.values)
        assert found == pytest.approx(self.dense)
        assert self.affine.const == pytest.approx(self.const)
        assert self.affine.n == len(self.const)
        assert self.affine.has_variables or not self.dense[:, :WIDTH].any()
        assert self.affine.has_data or not self.dense[:, WIDTH:].any()


def leaf(ids: list[int]) -> Pair:
    dense = np.zeros((len(ids), 2 * WIDTH))
    dense[np.arange(len(ids)), [k if k >= 0 else WIDTH + ~k for k in ids]] = 1.0
    return Pair(Affine.of_ids(np.array(ids)), dense, np.zeros(len(ids)))


def apply(pair: Pair, other: Pair, kind: str, rng: np.random.Generator) -> Pair:
    a, m, c, n = pair.affine, pair.dense, pair.const, len(pair.const)
    v = rng.integers(-3, 4, n).astype(float)
    matrix = rng.integers(-2, 3, (rng.integers(1, 5), n)).astype(float)
    index = rng.integers(n, size=rng.integers(1, 5))
    place = rng.permutation(n + 2)[:n]
    spread = np.zeros((n + 2, n))
    spread[place, np.arange(n)] = 1.0
    matches = len(other.const) in (1, n) or n == 1
    mask = v >= 0
    options = {
        "negate": lambda: (-a, -m, -c),
        "scale": lambda: (a * v, m * v[:, None], c * v),
        "scale from the left": lambda: (2.0 * a, 2.0 * m, 2.0 * c),
        "shift": lambda: (a + v, m, c + v),
        "shift from the left": lambda: (v - a, -m, v - c),
        "map": lambda: (a.mapped(matrix), matrix @ m, matrix @ c),
        "sum": lambda: (a.sum(), m.sum(0)[None], c.sum()[None]),
        "pick": lambda: (a[index], m[index], c[index]),
        "mask": lambda: (a[mask], m[mask], c[mask]) if mask.any() else (a, m, c),
        "one": lambda: (a[n - 1], m[n - 1 :], c[n - 1 :]),
        "scatter": lambda: (scatter(a, place, n + 2), spread @ m, spread @ c),
        "stack": lambda: (
            stack([a, other.affine]),
            np.vstack([m, other.dense]),
            np.append(c, other.const),
        ),
        "add": lambda: (
            (a + other.affine, m + other.dense, c + other.const) if matches else (a, m, c)
        ),
        "subtract": lambda: (
            (a - other.affine, m - other.dense, c - other.const) if matches else (a, m, c)
        ),
    }
    return Pair(*options[kind]())


KINDS = [
    "negate", "scale", "scale from the left", "shift", "shift from the left", "map", "sum",
    "pick", "mask", "one", "scatter", "stack", "add", "subtract",
]  # fmt: skip
ids = st.lists(st.integers(-WIDTH, WIDTH - 1), min_size=1, max_size=4)


@quick
@given(ids, ids, st.lists(st.sampled_from(KINDS), min_size=1, max_size=8), st.integers(0, 99))
def test_what_is_done_to_an_expression_is_done_to_its_matrix(
    first: list[int], second: list[int], kinds: list[str], seed: int
) -> None:
    rng = np.random.default_rng(seed)
    pair, other = leaf(first), leaf(second)
    for kind in kinds:
        pair = apply(pair, other, kind, rng)
        pair.check()


@pytest.mark.parametrize("kind", KINDS)
def test_every_operation_by_itself(kind: str) -> None:
    for other in ([1, -2, 0], [3]):
        apply(leaf([0, -1, 0]), leaf(other), kind, np.random.default_rng(0)).check()


def test_one_expression_stretches_over_many_numbers() -> None:
    one, many = leaf([2]).affine, np.array([1.0, 2.0, 3.0])
    assert (one * many).n == (one + many).n == (many - one).n == 3
    assert (many - one).const.tolist() == many.tolist()
    assert (one * many).values.tolist() == many.tolist()


@pytest.mark.parametrize("other", [leaf([0, 1]).affine, np.ones(2)], ids=["affine", "numbers"])
def test_lengths_that_do_not_fit_are_refused(other: object) -> None:
    with pytest.raises(ValueError, match=r"combine|broadcast"):
        leaf([0, 1, 2]).affine + other
    with pytest.raises((ValueError, TypeError)):
        leaf([0, 1, 2]).affine * other  # type: ignore[operator]
