"""What of a case's lines breaks in a wind: curves of poles and conductors, the case's own too."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from resilience.arrays import Floats, Ints
from resilience.case.reading import show
from resilience.case.schema import CurveTable, LineTable, StormTable
from resilience.errors import CaseError, Mistake, UsageError, did_you_mean
from resilience.fragility.lines.curves import CURVES, Curve, measure
from resilience.fragility.lines.spans import SpannedLines, poles_in_series
from resilience.fragility.tracks.fill import RADII
from resilience.fragility.wind import ASYMMETRIES, INFLOWS, MODELS, ROUGHNESS

if TYPE_CHECKING:
    from resilience.case import Case

_MEASURE = frozenset(["kind", "averaging_s", "height_m", "exposure", "source"])


def check_names(case: Case) -> None:
    """Checks what a storm names: fields, options, curves, before anything is worked out.

    Raises:
        CaseError: names that nothing has, or curves with mistakes; all of them are listed.
    """
    file = case.file_name
    mistakes = [Mistake(file, *finding) for finding in _findings(case)]
    if mistakes:
        raise CaseError(mistakes)


def lines_of(
    case: Case,
    names: Sequence[str],
    span_line: Ints,
    bearing_deg: Floats | None = None,
    factors: Mapping[str, float] | None = None,
) -> SpannedLines:
    """Lines of a case with the strength that the case gives each.

    Args:
        case: the case.
        names: of the lines.
        span_line: (spans,) index in `names` of the line that a span belongs to.
        bearing_deg: (spans,) directions, if only the wind across counts.
        factors: what multiplies the strength of some lines besides.

    Raises:
        KeyError: a curve that nothing has; see `check_names`.
    """
    table = case.storm or StormTable()
    curves = curves_of(table)
    tables = {line.name: line for line in case.line}
    lines = [tables.get(name, LineTable(name=name)) for name in names]
    more = factors or {}
    strength = {
        line.name: (line.hardening or table.hardening) * more.get(line.name, 1.0) for line in lines
    }
    return poles_in_series(
        names, span_line, pole=[curves[line.pole or table.pole] for line in lines],
        conductor=curves[table.conductor] if table.conductor else None,
        hardened_by=strength, correlation=table.correlation, bearing_deg=bearing_deg,
    )  # fmt: skip


def storm_curve(case: Case) -> Curve:
    """The curve of the storm's poles, which says what wind is wanted."""
    table = case.storm or StormTable()
    return curves_of(table)[table.pole]


def curves_of(table: StormTable) -> dict[str, Curve]:
    """Curves by name: those of the package, and the case's own.

    Raises:
        UsageError: parameters that make no curve.
    """
    return CURVES | {name: _curve(name, curve) for name, curve in table.curves.items()}


def _curve(name: str, table: CurveTable) -> Curve:
    parameters = table.model_dump(exclude_none=True)
    about = {key: parameters.pop(key) for key in _MEASURE}
    return Curve(name=name, parameters=parameters, element="of the case", **about)


def _findings(case: Case) -> Iterator[tuple[str, str, str, str, str]]:
    """Yields `(table, key, value, allowed, hint)`."""
    table = case.storm or StormTable()
    for curve_name, curve in table.curves.items():
        try:
            _curve(curve_name, curve)
        except UsageError as error:
            where = f"[storm.curves.{curve_name}]"
            yield where, "", str(error.message), "a curve", error.hint
    curves = [*CURVES, *table.curves]
    uses = [
        *((*use, curves) for use in _uses(case, table)),
        ("[storm]", "wind", table.wind, MODELS),
        ("[storm]", "asymmetry", table.asymmetry, ASYMMETRIES),
        ("[storm]", "inflow", table.inflow, INFLOWS),
        ("[storm]", "roughness", table.roughness, ROUGHNESS),
        ("[storm]", "rmw", table.rmw, RADII),
    ]
    for where, key, name, allowed in uses:
        if name is not None and name not in allowed:
            yield where, key, show(name), ", ".join(allowed), did_you_mean(name, allowed)
    yield from _other_winds(case, table)
    if table.roughness == "tchazards" and table.inland_km is None:
        hint = "or leave roughness out: knaff2011 needs no distance"
        yield "[storm]", "inland_km", "nothing", "km from the coast", hint


def _uses(case: Case, table: StormTable) -> Iterator[tuple[str, str, str | None]]:
    """Yields `(table, key, name)` of every curve that a case names."""
    yield "[storm]", "pole", table.pole
    yield "[storm]", "conductor", table.conductor
    for line in case.line:
        yield f"[[line]] {line.name}", "pole", line.pole


def _other_winds(case: Case, table: StormTable) -> Iterator[tuple[str, str, str, str, str]]:
    """Yields curves that want another wind than the poles' does: one wind is worked out."""
    measures = {name: curve.measure for name, curve in CURVES.items()}
    for name, curve in table.curves.items():
        measures[name] = measure(curve.averaging_s, curve.height_m, curve.exposure)
    poles_measure = measures.get(table.pole)
    for where, key, curve_name in _uses(case, table):
        curve_measure = measures.get(curve_name or "", poles_measure)
        if poles_measure is not None and curve_measure != poles_measure:
            hint = "restate the curve in [storm.curves] for that wind; no factor is implied"
            yield (
                where,
                key,
                f"{curve_name}, over a {curve_measure}",
                f"curves over a {poles_measure}",
                hint,
            )
