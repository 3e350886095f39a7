r"""Lines as poles and spans in series, in a wind by span.

$$ P_\text{line} = 1 - (1 - p_\text{cond})^n \prod_i (1 - F_\text{pole}(v_i)) $$

Capacities of one storm share a factor $Z \sim N(0, 1)$, so that the conditional probability of an
element is

$$ F(v \mid Z) = \Phi\left(\frac{\Phi^{-1}(F(v)) - \sqrt\rho Z}{\sqrt{1 - \rho}}\right) $$

(for a lognormal curve $\ln C = \ln m + \beta (\sqrt\rho Z + \sqrt{1 - \rho} \varepsilon)$),
elements are independent given $Z$, and what is wanted is an integral over $Z$. It is done by the
trapezoidal rule, with a step that follows $\rho$ and an error below 1e-9 (Gauss-Hermite of 60
points: 1e-3 at $\rho = 0.9$). $\rho = 1$ leaves the weakest element alone, exactly.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from scipy.sparse import csr_array
from scipy.special import log_ndtr, ndtr

from resilience.arrays import Bools, Floats, Ints
from resilience.errors import UsageError
from resilience.fragility.lines.curves import CURVES, Curve, hardened, measure

MAX_Z = 8.5  # beyond, a standard normal variable has a probability of 1e-17


class WindAtSpans(Protocol):
    """A wind by span and slot, and what its speed is a speed of."""

    @property
    def speed_mps(self) -> Floats:
        """(spans, slots) m/s."""

    @property
    def direction_deg(self) -> Floats | None:
        """(spans, slots) towards which it blows, degrees clockwise from north."""

    @property
    def averaging_s(self) -> float:
        """Averaging time, seconds."""

    @property
    def height_m(self) -> float:
        """Above the ground, m."""

    @property
    def exposure(self) -> str:
        """`water` or `land`."""


@dataclass(frozen=True, eq=False)
class SpanWind:
    """A wind given by span, wherever it comes from.

    Attributes:
        speed_mps: (spans, slots) m/s.
        averaging_s: averaging time, seconds.
        height_m: above the ground, m.
        exposure: `water` or `land`.
        direction_deg: (spans, slots) towards which it blows, degrees clockwise from north.
        strongest_mps: (spans, slots) strongest wind of a slot whatever its direction, where
            `speed_mps` is that of the moment that is hardest on a span; crews wait for it.
    """

    speed_mps: Floats
    averaging_s: float
    height_m: float
    exposure: str
    direction_deg: Floats | None = None
    strongest_mps: Floats | None = None


@dataclass(frozen=True, eq=False)
class Series:
    """Elements of one kind along the lines.

    Attributes:
        curve: of each of them.
        count: (spans,) how many of them a span has; 0 where it has none.
    """

    curve: Curve
    count: Floats


@dataclass(frozen=True, eq=False)
class SpannedLines:
    """Lines as spans in a row, and what stands or hangs along them.

    A line fails when any of its elements, a pole or a span's conductor, does.

    Attributes:
        names: of the lines.
        span_line: (spans,) index of the line that a span belongs to.
        series: what stands or hangs along the spans.
        correlation: of capacities within a storm, 0 to 1.
        bearing_deg: (spans,) direction of each span, degrees clockwise from north. Given, only the
            wind across a span counts, v |sin|; otherwise all of it.

    Raises:
        UsageError: arrays that do not match, or values out of range; all of them are listed.
    """

    names: tuple[str, ...]
    span_line: Ints
    series: tuple[Series, ...]
    correlation: float = 0.3
    bearing_deg: Floats | None = None

    def __post_init__(self) -> None:
        spans = len(self.span_line)
        bearing = self.bearing_deg
        rules = [
            (bool(self.series), "no series of elements; allowed: one or more"),
            (0.0 <= self.correlation <= 1.0, f"correlation {self.correlation}; allowed: 0 to 1"),
            (
                bool(((self.span_line >= 0) & (self.span_line < len(self.names))).all()),
                f"span of an unknown line; allowed: 0 to {len(self.names) - 1}",
            ),
            (
                bearing is None or (len(bearing) == spans and bool(np.isfinite(bearing).all())),
                f"bearings; allowed: {spans} numbers, one a span",
            ),
        ]
        for series in self.series:
            rules.append(
                (series.count.shape == (spans,), f"{series.curve.name}: counts; allowed: {spans}")
            )
            rules.append((bool((series.count >= 0).all()), f"{series.curve.name}: a count below 0"))
        wrong = [text for good, text in rules if not good]
        if wrong:
            raise UsageError("lines: " + "; ".join(wrong), hint="arrays have an entry per span")

    @cached_property
    def element_span(self) -> Ints:
        """(elements,) span of each group of like elements, one series after the other."""
        return np.concatenate([np.flatnonzero(series.count > 0) for series in self.series])

    @cached_property
    def element_line(self) -> Ints:
        """(elements,) line of each group of like elements."""
        return self.span_line[self.element_span]

    @cached_property
    def incidence(self) -> csr_array:
        """(lines, elements) how many elements of a group belong to a line."""
        count = np.concatenate([series.count[series.count > 0] for series in self.series])
        places = (self.element_line, np.arange(len(count)))
        return csr_array((count, places), shape=(len(self.names), len(count)))


def poles_in_series(
    names: Sequence[str],
    span_line: Ints,
    *,
    pole: Curve | Sequence[Curve] | None = None,
    conductor: Curve | None = None,
    hardened_by: Mapping[str, float] | None = None,
    correlation: float = 0.3,
    bearing_deg: Floats | None = None,
) -> SpannedLines:
    """Lines with a pole, and perhaps a conductor that may fail, in every span.

    Args:
        names: of the lines.
        span_line: (spans,) index of the line that a span belongs to.
        pole: curve of one pole, or a curve per line; `CURVES["pole"]` if omitted.
        conductor: curve of the conductors of one span; they do not fail if omitted.
        hardened_by: lines whose poles and conductors stand speeds so many times as high.
        correlation: see `SpannedLines`.
        bearing_deg: see `SpannedLines`.

    Raises:
        UsageError: a hardened line that does not exist, or as `SpannedLines`.
    """
    poles = [pole or CURVES["pole"]] * len(names) if isinstance(pole, Curve | None) else list(pole)
    factors = dict(hardened_by or {})
    unknown = [name for name in factors if name not in names]
    if unknown:
        raise UsageError(
            f"hardened line {', '.join(unknown)}; allowed: {', '.join(names)}",
            hint="a line is named by its ends, like 6-26",
        )
    factor = [factors.get(name, 1.0) for name in names]
    series = _alike(poles, factor, span_line)
    if conductor is not None:
        series += _alike([conductor] * len(names), factor, span_line)
    return SpannedLines(tuple(names), span_line, tuple(series), correlation, bearing_deg)


def _alike(curves: Sequence[Curve], factors: Sequence[float], span_line: Ints) -> list[Series]:
    """A series for every different curve and factor among the lines."""
    kinds = list(zip(curves, factors, strict=True))
    return [
        Series(
            curve if factor == 1.0 else hardened(curve, factor),
            np.array([kind == (curve, factor) for kind in kinds])[span_line].astype(float),
        )
        for curve, factor in dict.fromkeys(kinds)
    ] or [Series(CURVES["pole"], np.zeros(0))]


def span_speed(lines: SpannedLines, wind: WindAtSpans) -> Floats:
    """(spans, slots) m/s, the speed that the curves see.

    Raises:
        UsageError: a wind that is not what a curve wants, has the wrong shape or is not a number;
            all of it is listed.
    """
    speed = np.asarray(wind.speed_mps, float)
    has = measure(wind.averaging_s, wind.height_m, wind.exposure)
    wrong = [
        f"the wind is a {has}; curve {series.curve.name!r} wants a {series.curve.measure}"
        for series in lines.series
        if series.curve.measure != has
    ]
    if speed.ndim != 2 or len(speed) != len(lines.span_line):
        wrong.append(
            f"the wind has the shape {speed.shape}; allowed: ({len(lines.span_line)}, slots)"
        )
    if not (np.isfinite(speed).all() and (speed >= 0.0).all()):
        wrong.append("speeds that are negative or no numbers; allowed: 0 m/s or more")
    if lines.bearing_deg is not None:
        wrong += _direction_mistakes(wind.direction_deg, speed.shape)
    if wrong:
        raise UsageError(
            "wind at the spans: " + "; ".join(wrong),
            hint="convert the wind with `to`, or the curve with `restated`; no factor is implied",
        )
    if lines.bearing_deg is None or wind.direction_deg is None:
        return speed
    across = np.sin(np.radians(wind.direction_deg - lines.bearing_deg[:, None]))
    return speed * np.abs(across)


def _direction_mistakes(direction_deg: Floats | None, shape: tuple[int, ...]) -> list[str]:
    if direction_deg is None:
        return ["spans have a bearing, the wind has no direction"]
    if np.shape(direction_deg) != shape:
        return [f"directions of shape {np.shape(direction_deg)}; allowed: {shape}, as the speeds"]
    if not np.isfinite(direction_deg).all():
        return ["directions that are no numbers; allowed: degrees clockwise from north"]
    return []


def calm(lines: SpannedLines, wind: WindAtSpans, limit_mps: float) -> Bools:
    """(lines, slots) True where no span of a line is in a wind above a limit."""
    strongest = wind.strongest_mps if isinstance(wind, SpanWind) else None
    speed = wind.speed_mps if strongest is None else strongest
    windy = np.zeros((len(lines.names), speed.shape[1]), bool)
    np.logical_or.at(windy, lines.span_line, speed > limit_mps)
    return ~windy


def factor_nodes(correlation: float) -> tuple[Floats, Floats]:
    """(k,) values of Z and weights adding up to 1, for integrals over the common factor."""
    if correlation == 0.0 or correlation == 1.0:
        return np.zeros(1), np.ones(1)
    kappa = np.sqrt(correlation / (1.0 - correlation))
    half = int(np.ceil(MAX_Z / (0.25 * min(1.0, 1.0 / kappa))))
    z = np.linspace(-MAX_Z, MAX_Z, 2 * half + 1)
    weight = np.exp(-(z**2) / 2)
    return z, weight / weight.sum()


def scores(lines: SpannedLines, speed_mps: Floats) -> Floats:
    """(elements, ...) normal quantile of each element's probability at speeds (spans, ...)."""
    by_series = [series.curve.score(speed_mps[series.count > 0]) for series in lines.series]
    return np.concatenate(by_series)


