r"""Fragility curves: how likely an element fails in a wind of a given speed.

- `lognormal`: $F(v) = \Phi(\ln(v / m) / \beta)$, median $m$;
- `piecewise`: 0 below `v_crit_mps`, 1 from `v_collapse_mps` on, and in between a straight line, or
  a lognormal where `median_mps` and `beta` are given;
- `tabulated`: straight lines between points, 0 before the first, constant after the last.

A curve says which wind it wants: averaging time, height and exposure. `CURVES` holds the figures of
`curves.toml`, each with its source, how it was obtained, and whether that was checked.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib.resources import files
from tomllib import loads
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr, ndtri

from resilience.arrays import Floats
from resilience.errors import UsageError

Parameters = Mapping[str, Any]
EXPOSURES = ("water", "land")


@dataclass(frozen=True, eq=False)
class Curve:
    """Probability of failure of an element over the speed of the wind.

    Attributes:
        name: of the curve.
        kind: `lognormal`, `piecewise` or `tabulated`.
        parameters: `median_mps` and `beta`; or `v_crit_mps`, `v_collapse_mps` and perhaps the first
            two; or `speed_mps` and `probability`, of the same length and rising.
        averaging_s: of the wind that the curve wants, seconds; 3 is a gust, 60 a one-minute wind.
        height_m: of that wind above the ground, m.
        exposure: of that wind: `water` (open) or `land`.
        source: where the figures come from.
        element: what fails.
        obtained: how the figures were obtained from the source.
        checked: the figures were read in their source or fitted to it, not remembered.
        measure_assumed: the source does not say which wind it means; averaging, height and exposure
            are our choice.

    Raises:
        UsageError: parameters that make no curve; all mistakes are listed.
    """

    name: str
    kind: str
    parameters: Parameters
    averaging_s: float
    height_m: float
    exposure: str
    source: str
    element: str = ""
    obtained: str = ""
    checked: bool = True
    measure_assumed: bool = False

    def __post_init__(self) -> None:
        if self.kind not in _KINDS:
            raise UsageError(
                f"curve {self.name!r}: kind {self.kind!r}; allowed: {', '.join(_KINDS)}",
                hint="most published curves are lognormal",
            )
        wrong = [*_KINDS[self.kind].mistakes(self.parameters), *self._measure_mistakes()]
        if wrong:
            raise UsageError(
                f"curve {self.name!r}: " + "; ".join(wrong),
                hint="speeds are in m/s: 1 kt = 0.514 m/s, 1 mph = 0.447 m/s, 1 km/h = 0.278 m/s",
            )

    def probability(self, speed_mps: ArrayLike) -> Floats:
        """(...) probability of failure at speeds (...) in m/s."""
        return ndtr(self.score(speed_mps))

    def score(self, speed_mps: ArrayLike) -> Floats:
        """(...) standard normal quantile of the probability of failure, infinite at 0 and 1."""
        return _KINDS[self.kind].score(self.parameters, np.asarray(speed_mps, float))

    def speed(self, u: ArrayLike) -> Floats:
        """(...) m/s, the lowest speed at which the probability reaches u; infinite if none does."""
        return _KINDS[self.kind].speed(self.parameters, np.asarray(u, float))

    @property
    def median_mps(self) -> float:
        """Speed at which one element in two fails, m/s."""
        return float(self.speed(0.5))

    @property
    def measure(self) -> str:
        """The wind that the curve wants, in words."""
        return measure(self.averaging_s, self.height_m, self.exposure)

    def _measure_mistakes(self) -> list[str]:
        rules = (
            ("averaging_s", self.averaging_s > 0.0, "seconds above 0"),
            ("height_m", self.height_m > 0.0, "metres above 0"),
            ("exposure", self.exposure in EXPOSURES, " or ".join(EXPOSURES)),
        )
        return [
            f"{key} {getattr(self, key)!r}; allowed: {ok}" for key, good, ok in rules if not good
        ]


def measure(averaging_s: float, height_m: float, exposure: str) -> str:
    """A wind's averaging time, height and exposure in words."""
    return f"{averaging_s:g} s mean at {height_m:g} m over {exposure}"


def hardened(curve: Curve, factor: float) -> Curve:
    """A stronger element: every speed of the curve times `factor`, the same shape.

    Raises:
        UsageError: a factor that is not above 0.
    """
    name = f"{curve.name} x {factor:g}"
    how = f"{factor:g} times the speeds of {curve.name!r}; {curve.obtained}"
    return replace(curve, name=name, parameters=_scaled(curve, factor), obtained=how)


def restated(
    curve: Curve,
    factor: float,
    *,
    averaging_s: float | None = None,
    height_m: float | None = None,
    exposure: str | None = None,
) -> Curve:
    """The same element, over another measure of the wind.

    Args:
        curve: the curve.
        factor: the new measure's speed over the old one's, e.g. 1 / 1.36 from a 3 s gust to the 1
            min mean that goes with it.
        averaging_s: the new averaging time, seconds; as before if omitted.
        height_m: the new height, m.
        exposure: the new exposure.

    Raises:
        UsageError: a factor that is not above 0, or a measure that makes no sense.
    """
    return replace(
        curve,
        name=f"{curve.name}, restated",
        parameters=_scaled(curve, factor),
        averaging_s=curve.averaging_s if averaging_s is None else averaging_s,
        height_m=curve.height_m if height_m is None else height_m,
        exposure=exposure or curve.exposure,
        obtained=f"restated from {curve.measure} by a factor of {factor:g}; {curve.obtained}",
    )


