"""What an answer about a storm rests on: field, factors, curves, repair, drawn members."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from resilience.case.networks.read import cables
from resilience.case.schema import GeographyTable, StormTable
from resilience.earth.averaging import relation
from resilience.fragility.lines.strength import curves_of
from resilience.fragility.wind import MODELS
from resilience.fragility.wind.convert import FIELD_KIND, Kind, steps

if TYPE_CHECKING:
    from resilience.fragility.chain import Storm

EXCEPTION_KEYS = ("pole", "hardening", "span_m", "underground")
"""Keys of `[[line]]` that set a line's strength apart."""


def assumptions(storm: Storm) -> dict[str, Any]:
    """Every choice between a track and its failures, as plain data.

    Returns:
        `field`, what it `takes` of a track, `asymmetry`, `inflow`; `points_without_pressure`, where
        Holland's fields keep the wind; `agency` and `averaging_s` of the track's winds, which are
        `agency_factor` times one-minute means plus `agency_offset_kt`; `factors` from those over
        water to the curves' wind, each with its source; `pole`, `conductor` and the `curves`
        themselves; `hardening`, `correlation`, `mode`, `by_angle`, `span_m`; `exceptions`, what
        `[[line]]` says else; `cables`; `repair` with its crews; `forecast` where members are drawn.
    """
    table = storm.case.storm or StormTable()
    stated = {line.name: line.model_dump(include=set(EXCEPTION_KEYS)) for line in storm.case.line}
    return {
        **_wind(storm, table),
        **_lines(storm, table),
        "exceptions": {
            name: keys for name, keys in stated.items() if any(v is not None for v in keys.values())
        },
        "cables": int(cables(storm.case.network, storm.case.line).sum()),
        "repair": {
            "law": storm.repair.law,
            "hours": list(storm.repair.hours),
            "crews": storm.repair.crews,
            "wind_limit_mps": storm.repair.wind_limit_mps,
            "priority": dict(storm.repair.priority),
        },
        "forecast": table.forecast.model_dump(mode="json") if len(storm.members) > 1 else None,
    }


def _wind(storm: Storm, table: StormTable) -> dict[str, Any]:
    """Of the wind that a curve sees."""
    track, felt, model = storm.track, storm.winds[0], MODELS[table.wind]
    agency = relation(track.averaging_s, track.agency)
    from_wind = track.pressure_from_wind
    target = Kind(felt.averaging_s, felt.height_m, felt.exposure)
    return {
        "field": table.wind,
        "takes": model.uses,
        "asymmetry": table.asymmetry or model.asymmetry,
        "inflow": table.inflow,
        "points_without_pressure": 0 if from_wind is None else int((from_wind > 0.0).sum()),
        "agency": track.agency or None,
        "averaging_s": track.averaging_s,
        "agency_factor": agency.factor,
        "agency_offset_kt": agency.offset_kt,
        "factors": [
            {"source": source, "value": float(value.mean())}
            for source, value in steps(FIELD_KIND, target, table.roughness, table.inland_km)
        ],
    }


def _lines(storm: Storm, table: StormTable) -> dict[str, Any]:
    """Of the strength of lines; curves are those that a line of the storm has."""
    poles = {line.name: line.pole or table.pole for line in storm.case.line}
    names = {poles.get(name, table.pole) for name in storm.lines.names}
    names |= {table.conductor} if table.conductor else set()
    every = curves_of(table)
    return {
        "pole": table.pole,
        "conductor": table.conductor,
        "curves": {
            name: {
                "kind": curve.kind,
                **curve.parameters,
                "of": curve.measure,
                "source": curve.source,
            }
            for name, curve in every.items()
            if name in names
        },
        "hardening": table.hardening,
        "correlation": table.correlation,
        "mode": table.mode,
        "by_angle": table.by_angle,
        "span_m": (storm.case.geography or GeographyTable()).span_m,
    }
