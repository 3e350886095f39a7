"""Sampled outage paths, those that are alike made one of their common probability."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from resilience.arrays import Bools, Floats, Ints

SHARES = (0.25, 0.5, 0.75, 1.0)  # of all paths, for which a program is kept


@dataclass(frozen=True)
class DistinctPaths:
    """Paths that differ, as many as a program is kept for.

    Attributes:
        index: (kept paths,) which of the sampled paths each one is. To fill the program, the last
            may stand there more than once.
        probability: (kept paths,) of each; 0 where it only fills the program.
    """

    index: Ints
    probability: Floats


def distinct_paths(facts: Bools, *, as_sampled: bool = False) -> DistinctPaths:
    """The different ones among equally likely paths.

    Args:
        facts: (facts, paths) what tells paths apart.
        as_sampled: in the order in which they were sampled, else in that of their facts. The order
            decides between plans that cost the same.
    """
    paths = facts.shape[1]
    _, first, count = np.unique(facts, axis=1, return_index=True, return_counts=True)
    if as_sampled:
        order = np.argsort(first)
        first, count = first[order], count[order]
    places = np.arange(_program_paths(len(first), paths))
    filled = np.minimum(places, len(first) - 1)
    probability = np.where(places < len(first), count[filled], 0) / paths
    return DistinctPaths(first[filled], probability)


def _program_paths(distinct: int, paths: int) -> int:
    """Paths of the smallest program that holds the distinct ones: 1, or a share of all."""
    sizes = [1, *(int(np.ceil(paths * share)) for share in SHARES)]
    return next(size for size in sizes if size >= distinct)