def _scaled(curve: Curve, factor: float) -> Parameters:
    if not 0.0 < factor < np.inf:
        raise UsageError(
            f"curve {curve.name!r} times {factor}; allowed: a factor above 0",
            hint="1.3 makes an element fail in a wind 1.3 times as fast",
        )

    def times(key: str, value: Any) -> Any:
        if not key.endswith("_mps"):
            return value
        return tuple((factor * np.asarray(value)).tolist()) if np.ndim(value) else factor * value

    return {key: times(key, value) for key, value in curve.parameters.items()}


@dataclass(frozen=True)
class _Kind:
    """A kind of curve.

    Attributes:
        mistakes: what is wrong with its parameters.
        score: (...) normal quantile of the probability at speeds (...), m/s.
        speed: (...) m/s, the lowest at which the probability reaches u (...).
    """

    mistakes: Callable[[Parameters], list[str]]
    score: Callable[[Parameters, Floats], Floats]
    speed: Callable[[Parameters, Floats], Floats]


def _numbers(
    parameters: Parameters, needed: tuple[str, ...], optional: tuple[str, ...]
) -> list[str]:
    unknown = [f"unknown parameter {key!r}" for key in parameters if key not in needed + optional]
    missing = [f"parameter {key!r} is missing" for key in needed if key not in parameters]
    low = [f"{k} {v}; allowed: above 0" for k, v in parameters.items() if not 0.0 < v < np.inf]
    return unknown + missing + low


def _lognormal_mistakes(parameters: Parameters) -> list[str]:
    return _numbers(parameters, ("median_mps", "beta"), ())


def _lognormal_score(parameters: Parameters, speed: Floats) -> Floats:
    with np.errstate(divide="ignore"):
        return np.log(speed / parameters["median_mps"]) / parameters["beta"]


def _lognormal_speed(parameters: Parameters, u: Floats) -> Floats:
    return parameters["median_mps"] * np.exp(parameters["beta"] * ndtri(u))


def _piecewise_mistakes(parameters: Parameters) -> list[str]:
    curve = ("median_mps", "beta")
    wrong = _numbers(parameters, ("v_crit_mps", "v_collapse_mps"), curve)
    if len([key for key in curve if key in parameters]) == 1:
        wrong.append("one of median_mps and beta; allowed: both or neither")
    if not wrong and not parameters["v_crit_mps"] < parameters["v_collapse_mps"]:
        wrong.append("v_crit_mps is not below v_collapse_mps")
    return wrong


def _piecewise_score(parameters: Parameters, speed: Floats) -> Floats:
    low, high = parameters["v_crit_mps"], parameters["v_collapse_mps"]
    if "median_mps" in parameters:
        inner = _lognormal_score(parameters, speed)
    else:
        inner = ndtri(np.clip((speed - low) / (high - low), 0.0, 1.0))
    return np.where(speed < low, -np.inf, np.where(speed >= high, np.inf, inner))


def _piecewise_speed(parameters: Parameters, u: Floats) -> Floats:
    low, high = parameters["v_crit_mps"], parameters["v_collapse_mps"]
    inner = _lognormal_speed(parameters, u) if "beta" in parameters else low + u * (high - low)
    return np.where(u <= 0.0, 0.0, np.clip(inner, low, high))


def _tabulated_mistakes(parameters: Parameters) -> list[str]:
    """What is wrong with a table of speeds and probabilities."""
    if set(parameters) != {"speed_mps", "probability"}:
        return [f"parameters {', '.join(parameters)}; allowed: speed_mps and probability"]
    speed, chance = (np.asarray(parameters[key], float) for key in ("speed_mps", "probability"))
    if speed.ndim != 1 or speed.shape != chance.shape or len(speed) < 2:
        return [
            f"tables of {speed.size} speeds and {chance.size} probabilities; allowed: 2 or more"
        ]
    rules = (
        (speed[0] >= 0.0 and (np.diff(speed) > 0).all(), "speeds do not rise from 0 or more"),
        ((np.diff(chance) >= 0).all(), "probabilities fall"),
        (((chance >= 0) & (chance <= 1)).all(), "probabilities outside 0 to 1"),
    )
    return [text for good, text in rules if not good]


def _tabulated_score(parameters: Parameters, speed: Floats) -> Floats:
    chance = np.interp(speed, parameters["speed_mps"], parameters["probability"], left=0.0)
    return ndtri(chance)


def _tabulated_speed(parameters: Parameters, u: Floats) -> Floats:
    speed = np.asarray(parameters["speed_mps"], float)
    chance = np.asarray(parameters["probability"], float)
    after = np.searchsorted(chance, u, side="left")
    upper = np.clip(after, 1, len(speed) - 1)
    rise = chance[upper] - chance[upper - 1]
    share = (u - chance[upper - 1]) / np.where(rise > 0.0, rise, 1.0)
    inner = speed[upper - 1] + np.clip(share, 0.0, 1.0) * (speed[upper] - speed[upper - 1])
    speed_at_u: Floats = np.where(after == 0, speed[0], np.where(u > chance[-1], np.inf, inner))
    return np.where(u <= 0.0, 0.0, speed_at_u)


_KINDS = {
    "lognormal": _Kind(_lognormal_mistakes, _lognormal_score, _lognormal_speed),
    "piecewise": _Kind(_piecewise_mistakes, _piecewise_score, _piecewise_speed),
    "tabulated": _Kind(_tabulated_mistakes, _tabulated_score, _tabulated_speed),
}


def _shipped() -> dict[str, Curve]:
    text = files("resilience.fragility").joinpath("curves.toml").read_text(encoding="utf-8")
    about = {field for field in Curve.__dataclass_fields__ if field not in ("name", "parameters")}
    return {
        name: Curve(
            name=name,
            parameters={key: value for key, value in row.items() if key not in about},
            **{key: value for key, value in row.items() if key in about},
        )
        for name, row in loads(text).items()
    }


CURVES: dict[str, Curve] = _shipped()
