"""Rules within one device table: what must hold between its keys, and what is plausible."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from resilience.case.schema.fields import MAX_PRICE_PER_MWH
from resilience.tolerances import INPUT_TOLERANCE

_HOURS = (0.02, 200.0)

Finding = tuple[str, str, str, str]
"""`(key, value, allowed, hint)`."""


@dataclass(frozen=True)
class KeyRule:
    """One fact about a kind of device, checked where all the keys it `needs` are known.

    The first of them is the key that a message names.
    """

    kind: str
    needs: tuple[str, ...]
    broken: Callable[[Any], bool]
    allowed: str
    hint: str


def _outside_band(d: Any) -> bool:
    inside = d.soc_min - INPUT_TOLERANCE <= d.soc_initial <= d.soc_max + INPUT_TOLERANCE
    return bool(d.soc_min <= d.soc_max and not inside)


def _strange_duration(d: Any) -> bool:
    return bool(d.p_max_mw > 0 and not _HOURS[0] <= d.e_mwh / d.p_max_mw <= _HOURS[1])


def _bad_curve(d: Any) -> bool:
    p = [point[0] for point in d.cost_curve]
    if len(p) < 2 or any(b <= a for a, b in pairwise(p)):
        return True
    return bool(p[0] > d.p_min_mw + INPUT_TOLERANCE or p[-1] < d.p_max_mw - INPUT_TOLERANCE)


def _ramped_start_below_minimum(d: Any) -> bool:
    ramped = d.ramp_up_mw_per_h is not None or d.ramp_down_mw_per_h is not None
    return bool(ramped and d.initial_on and d.p_initial_mw < d.p_min_mw - INPUT_TOLERANCE)


RULES = (
    KeyRule(
        "ess",
        ("soc_min", "soc_max"),
        lambda d: d.soc_min > d.soc_max,
        "at most soc_max = {soc_max:g}",
        "swap the two limits, or lower soc_min",
    ),
    KeyRule(
        "ess",
        ("soc_initial", "soc_min", "soc_max"),
        _outside_band,
        "soc_min = {soc_min:g} to soc_max = {soc_max:g}",
        "set soc_initial inside the band",
    ),
    KeyRule(
        "ess",
        ("e_mwh", "p_max_mw"),
        _strange_duration,
        f"{_HOURS[0]:g} h to {_HOURS[1]:g} h at p_max_mw = {{p_max_mw:g}}",
        "one of e_mwh and p_max_mw is probably in kWh or kW",
    ),
    KeyRule(
        "generator",
        ("p_min_mw", "p_max_mw"),
        lambda d: d.p_min_mw > d.p_max_mw,
        "at most p_max_mw = {p_max_mw:g}",
        "swap the two limits, or lower p_min_mw",
    ),
    KeyRule(
        "generator",
        ("q_min_mvar", "q_max_mvar"),
        lambda d: d.q_min_mvar > d.q_max_mvar,
        "at most q_max_mvar = {q_max_mvar:g}",
        "swap the two limits",
    ),
    KeyRule(
        "generator",
        ("cost_curve", "p_min_mw", "p_max_mw"),
        _bad_curve,
        "two points or more, p_mw rising from at most {p_min_mw:g} to at least {p_max_mw:g}",
        "write [[p_mw, cost_per_h], ...] over the whole range p_min_mw to p_max_mw",
    ),
    KeyRule(
        "generator",
        ("p_initial_mw", "p_max_mw"),
        lambda d: d.p_initial_mw > d.p_max_mw,
        "at most p_max_mw = {p_max_mw:g}",
        "lower p_initial_mw",
    ),
    KeyRule(
        "generator",
        ("p_initial_mw", "initial_on"),
        lambda d: d.p_initial_mw > 0 and not d.initial_on,
        "0 while initial_on = false",
        "set initial_on = true, or p_initial_mw = 0",
    ),
    KeyRule(
        "generator",
        ("p_initial_mw", "initial_on", "p_min_mw"),
        _ramped_start_below_minimum,
        "at least p_min_mw = {p_min_mw:g} while initial_on = true, since ramps start there",
        "set p_initial_mw to the output before the first slot",
    ),
)


def broken_rules(kind: str, device: Any) -> Iterator[Finding]:
    """Yield what is wrong within one device table."""
    for rule in RULES:
        values = {key: getattr(device, key, None) for key in rule.needs}
        if rule.kind == kind and None not in values.values() and rule.broken(device):
            key, value = next(iter(values.items()))
            found = f"{value:g}" if isinstance(value, float | int) else _curve_text(value)
            yield key, found, rule.allowed.format(**values), rule.hint
    for key in type(device).model_fields:
        price = getattr(device, key)
        if key.endswith("_per_mwh") and price is not None and abs(price) > MAX_PRICE_PER_MWH:
            allowed = f"at most {MAX_PRICE_PER_MWH:,.0f} per MWh"
            yield key, f"{price:g}", allowed, "prices are per MWh, not per kWh or per MW of a year"


def _curve_text(curve: Any) -> str:
    return "p_mw = " + ", ".join(f"{point[0]:g}" for point in curve)
