"""Cuts that come after a program was built: how far they let its future costs move."""

from __future__ import annotations

import numpy as np

from resilience.models.backends.base import LeafCuts
from resilience.models.language.stage import Stage
from resilience.models.language.tree import Tree
from resilience.models.program.standard import Standard
from resilience.models.program.unroll import unroll


def fan() -> Standard:
    """Two stores, of 0.5 to 4 and -1 to 3; two scenarios follow the first node."""
    stage = Stage(1.0)
    now, after = stage.state("store", ["a", "b"], [0.5, -1.0], [4.0, 3.0], unit="MWh")
    stage.eq("kept", after, now)
    parent, chance = np.array([-1, 0, 0]), np.array([1.0, 0.3, 0.7])
    return unroll([stage], Tree(parent, chance, np.zeros(3, int), ("now", "dry", "wet")))


def test_a_future_cost_moves_as_far_as_its_cuts_reach() -> None:
    """Node 2 at first: 9 - 2 a from 1 to 8 and 6 + b from 5 to 9, then 2 + 0.5 a - b from -0.75 to
    5. Of node 1: 7 - 0.5 a + 2 b from 3 to 12.75.
    """
    standard = fan()
    vectors = standard.vectors({}, {"store": [2.0, 2.5]})
    cuts = LeafCuts(standard)
    assert cuts.with_futures_open(vectors) is vectors
    cuts.add(2, np.array([9.0, 6.0]), np.array([[-2.0, 0.0], [0.0, 1.0]]))
    cuts.add(2, np.array([2.0]), np.array([[0.5, -1.0]]))
    cuts.add(1, np.array([7.0]), np.array([[-0.5, 2.0]]))
    opened = cuts.with_futures_open(vectors)
    assert standard.tree.leaves.tolist() == [1, 2]
    assert opened.lower[standard.future].tolist() == [3.0, 5.0]
    assert opened.upper[standard.future].tolist() == [12.75, 9.0]
    others = np.setdiff1d(np.arange(standard.n_columns), standard.future)
    np.testing.assert_array_equal(opened.lower[others], vectors.lower[others])
    assert (vectors.upper[standard.future] == 0.0).all()
