r"""A multistage linear program whose future is a Markov chain of modes with noise in every slot.

In slot $t$ and mode $m$ one of a few outcomes $w$ is seen, then the stage is decided:

$$ V_{t,m,w}(x, \theta) = \min_{z} \; c^\top z + F_{t,m}(x', \theta), \qquad
   F_{t,m}(x', \theta) = \sum_{m'} P_t(m' \mid m) \sum_{w'} q_{w'} V_{t+1,m',w'}(x', \theta) $$

$x$ are the stage's states. $\theta$ are *levels*: numbers that are known and stay the same for the
whole path, such as how much sun there is today. Data is affine in them, bounds and right-hand sides
are affine in data, so $V$ is convex in $(x, \theta)$ together and one set of cuts
$F \ge \alpha + \beta^\top x + \gamma^\top \theta$ serves every level (Pereira & Pinto 1991; the
Markov form follows Philpott & de Matos 2012).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from resilience.arrays import Floats
from resilience.models.language.stage import Stage


@dataclass(frozen=True)
class Cuts:
    """future cost >= alpha + beta @ state + gamma @ levels, in $.

    Attributes:
        alpha: (cuts,).
        beta: (cuts, states) $ per unit of the state; minus a water value.
        gamma: (cuts, levels).
    """

    alpha: Floats
    beta: Floats
    gamma: Floats

    @classmethod
    def of_prices(cls, per_unit: Floats, levels: int = 0) -> Cuts:
        """What remains at the end is worth `per_unit`, (states,) $ per unit of each state."""
        return cls(np.zeros(1), -np.asarray(per_unit, float)[None], np.zeros((1, levels)))

    @property
    def n(self) -> int:
        """Number of cuts."""
        return len(self.alpha)

    def constants(self, levels: Floats) -> Floats:
        """(cuts,) the constants of the cuts once the levels are known."""
        return self.alpha + self.gamma @ levels

    def value(self, state: Floats, levels: Floats) -> float:
        """The highest cut, $."""
        return float((self.constants(levels) + self.beta @ state).max())

    def slope(self, state: Floats, levels: Floats) -> Floats:
        """(states,) $ per unit of each state, of the highest cut."""
        return self.beta[np.argmax(self.constants(levels) + self.beta @ state)]

    def __getitem__(self, index: Any) -> Cuts:
        """Some of the cuts: a slice, or an array of indices."""
        return Cuts(self.alpha[index], self.beta[index], self.gamma[index])

    @staticmethod
    def joined(batches: Sequence[Cuts]) -> Cuts:
        """All cuts, one batch behind the other."""
        return Cuts(
            np.concatenate([cuts.alpha for cuts in batches]),
            np.concatenate([cuts.beta for cuts in batches]),
            np.concatenate([cuts.gamma for cuts in batches]),
        )

    def mixed(self, weights: Floats) -> Cuts:
        """(k, cuts) weights to k cuts, each the weighted sum of these: an expectation."""
        return Cuts(weights @ self.alpha, weights @ self.beta, weights @ self.gamma)

    def useful(self, states: Floats, levels: Floats) -> Cuts:
        """The cuts that are highest at one of the points (points, states), (points, levels)."""
        heights = self.alpha + states @ self.beta.T + levels @ self.gamma.T
        return self[np.unique(np.argmax(heights, axis=1))]


@dataclass(frozen=True)
class NoiseOutcomes:
    """What may be seen in one slot and mode.

    Attributes:
        stage: which of the problem's stages it is.
        probability: (outcomes,).
        data: the stage's data, (labels, outcomes, 1 + levels): constants, then what one unit of
            each level adds. Prices may not depend on a level.
    """

    stage: int
    probability: Floats
    data: Mapping[str, Floats]


@dataclass(frozen=True)
class Multistage:
    """The whole problem.

    Attributes:
        stages: all declare the same states in the same order.
        outcomes: by slot, then by mode.
        transition: by slot, (modes of the slot before, modes): rows are distributions. The first
            has one row: how the chain begins.
        terminal: value of the states behind the last slot.
    """

    stages: Sequence[Stage]
    outcomes: Sequence[Sequence[NoiseOutcomes]]
    transition: Sequence[Floats]
    terminal: Cuts

    def __post_init__(self) -> None:
        before = 1
        for t, (modes, chance) in enumerate(zip(self.outcomes, self.transition, strict=True)):
            if chance.shape != (before, len(modes)):
                raise ValueError(
                    f"slot {t}: transitions of shape {chance.shape}, not {(before, len(modes))}"
                )
            for name, rows in [("transitions", chance), *_noise(modes)]:
                if (rows < 0.0).any() or not np.allclose(rows.sum(axis=-1), 1.0):
                    raise ValueError(f"slot {t}: {name} are no distributions")
            before = len(modes)

    @property
    def slots(self) -> int:
        """Number of slots."""
        return len(self.outcomes)

    @property
    def levels(self) -> int:
        """Number of levels."""
        return int(self.terminal.gamma.shape[1])


def _noise(modes: Sequence[NoiseOutcomes]) -> list[tuple[str, Floats]]:
    return [(f"outcomes of mode {m}", mode.probability) for m, mode in enumerate(modes)]
