r"""The angle of a complex number: what closes the loops of a meshed feeder.

$$ \theta = \operatorname{atan2}(i, r), \qquad r \ge 0 $$

Arguments: theta, re, im, and the squares of two numbers of which re + j im is the one times the
conjugate of the other, in rad and in one unit that is the same in every program. Each square is a
multiple of one column. What the angle is does not depend on them; the relaxation may.

- Scaled violation: |theta - atan2(im, re)|, or by how much re falls below 0 if that is more. Where
  both are 0 no angle is told.
- Exact rewrite: none in linear or conic programs;  im cos(theta) = re sin(theta)  with
  re cos(theta) + im sin(theta) >= 0, which half a turn more breaks, and |theta| <= pi / 2. A
  quotient or a tangent would have poles.
- Relaxation: linear and conic programs leave it out, or take rows that follow from the products of
  several numbers (`resilience.models.program.cliques`).

Source: the angle condition of the branch flow model, Farivar and Low (2013), eqs. 27-28.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from resilience.arrays import Bools, Floats
from resilience.models.structures.base import Structure

NO_NUMBER = 1e-9
"""Length of (re, im) below which there is no angle."""


class Angle(Structure):
    """`theta = atan2(im, re)` with re >= 0."""

    title = "angle"
    complaint = "angles open"
    dimensionless = True

    def violation(self, args: Sequence[Floats], limits: Sequence[Floats]) -> Floats:
        """See the module's docstring."""
        theta, re, im, *_ = args
        apart = np.abs(theta - np.arctan2(im, np.maximum(re, 0.0)))
        apart = np.where(np.hypot(re, im) > NO_NUMBER, apart, 0.0)
        return np.maximum(apart, np.maximum(-re, 0.0))

    def bound_arguments(self, moving: Sequence[Bools], args: Sequence[Floats]) -> Bools:
        """Elements in which something moves; of zero, theta says nothing."""
        theta, re, im, *_ = moving
        return np.any([re, im, theta & (np.hypot(args[1], args[2]) > NO_NUMBER)], axis=0)
