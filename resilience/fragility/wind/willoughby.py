r"""Willoughby, Darling and Rahn 2006: a power of r inside, two exponentials outside, and a bridge.

With the gradient wind $v = (v_m - c(R) v_t)/0.9$, latitude $\varphi$ in degrees, lengths in km:

- inside $v (r/R)^n$, $n = 0.4067 + 0.0144 v - 0.0038 \varphi$;
- outside $v ((1 - A) e^{-(r - R)/X_1} + A e^{-(r - R)/X_2})$, $X_1 = 317.1 - 2.026 v + 1.915
  \varphi$, $X_2 = 25$, $A = 0.0696 + 0.0049 v - 0.0064 \varphi$, at least 0;
- from $R_1$ over 25 km (15 km where $R$ is below 20 km) the weight of the outside rises as $w(\xi)
  = 126 \xi^5 - 420 \xi^6 + 540 \xi^7 - 315 \xi^8 + 70 \xi^9$, which is the regularised incomplete
  beta function $I_\xi(5, 5)$. $R_1$ puts $w(R) = n L / (n L + R)$, $L = (1 - A) X_1 + A X_2$, at
  $R$ (eq. 3 as coded in stormwindmodel), so that the wind at $R$ is $v$ and very nearly the
  largest.

To the surface by 0.9 up to 100 km from the eye, falling to 0.75 at 700 km (Knaff et al. 2011 as
coded in stormwindmodel). The track's radius of maximum wind is used, not the paper's regression.
"""

from __future__ import annotations

import numpy as np

from resilience.arrays import Floats
from resilience.fragility.wind.asymmetry import Share
from resilience.fragility.wind.eye import Eye

SECOND_KM = 25.0


def willoughby2006(r_m: Floats, eye: Eye, share: Share) -> Floats:
    """Tangential wind (points, times) of `r_m` (points, times), from the track's wind alone."""
    from scipy.special import betainc, betaincinv

    radius, lat = eye.rmw_m / 1000.0, np.abs(eye.lat)
    v = np.maximum(eye.vmax_mps - share(np.ones(1)) * eye.speed_mps, 0.0) / 0.9
    n = np.maximum(0.4067 + 0.0144 * v - 0.0038 * lat, 0.05)
    first = np.maximum(317.1 - 2.026 * v + 1.915 * lat, SECOND_KM)
    a = np.clip(0.0696 + 0.0049 * v - 0.0064 * lat, 0.0, 1.0)
    length = (1.0 - a) * first + a * SECOND_KM
    width = np.where(radius > 20.0, 25.0, 15.0)
    start = radius - width * betaincinv(5, 5, n * length / (n * length + radius))

    r = r_m / 1000.0
    away = np.maximum(r - radius, -width)
    speed: Floats = a * np.exp(-away / SECOND_KM)
    speed += (1.0 - a) * np.exp(-away / first)
    weight = (r - start) / width
    inner = weight < 1.0  # the bridge, and what is inside it: a small part of most grids
    _, when = np.nonzero(inner)
    power = np.exp(np.log(r[inner] / radius[when]) * n[when])
    share_out = betainc(5, 5, np.clip(weight[inner], 0.0, 1.0))
    speed[inner] = power + share_out * (speed[inner] - power)
    speed *= v
    speed *= to_surface(r)
    return speed


def to_surface(r_km: Floats) -> Floats:
    """Factor from gradient level to 10 m over water, by distance from the eye."""
    return 0.9 - 0.15 * np.clip((r_km - 100.0) / 600.0, 0.0, 1.0)
