r"""Wind fields: tangential wind by distance from the eye, a function each.

All give one-minute means at 10 m over water, m/s, without the share of the translation that is
added to them afterwards (`asymmetry.py`). $r$ is the distance from the eye, $R$ the radius of
maximum wind, $f$ the Coriolis parameter without sign, $\Delta p$ the pressure deficit, $\rho$ =
1.15 kg/m3, $v_m$ the largest wind of the track, $v_t$ the speed of translation and $c(r)$ its
share. Formulas and constants are those of CLIMADA 6.1 except for Willoughby's, which CLIMADA does
not have.

Where the pressure is a regression on the wind, nothing but the wind was stated, and Holland's
fields keep it: they take $b$ from $v_m$ without limits, as Holland et al. 2010 do where they have a
wind, $b = v_m^2 \rho e / \Delta p$. The $b$ of 2008 would make 138 kt of a regressed pressure for
165 kt.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from resilience.arrays import Floats
from resilience.fragility.tracks.fill import DENSITY
from resilience.fragility.wind.asymmetry import Share
from resilience.fragility.wind.eye import Eye
from resilience.fragility.wind.willoughby import willoughby2006

GRADIENT_TO_SURFACE = 0.9
FAR_M, FAR_MPS = 300_000.0, 17.0


@dataclass(frozen=True)
class Model:
    """A wind field.

    Attributes:
        field: `field(r_m, eye, share)` gives the tangential wind (points, times), m/s, at distances
            (points, times), of the storm, with the asymmetry's share of its translation.
        asymmetry: the one it is meant for, a name of `ASYMMETRIES`.
        source: where it comes from.
        uses: what it takes of a track, in words.
    """

    field: Callable[[Floats, Eye, Share], Floats]
    asymmetry: str
    source: str
    uses: str


def holland1980(r_m: Floats, eye: Eye, share: Share) -> Floats:
    r"""Holland 1980, from pressure and the track's wind.

    $B = v_g^2 e \rho / \Delta p$ between 1 and 2.5 with the gradient wind $v_g = (v_m - c(R)
    v_t)/0.9$, and $v = 0.9 (\sqrt{(B/\rho) (R/r)^B \Delta p\, e^{-(R/r)^B} + (rf/2)^2} - rf/2)$.
    Where the limits of B hold, the largest wind is not the track's; a pressure that is a regression
    on the wind has none.
    """
    top = np.maximum(eye.vmax_mps - share(np.ones(1)) * eye.speed_mps, 0.0) / GRADIENT_TO_SURFACE
    b = np.clip(_b_of_wind(eye, top, 0.0), 1.0, 2.5)
    b = _b(eye, b, top, _turning(eye))
    return GRADIENT_TO_SURFACE * _gradient(r_m, eye, b)


def holland2008(r_m: Floats, eye: Eye, share: Share) -> Floats:
    r"""Holland 2008: surface winds from pressure alone; a wind stated beside it is not used.

    The formula of 1980 without the factor, with $b$ of `_b_2008`, less $c(r) v_t$.
    """
    v = _gradient(r_m, eye, _b(eye, _b_2008(eye), eye.vmax_mps, _turning(eye)))
    return _less(v, r_m, eye, share)


def holland2010(r_m: Floats, eye: Eye, share: Share) -> Floats:
    r"""Holland et al. 2010: $v = v_s ((R/r)^b e^{1 - (R/r)^b})^x$, less $c(r) v_t$.

    $v_s = \sqrt{b \Delta p / \rho e}$; $x$ = 0.5 inside $R$, outside linear to the value that
    gives 17 m/s at 300 km, and at least 0.4. From $R$ = 300 km on that point says nothing of the
    outside: $x$ = 0.4 there, to which CLIMADA's line comes. From pressure alone.
    """
    b = _b(eye, _b_2008(eye), eye.vmax_mps, 0.0)
    top = np.sqrt(b * eye.deficit_pa / (DENSITY * math.e))
    far = (eye.rmw_m / FAR_M) ** b
    fall = np.minimum(np.log(far) + 1.0 - far, -1e-9)
    x_far = np.log(FAR_MPS / np.maximum(top, 1e-9)) / fall
    slope = (x_far - 0.5) / np.maximum(FAR_M - eye.rmw_m, 1.0)
    slope[eye.rmw_m >= FAR_M] = -1.0  # per metre: to 0.4 within a step
    q, log_q = _power(r_m, eye, b)
    x = np.maximum(0.5 + np.maximum(r_m - eye.rmw_m, 0.0) * slope, 0.4)
    v = top * np.exp(x * (log_q + 1.0 - q))
    return _less(v, r_m, eye, share)


def emanuel2011(r_m: Floats, eye: Eye, share: Share) -> Floats:
    r"""Emanuel and Rotunno 2011, eq. 36: $v = M/r$, $M = (R v_m + f R^2/2)\, 2z/(1+z)$.

    Here $z = (r/R)^2$. From the track's wind alone. As in CLIMADA the translation is added without
    being taken out, and the Earth's part of the angular momentum is left in $v$: it is $f R / 2$
    at $R$.
    """
    ratio = r_m / eye.rmw_m
    top = eye.vmax_mps + 0.5 * eye.coriolis_per_s * eye.rmw_m * (eye.vmax_mps > 0)
    return 2.0 * top * ratio / (1.0 + ratio * ratio)


MODELS: dict[str, Model] = {
    "holland1980": Model(
        holland1980, "climada", "Holland 1980, Mon. Wea. Rev. 108, 1212", "wind and pressure"
    ),
    "holland2008": Model(
        holland2008, "climada", "Holland 2008, Mon. Wea. Rev. 136, 3432", "pressure"
    ),
    "holland2010": Model(
        holland2010, "climada", "Holland et al. 2010, Mon. Wea. Rev. 138, 4393", "pressure"
    ),
    "emanuel2011": Model(emanuel2011, "climada", "Emanuel and Rotunno 2011, JAS 68, 2236", "wind"),
    "willoughby2006": Model(
        willoughby2006, "phadke2003", "Willoughby et al. 2006, Mon. Wea. Rev. 134, 1102", "wind"
    ),
}


def _b(eye: Eye, stated: Floats, v_mps: Floats, turning_mps: Floats | float) -> Floats:
    """(times,) b: `stated` where the pressure was stated, that of the wind where it was not."""
    share = eye.pressure_from_wind
    of_wind = _b_of_wind(eye, v_mps, turning_mps)
    return np.where(share > 0.0, share * of_wind, 0.0) + (1.0 - share) * stated


def _b_of_wind(eye: Eye, v_mps: Floats, turning_mps: Floats | float) -> Floats:
    r"""(times,) b with which $\sqrt{b \Delta p/(\rho e) + (t/2)^2} - t/2$ is v, t being turning."""
    square = v_mps * (v_mps + turning_mps)
    return DENSITY * math.e * square / np.maximum(eye.deficit_pa, 1e-6)


def _turning(eye: Eye) -> Floats:
    """(times,) m/s of the Earth at R, which a gradient wind lacks."""
    return eye.rmw_m * eye.coriolis_per_s


def _b_2008(eye: Eye) -> Floats:
    r"""(times,) $b$ of surface winds, between 0.81 and 2.025.

    $-4.4 \cdot 10^{-5} \Delta p^2 + 0.01 \Delta p + 0.03\, dp_c/dt - 0.014 |\varphi| + 0.15 v_t^x
    + 1$, hPa and hours, $x = 0.6 (1 - \Delta p / 215)$ (Holland 2008, eq. 11).
    """
    dp = eye.deficit_pa / 100.0
    moving = eye.speed_mps ** np.maximum(0.6 * (1.0 - dp / 215.0), 1e-3)
    b = -4.4e-5 * dp**2 + 0.01 * dp + 0.03 * eye.rise_hpa_per_h - 0.014 * np.abs(eye.lat)
    return np.clip(b + 0.15 * moving + 1.0, 0.81, 2.025)


def _power(r_m: Floats, eye: Eye, b: Floats) -> tuple[Floats, Floats]:
    """(R/r)^b and its logarithm."""
    log_q = np.log(eye.rmw_m) - np.log(r_m)
    log_q *= b
    return np.exp(log_q), log_q


def _gradient(r_m: Floats, eye: Eye, b: Floats) -> Floats:
    """Gradient wind of Holland's pressure profile; the difference of roots without cancellation."""
    q, log_q = _power(r_m, eye, b)
    square = np.exp(log_q - q)
    square *= b * eye.deficit_pa / DENSITY
    turning = r_m * (0.5 * eye.coriolis_per_s)
    root = np.sqrt(square + turning * turning)
    root += turning
    np.maximum(root, 1e-12, out=root)
    square /= root
    return square


def _less(v: Floats, r_m: Floats, eye: Eye, share: Share) -> Floats:
    """The wind less the share of the translation, not below zero."""
    v -= share(eye.rmw_m / r_m) * eye.speed_mps
    return np.maximum(v, 0.0, out=v)