def log_standing(lines: SpannedLines, score: Floats, z: Floats) -> Floats:
    """(lines, k) log of the chance that lines stand, given scores (elements,) and Z (k,).

    At correlation 1 Z is everybody's capacity, as a score: the result is 0 or -inf.
    """
    rho = lines.correlation
    if rho == 1.0:
        return np.where(z > worst_score(lines, score)[:, None], 0.0, -np.inf)
    element = log_ndtr((np.sqrt(rho) * z - score[:, None]) / np.sqrt(1.0 - rho))
    return lines.incidence @ element


def worst_score(lines: SpannedLines, score: Floats) -> Floats:
    """(lines, ...) highest score of a line's elements (elements, ...)."""
    worst = np.full((len(lines.names), *score.shape[1:]), -np.inf)
    np.maximum.at(worst, lines.element_line, score)
    return worst


def failure_probability(lines: SpannedLines, wind: WindAtSpans) -> Floats:
    """(lines,) probability that a line fails in the storm, one capacity per element and storm.

    Raises:
        UsageError: as `span_speed`.
    """
    score = scores(lines, span_speed(lines, wind).max(axis=1))
    if lines.correlation == 1.0:
        return ndtr(worst_score(lines, score))
    z, weight = factor_nodes(lines.correlation)
    return -np.expm1(log_standing(lines, score, z)) @ weight


def joint_probability(
    lines: SpannedLines, wind: WindAtSpans, names: Sequence[str] | None = None
) -> float:
    """Probability that all of some lines, or all of all, fail in the storm.

    Raises:
        UsageError: an unknown line, or as `span_speed`.
    """
    unknown = [name for name in names or () if name not in lines.names]
    if unknown:
        raise UsageError(
            f"line {', '.join(unknown)}; allowed: {', '.join(lines.names)}",
            hint="a line is named by its ends, like 6-26",
        )
    chosen = [lines.names.index(name) for name in names or lines.names]
    score = scores(lines, span_speed(lines, wind).max(axis=1))
    if lines.correlation == 1.0:
        return float(ndtr(worst_score(lines, score)[chosen].min()))
    z, weight = factor_nodes(lines.correlation)
    failed = -np.expm1(log_standing(lines, score, z)[chosen])
    return float(failed.prod(axis=0) @ weight)
