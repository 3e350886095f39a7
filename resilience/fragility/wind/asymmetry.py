r"""How a storm's translation and its inflow bend the wind of a vortex at rest.

The wind is the vortex's own plus a share $c(r)$ of the translation, which is taken out of the
largest wind of the track, or of the profile, before: the track's largest wind contains it. Shares:

- `none`: the vortex alone.
- `climada`: $c = \min(1, R/r)$, as in CLIMADA.
- `phadke2003`: $c = R r / (R^2 + r^2)$, Phadke et al. 2003, one half at $R$.

Inflow, the angle by which the vortex's wind is turned towards the centre (not the translation):

- `phadke2003`: $10 (1 + r/R)$ degrees inside $R$, $20 + 25 (r/R - 1)$ up to $1.2 R$, then 25,
  after Phadke et al. 2003. The widely used code of `stormwindmodel` has $10 + (1 + r/R)$ inside, a
  slip that jumps from 12 to 20 degrees at $R$; it is not copied.
- `phadke2003-land`: 20 degrees more, as `stormwindmodel` has it over land.
- `hubbert1991`: 25 degrees everywhere, as in TCRM after Hubbert et al. 1991.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from resilience.arrays import Floats

Share = Callable[[Floats], Floats]


def none(ratio: Floats) -> Floats:
    """No share of the translation. `ratio` is R / r, as in the others."""
    return np.zeros_like(ratio)


def climada(ratio: Floats) -> Floats:
    """All of it inside R, falling as 1 / r outside."""
    return np.minimum(ratio, 1.0)


def phadke2003(ratio: Floats) -> Floats:
    """One half at R, falling inside and outside."""
    return ratio / (1.0 + ratio * ratio)


ASYMMETRIES: dict[str, Share] = {"none": none, "climada": climada, "phadke2003": phadke2003}


def phadke_angle(ratio: Floats) -> Floats:
    """Inflow angle, degrees; continuous, 20 at R and 25 from 1.2 R on."""
    away = 1.0 / ratio
    return np.where(away < 1.0, 10.0 * (1.0 + away), np.minimum(20.0 + 25.0 * (away - 1.0), 25.0))


def phadke_angle_land(ratio: Floats) -> Floats:
    """Inflow angle over land, degrees."""
    return phadke_angle(ratio) + 20.0


def hubbert_angle(ratio: Floats) -> Floats:
    """Inflow angle, 25 degrees."""
    return np.full_like(ratio, 25.0)


INFLOWS: dict[str, Callable[[Floats], Floats]] = {
    "phadke2003": phadke_angle,
    "phadke2003-land": phadke_angle_land,
    "hubbert1991": hubbert_angle,
}
