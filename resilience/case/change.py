"""Changing a case: another horizon, other outages, other values. The result is checked anew."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Callable, Iterable, Mapping
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

from resilience.case.cloud import bare_profile
from resilience.case.data import Case, Outage
from resilience.case.document import Document
from resilience.case.outages import OutageWords, outage_texts, parse_outages
from resilience.case.reading import in_toml
from resilience.case.schema import DEVICES, PVTable, Table
from resilience.case.starter.in_memory import feeder_of_net, is_pandapower, network_tables
from resilience.case.window import Window
from resilience.errors import UsageError, did_you_mean, shortened

_HORIZON = ("start", "slots", "step_min")
_TABLES = {"outage", "geography", "storm", "blackout", "plan"}
_HEAD = (
    "name",
    "description",
    "terminal_value_per_mwh",
    "loss_cost_per_mwh",
    "reserve_price_per_mwh",
)


def replace_case(case: Case, changes: dict[str, Any], build: Callable[[Document], Case]) -> Case:
    """A changed copy of a case; see `Case.replace`.

    Args:
        case: the case.
        changes: new values by key of the case.
        build: reads and checks a document.

    Raises:
        CaseError: the result is no valid case.
        UsageError: a key that cannot be replaced, or outages that do not fit.
    """
    lists = {*DEVICES, "line", "tank"}
    replaceable = {*_HORIZON, *_HEAD, *lists, *_TABLES, "profiles", "outages", "network"}
    for key in [key for key in changes if key not in replaceable]:
        hint = did_you_mean(key, sorted(replaceable), max_listed=len(replaceable))
        raise UsageError(f"{key} of a case cannot be replaced", hint)
    data = copy.deepcopy(case.source)
    data.pop("outages", None)
    data |= {key: changes[key] for key in _HEAD if key in changes}
    for kind in lists & changes.keys():
        data[kind] = _stated(kind, changes[kind])
        data.get("defaults", {}).pop(kind, None)
    for key in changes.keys() & _TABLES:
        value = changes[key]
        data[key] = plain(value) if isinstance(value, Table) else value
    if "network" in changes:
        data |= _network(changes["network"])
    if "profiles" in changes:
        data["profiles"] = {"columns": _columns(changes["profiles"])}
    elif any(key in changes for key in _HORIZON):
        _shift_columns(case, data, changes)
    data["time"] = {key: changes.get(key, getattr(case, key)) for key in _HORIZON}
    moved = build(Document(case.path, data))
    outages = _outages(case, moved, changes.get("outages"))
    data["outages"] = outage_texts(outages, moved.window)
    return dataclasses.replace(moved, outages=outages)


def plain(table: Table) -> dict[str, Any]:
    """A table as plain data with every value spelled out, except those that are absent.

    A profile that the storm's cloud reduces is written as it is in a clear sky: the cloud follows.
    """
    return _bare(table).model_dump(by_alias=True, exclude_none=True, warnings=False)


def _bare(table: Table) -> Table:
    if isinstance(table, PVTable):
        return table.model_copy(update={"profile": bare_profile(table.profile)})
    return table


def _stated(kind: str, tables: object) -> list[dict[str, Any]]:
    """Tables as plain data, without what follows from other keys.

    Raises:
        UsageError: they are no tables.
    """
    entries = list(tables) if isinstance(tables, Iterable) else [tables]
    sound = [table for table in entries if isinstance(table, Table | Mapping)]
    if len(sound) < len(entries):
        raise UsageError(
            f"{kind} of a case: {shortened(repr(entries))}; allowed: tables",
            hint=f"case.with_{kind}(NAME, key=value) changes one of them",
        )
    return [
        _bare(table).model_dump(
            by_alias=True, exclude_none=True, exclude_unset=True, warnings=False
        )
        if isinstance(table, Table)
        else in_toml(table)
        for table in sound
    ]


def _network(value: object) -> dict[str, Any]:
    """`[network]`, and `[[line]]` where a network in memory tells of its lines.

    Raises:
        UsageError: it is no network.
    """
    if is_pandapower(value):
        return network_tables(feeder_of_net(value), [])
    if not isinstance(value, Mapping):
        raise UsageError(
            f"network of a case: {shortened(repr(value))}; allowed: a table, or a network of "
            "pandapower",
            hint='network={"pandapower": "case33bw"}',
        )
    return {"network": in_toml(value)}


def _columns(profiles: Mapping[str, Iterable[float]]) -> dict[str, list[float]]:
    """Profiles as a case file has them.

    Raises:
        UsageError: they are no numbers.
    """
    try:
        return {name: [float(v) for v in values] for name, values in profiles.items()}
    except (TypeError, ValueError, AttributeError) as error:
        raise UsageError(
            f"profiles of a case: {error}; allowed: names with a number per slot",
            hint='{"demand": [0.5, 0.7, ...]}',
        ) from None


def _shift_columns(case: Case, data: dict[str, Any], changes: dict[str, Any]) -> None:
    """Cuts inline profiles, which start with the horizon, to start with the new one."""
    columns = data.get("profiles", {}).get("columns", {})
    if not columns:
        return
    start = changes.get("start", case.start)
    if not isinstance(start, datetime) or start.tzinfo is not None:
        return  # the horizon is refused
    offset = (start - case.start) / timedelta(minutes=case.step_min)
    step_min = changes.get("step_min", case.step_min)
    if step_min != case.step_min or offset < 0 or offset != int(offset):
        raise UsageError(
            f"inline profiles start at {case.start} with a step of {case.step_min:g} min, "
            f"the new horizon at {start} with {step_min:g} min",
            "put the profiles into a file, or replace them too",
        )
    data["profiles"]["columns"] = {k: list(v)[int(offset) :] for k, v in columns.items()}


def _outages(
    old: Case, new: Case, replacement: str | Path | Iterable[Outage | OutageWords] | None
) -> tuple[Outage, ...]:
    if replacement is None:
        return _moved(old.outages, old.window, new.window)
    if isinstance(replacement, str | Path):
        return parse_outages(replacement, new)
    if isinstance(replacement, Outage):
        replacement = (replacement,)
    entries = tuple(replacement)
    if words := [entry for entry in entries if isinstance(entry, str | tuple)]:
        return parse_outages(words, new)
    outages = tuple(entry for entry in entries if isinstance(entry, Outage))
    if len(outages) < len(entries):
        raise UsageError(
            f"{len(entries)} outages, not all of them such; allowed: `Outage`, or texts",
            hint='outages=["6-26@14:00-17:30"]',
        )
    for outage in outages:
        if outage.line not in new.units:
            new.network.line(outage.line)
        if not 0 <= outage.first < outage.stop <= new.slots:
            span = f"outage of {outage.line} in slots {outage.first} to {outage.stop}"
            raise UsageError(span, f"0 <= first < stop <= {new.slots}")
    return outages


def _moved(outages: Iterable[Outage], old: Window, new: Window) -> tuple[Outage, ...]:
    placed = []
    for outage in outages:
        first, stop = new.span(old.time(outage.first), old.time(outage.stop))
        if first < stop:
            placed.append(Outage(outage.line, first, stop))
    return tuple(placed)
