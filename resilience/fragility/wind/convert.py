"""From one kind of wind to another: averaging time, height, exposure, each factor with its source.

A conversion goes through the one-minute mean at 10 m, the kind that wind fields give. What has no
source here is refused:

- **averaging time**, at 10 m: `AVERAGING`. Those of Harper, Kepert and Ginger 2010 (WMO/TD-No.
  1555), at sea and in-land: gusts of 3 s, as quoted by stormwindmodel; ten minutes at sea by their
  0.93 for sustained winds, in-land by the gust factor 1.21 of a minute in ten. 0.2 s is TCRM's.
  Between ten minutes and a gust of 3 s their own factor, for gust factors do not compose.
- **exposure**, one-minute means at 10 m: `ROUGHNESS`, a factor over land.
- **height**, means over a minute or more: the logarithmic profile with the roughness lengths of
  Eurocode 1 (EN 1991-1-4, table 4.1): 0.003 m for the sea, 0.05 m for open country. Gusts at other
  heights are refused: the factors hold at 10 m.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from resilience.arrays import Floats
from resilience.errors import UsageError

EXPOSURES = ("water", "land")
REFERENCE_HEIGHT_M = 10.0
SUSTAINED_S = 60.0
GUST_S = 3.0


class Kind(NamedTuple):
    """What a wind speed is.

    Attributes:
        averaging_s: it is a mean over so long, s.
        height_m: above the ground.
        exposure: `water` or `land`, what lies upwind.
    """

    averaging_s: float
    height_m: float
    exposure: str

    def __str__(self) -> str:
        return f"{self.averaging_s:g} s at {self.height_m:g} m over {self.exposure}"


FIELD_KIND = Kind(SUSTAINED_S, REFERENCE_HEIGHT_M, "water")
"""What the wind of a field is."""


class Factor(NamedTuple):
    """A factor of the one-minute mean at 10 m.

    Attributes:
        value: of the factor.
        source: where it comes from; empty where it is 1.
    """

    value: float
    source: str


AVERAGING: dict[tuple[str, float], Factor] = {
    ("water", 60.0): Factor(1.0, ""),
    ("land", 60.0): Factor(1.0, ""),
    ("water", 3.0): Factor(1.11, "Harper 2010, at sea"),
    ("land", 3.0): Factor(1.49, "Harper 2010, in-land"),
    ("water", 600.0): Factor(0.93, "Harper 2010, at sea"),
    ("land", 600.0): Factor(1.0 / 1.21, "Harper 2010, in-land"),
    ("land", 0.2): Factor(1.35, "TCRM"),
}
GUST_OF_TEN_MINUTES: dict[str, Factor] = {
    "water": Factor(1.23, "Harper 2010, at sea, 3 s in 600 s"),
    "land": Factor(1.66, "Harper 2010, in-land, 3 s in 600 s"),
}
"""Gust factors do not compose: by way of a minute it would be 1.80 over land."""
ROUGHNESS_LENGTH_M = {"water": 0.003, "land": 0.05}
LOWEST_M, HIGHEST_M = 2.0, 200.0


def knaff(inland_km: Floats) -> Floats:
    """0.8 over land, however far (Knaff et al. 2011, as coded in stormwindmodel)."""
    return np.full_like(inland_km, 0.8)


def tchazards(inland_km: Floats) -> Floats:
    """0.66 + 0.34 exp(-d/0.4) at a distance of d km from the coast (TCHazaRds)."""
    return 0.66 + 0.34 * np.exp(-inland_km / 0.4)


ROUGHNESS: dict[str, Callable[[Floats], Floats]] = {"knaff2011": knaff, "tchazards": tchazards}


def factor(
    source: Kind, target: Kind, roughness: str, inland_km: ArrayLike | None
) -> tuple[Floats, list[str]]:
    """The factor from one kind of wind to another, (points, 1) or (1, 1), and its names.

    Raises:
        UsageError: a conversion without a source, or a roughness without what it needs.
    """
    value, names = np.ones((1, 1)), list[str]()
    for name, step in steps(source, target, roughness, inland_km):
        value = value * step
        names.append(name if name.startswith(roughness) else f"{name}: {step.item():.3g}")
    return value, names


def steps(
    source: Kind, target: Kind, roughness: str, inland_km: ArrayLike | None
) -> list[tuple[str, Floats]]:
    """The factors that lead from one kind of wind to another, each with its source.

    Returns:
        Source and value, (points, 1) or (1, 1); that from water to land, or back, comes last.

    Raises:
        UsageError: a conversion without a source, or a roughness without what it needs.
    """
    if source == target:
        return []
    gust = _gust_of_ten_minutes(source, target)
    if gust is not None:
        return [(gust.source, np.full((1, 1), gust.value))]
    factors = list[tuple[str, Floats]]()
    for kind, power in ((source, -1), (target, 1)):
        if kind.exposure not in EXPOSURES:
            raise UsageError(
                f"exposure {kind.exposure!r}; allowed: {', '.join(EXPOSURES)}",
                hint="a wind field blows over water",
            )
        for step in (_averaging(kind), _height(kind)):
            if step.source:
                factors.append((step.source, np.full((1, 1), step.value**power)))
    if source.exposure != target.exposure:
        reduction = _land(roughness, inland_km)
        value = reduction if target.exposure == "land" else 1.0 / reduction
        factors.append((f"{roughness}: {source.exposure} to {target.exposure}", value))
    return factors


def _gust_of_ten_minutes(source: Kind, target: Kind) -> Factor | None:
    """The factor between a mean over ten minutes and a gust in it, if that is what is asked."""
    if source[1:] != target[1:] or source.height_m != REFERENCE_HEIGHT_M:
        return None
    gust = GUST_OF_TEN_MINUTES.get(source.exposure)
    if gust is None or {source.averaging_s, target.averaging_s} != {GUST_S, 10 * SUSTAINED_S}:
        return None
    return gust if target.averaging_s == GUST_S else Factor(1.0 / gust.value, gust.source)


def _averaging(kind: Kind) -> Factor:
    averaging = AVERAGING.get((kind.exposure, kind.averaging_s))
    if averaging is None:
        allowed = ", ".join(f"{s:g}" for where, s in sorted(AVERAGING) if where == kind.exposure)
        raise UsageError(
            f"no factor between means over 60 s and {kind.averaging_s:g} s over {kind.exposure}; "
            f"allowed: {allowed} s",
            hint="the largest winds of a track are converted by agency: `tracks.one_minute`",
        )
    return averaging


def _height(kind: Kind) -> Factor:
    if kind.height_m == REFERENCE_HEIGHT_M:
        return Factor(1.0, "")
    if kind.averaging_s < SUSTAINED_S or not LOWEST_M <= kind.height_m <= HIGHEST_M:
        raise UsageError(
            f"no factor between heights of 10 m and {kind.height_m:g} m for {kind}; allowed: "
            f"{LOWEST_M:g} to {HIGHEST_M:g} m for means over {SUSTAINED_S:g} s or more",
            hint="gust factors hold at 10 m",
        )
    z0 = ROUGHNESS_LENGTH_M[kind.exposure]
    value = math.log(kind.height_m / z0) / math.log(REFERENCE_HEIGHT_M / z0)
    return Factor(value, f"log profile, z0 {z0:g} m")


def _land(roughness: str, inland_km: ArrayLike | None) -> Floats:
    """(points, 1) or (1, 1) factor from water to land."""
    if roughness not in ROUGHNESS:
        raise UsageError(
            f"roughness {roughness!r}; allowed: {', '.join(ROUGHNESS)}",
            hint="knaff2011 needs no distance from the coast",
        )
    if roughness == "tchazards" and inland_km is None:
        raise UsageError(
            "roughness 'tchazards' without inland_km; allowed: km from the coast, (points,)",
            hint="knaff2011 needs no distance",
        )
    distance = np.atleast_1d(np.asarray(0.0 if inland_km is None else inland_km, float))
    if not (distance >= 0.0).all():
        raise UsageError(
            f"inland_km {distance.min():g}; allowed: 0 or more", hint="winds over land lie inland"
        )
    return ROUGHNESS[roughness](distance)[:, None]
