r"""Failure over time: how a wind that rises and falls adds up to a probability.

- `running_max` (the default): an element has one capacity per storm and fails in the first slot
  whose wind reaches it. With the running maximum $M_t$ the hazard is
  $h_t = (F(M_t) - F(M_{t-1})) / (1 - F(M_{t-1}))$, and $\prod (1 - h_t) = 1 - F(M_T)$ whatever the
  step.
- `rate`: $F$ is the probability of failure in `reference_h` hours of that wind, and so a rate,
  $\lambda(v) = -\ln(1 - F(v)) / h_\text{ref}$. The step does not matter, the time in the wind does.
- `per_slot`: $F$ is drawn anew in every slot, as many papers do. The result depends on the step,
  which is warned of.

All are exact: integrals over the common factor as in `spans.py`. At correlation 1 the three are the
same, for then a storm either breaks an element in a slot or never does.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from resilience.arrays import Floats
from resilience.errors import UsageError
from resilience.fragility.lines.spans import (
    SpannedLines,
    WindAtSpans,
    factor_nodes,
    log_standing,
    scores,
    span_speed,
    worst_score,
)

MODES = ("running_max", "rate", "per_slot")


@dataclass(frozen=True)
class Timing:
    """How winds add up over time.

    Attributes:
        mode: `running_max`, `rate` or `per_slot`.
        step_h: length of a slot, hours.
        reference_h: hours of wind that a curve's probability refers to, in mode `rate`.

    Raises:
        UsageError: a value out of range; all of them are listed.
    """

    mode: str = "running_max"
    step_h: float = 0.25
    reference_h: float = 1.0

    def __post_init__(self) -> None:
        rules = (
            ("mode", self.mode in MODES, ", ".join(MODES)),
            ("step_h", 0.0 < self.step_h < np.inf, "above 0"),
            ("reference_h", 0.0 < self.reference_h < np.inf, "above 0"),
        )
        wrong = [f"{k} {getattr(self, k)!r}; allowed: {ok}" for k, good, ok in rules if not good]
        if wrong:
            raise UsageError("timing: " + "; ".join(wrong), hint="running_max suits a single storm")
        if self.mode == "per_slot":
            warnings.warn(
                f"mode per_slot draws anew every {60 * self.step_h:g} min: half the step means "
                "twice the draws, and more failures; running_max does not depend on the step",
                UserWarning,
                stacklevel=3,
            )

    @property
    def weight(self) -> float:
        """Of a slot in the sum of log survival, where slots add up."""
        return self.step_h / self.reference_h if self.mode == "rate" else 1.0


RUNNING_MAX = Timing()


def accumulated(lines: SpannedLines, score: Floats, z: Floats, timing: Timing) -> Floats:
    """(lines, slots, k) minus the log of the chance to stand up to and with a slot, given Z (k,).

    Args:
        lines: the lines.
        score: (elements, slots) of their elements, see `lines.scores`.
        z: (k,) values of the common factor.
        timing: how slots add up.
    """
    hazard = np.zeros((len(lines.names), score.shape[1], len(z)))
    slots = range(score.shape[1])
    if timing.mode == "running_max":
        peak = np.maximum.accumulate(score, axis=1)
        rises = peak > -np.inf
        rises[:, 1:] &= peak[:, 1:] > peak[:, :-1]
        for t in slots:
            if rises[:, t].any():
                hazard[:, t] = -log_standing(lines, peak[:, t], z)
            elif t:
                hazard[:, t] = hazard[:, t - 1]
        return hazard
    for t in slots:
        hazard[:, t] = -timing.weight * log_standing(lines, score[:, t], z)
    return np.cumsum(hazard, axis=1, out=hazard)


def failed_by(lines: SpannedLines, wind: WindAtSpans, timing: Timing = RUNNING_MAX) -> Floats:
    """(lines, slots) probability that a line has failed by the end of a slot, nothing repaired.

    Raises:
        UsageError: as `span_speed`.
    """
    score = scores(lines, span_speed(lines, wind))
    if lines.correlation == 1.0:
        return ndtr(np.maximum.accumulate(worst_score(lines, score), axis=1))
    z, weight = factor_nodes(lines.correlation)
    return -np.expm1(-accumulated(lines, score, z, timing)) @ weight


def first_failure(lines: SpannedLines, wind: WindAtSpans, timing: Timing = RUNNING_MAX) -> Floats:
    """(lines, slots) probability that a line fails in a slot for the first time.

    Raises:
        UsageError: as `span_speed`.
    """
    return np.diff(failed_by(lines, wind, timing), axis=1, prepend=0.0)


def hazard(lines: SpannedLines, wind: WindAtSpans, timing: Timing = RUNNING_MAX) -> Floats:
    """(lines, slots) probability that a line fails in a slot, given that it stood until then.

    0 where it has surely failed before.

    Raises:
        UsageError: as `span_speed`.
    """
    failed = failed_by(lines, wind, timing)
    before = np.zeros_like(failed)
    before[:, 1:] = failed[:, :-1]
    chance = np.zeros_like(failed)
    return np.divide(failed - before, 1.0 - before, out=chance, where=before < 1.0)
