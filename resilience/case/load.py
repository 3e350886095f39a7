"""`load_case`: from a case file to a checked, immutable `Case`."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from resilience.arrays import Floats
from resilience.case.change import replace_case
from resilience.case.checks.blackout import check_blackout
from resilience.case.checks.checks import check_parts
from resilience.case.checks.geography import check_geography
from resilience.case.checks.parts import Parts
from resilience.case.checks.plan import SITES, check_plan
from resilience.case.checks.reserve import check_reserve
from resilience.case.checks.storm import check_storm
from resilience.case.cloud import under_cloud
from resilience.case.data import CASES_FROM, Case, Outage
from resilience.case.deliveries import delivery_profiles
from resilience.case.document import (
    Document,
    Finding,
    Place,
    TomlTable,
    document_of,
    find_case,
    read_document,
)
from resilience.case.inline import read_inline
from resilience.case.networks.feeder import FeederError
from resilience.case.networks.omissions import Omission
from resilience.case.networks.read import cables, finish_network, read_feeder
from resilience.case.outages import place_outages, split_specs
from resilience.case.profiles import read_profiles
from resilience.case.reading import in_toml, read_list, read_table, show, unknown_key
from resilience.case.schema import (
    DEVICES,
    BlackoutTable,
    DeviceTable,
    GeographyTable,
    HeadTable,
    LineTable,
    NetworkTable,
    OutageTable,
    PlanTable,
    ProfilesTable,
    StormTable,
    TankTable,
    TimeTable,
    UnitTable,
    case_table,
    defaults_table,
)
from resilience.case.starter.in_memory import tables_of_net
from resilience.case.tariff import tariff_profiles
from resilience.case.window import DAY_MIN, FIRST_YEAR, LAST_YEAR, Window
from resilience.errors import CaseError, did_you_mean


def load_case(ref: str | os.PathLike[str]) -> Case:
    """A case by name (`ieee33`, `analytic/island`) or by the path of its file.

    Raises:
        CaseError: every mistake in the file.
        UsageError: there is no such case.
    """
    return build_case(read_document(find_case(ref)))


def case_from_tables(tables: Mapping[str, Any]) -> Case:
    """See `Case.from_dict`."""
    return build_case(document_of(in_toml(tables)))


def case_from_net(net: object, tables: Mapping[str, Any]) -> Case:
    """See `Case.from_pandapower`."""
    return build_case(document_of(in_toml(tables), tables_of_net(net)))


CASES_FROM["tables"] = case_from_tables
CASES_FROM["net"] = case_from_net


def build_case(document: Document) -> Case:
    """The case that a merged case file describes.

    Raises:
        CaseError: every mistake in the file.
    """
    if document.mistakes:
        raise CaseError(document.mistakes)
    head = _read_head(document)
    parts = Parts(document, window=_read_window(document))
    entries = read_list(LineTable, "line", document.data.get("line", []), document, ("line",))
    parts.lines = [(table, title) for table, title, _ in entries]
    tanks = read_list(TankTable, "tank", document.data.get("tank", []), document, ("tank",))
    parts.tanks = [(table, title) for table, title, _ in tanks]
    _read_weather(parts)
    _read_network(parts)
    for kind, device in DEVICES.items():
        tables = read_list(device.table, kind, document.data.get(kind, []), document, (kind,))
        parts.devices[kind] = [(table, title) for table, title, _ in tables]
    outage = _read_outage(document)
    check_parts(parts)
    if parts.storm is not None or parts.geography is not None or parts.inline.buses:
        check_geography(parts)
    if parts.storm is not None:
        check_storm(parts, parts.storm)
    if parts.blackout is not None:
        check_blackout(parts, parts.blackout)
    check_plan(parts)
    profiles = _read_profiles(parts)
    outages = _read_outages(parts, head)
    if head.reserve_price_per_mwh is not None and not document.mistakes:
        check_reserve(parts, head.reserve_price_per_mwh)
    if document.mistakes or parts.network is None or parts.window is None:
        raise CaseError(document.mistakes)
    path, window = document.path, parts.window
    devices = _finished_devices(parts, profiles, window)
    return Case(
        name=head.name or (path.stem if path else "case"),
        description=head.description,
        path=path,
        network=parts.network,
        start=window.start,
        slots=window.slots,
        step_min=window.step_min,
        devices=devices,
        line=tuple(line for line, _ in parts.lines),
        tank=tuple(tank for tank, _ in parts.tanks),
        profiles=profiles,
        outages=outages,
        outage=outage,
        geography=parts.geography,
        storm=parts.storm,
        blackout=parts.blackout,
        plan=parts.plan,
        places=parts.places,
        omissions=parts.omissions,
        terminal_value_per_mwh=head.terminal_value_per_mwh,
        loss_cost_per_mwh=head.loss_cost_per_mwh,
        reserve_price_per_mwh=head.reserve_price_per_mwh,
        source=document.data,
        rebuild=_rebuild,
    )


def _finished_devices(
    parts: Parts, profiles: dict[str, Floats], window: Window
) -> dict[str, tuple[DeviceTable, ...]]:
    """The tables of every kind; profiles of a cloud, of tariffs and of deliveries are added."""
    devices: dict[str, tuple[DeviceTable, ...]] = {
        kind: tuple(table for table, _ in entries) for kind, entries in parts.devices.items()
    }
    if parts.storm is not None:
        plants = (table for table, _ in parts.devices["pv"])
        devices["pv"], reduced = under_cloud(plants, profiles, parts)
        profiles |= reduced
    grids = [table for table, _ in parts.devices["grid"] if table.tariff is not None]
    if grids:
        profiles |= tariff_profiles(grids, profiles, window)
    profiles |= delivery_profiles((tank for tank, _ in parts.tanks), window)
    return devices


def _rebuild(case: Case, changes: dict[str, Any]) -> Case:
    return replace_case(case, changes, build_case)


def _read_head(document: Document) -> HeadTable:
    table = case_table()
    for key in [key for key in document.data if key not in table.model_fields]:
        document.add((key,), "", key, *unknown_key(table, key))
    data = document.data.items()
    raw = {key: value for key, value in data if key in HeadTable.model_fields}
    head, _ = read_table(HeadTable, raw, document, "", ())
    defaults = document.data.get("defaults", {})
    read_table(defaults_table(), defaults, document, "[defaults]", ("defaults",))
    return head


def _read_outage(document: Document) -> OutageTable:
    raw = document.data.get("outage", {})
    table, sound = read_table(OutageTable, raw, document, "[outage]", ("outage",))
    if sound and table.duration_slots[0] > table.duration_slots[1]:
        value, allowed = show(list(table.duration_slots)), "[shortest, longest]"
        where, hint = ("outage", "duration_slots"), "swap the two numbers"
        document.add(where, "[outage]", "duration_slots", value, allowed, hint)
    return table


def _read_weather(parts: Parts) -> None:
    """Reads `[geography]`, `[storm]`, `[blackout]` and `[plan]` if any; an unsound one stands as
    it is.
    """
    data, document = parts.document.data, parts.document
    if data.get("geography") is not None:
        where = ("geography",)
        parts.geography = read_table(
            GeographyTable, data["geography"], document, "[geography]", where
        )[0]
    if data.get("storm") is not None:
        parts.storm = read_table(StormTable, data["storm"], document, "[storm]", ("storm",))[0]
    if data.get("blackout") is not None:
        where = ("blackout",)
        parts.blackout = read_table(BlackoutTable, data["blackout"], document, "[blackout]", where)[
            0
        ]
    if data.get("plan") is not None:
        parts.plan = read_table(PlanTable, data["plan"], document, "[plan]", ("plan",))[0]


def _required(document: Document, key: str, hint: str) -> TomlTable | None:
    """A table that every case needs, or `None` where it is missing or no table."""
    raw = document.data.get(key)
    if not isinstance(raw, dict):
        value = "nothing" if raw is None else show(raw)
        document.add((key,), f"[{key}]", "", value, "a table", hint)
        return None
    return raw


def _read_window(document: Document) -> Window | None:
    raw = _required(document, "time", "add [time] with start, slots and step_min")
    if raw is None:
        return None
    table, _ = read_table(TimeTable, raw, document, "[time]", ("time",))
    if None in (table.start, table.slots, table.step_min):
        return None
    window = Window(table.start, table.slots, table.step_min)
    findings = list(_wrong_window(window))
    document.add_findings(("time",), "[time]", findings)
    return None if findings else window


def _wrong_window(window: Window) -> Iterator[Finding]:
    """What is wrong with a horizon whose keys are sound."""
    if window.start.tzinfo is not None:
        hint = "profiles and outages are in local time; drop the offset"
        yield "start", show(window.start), "a time without offset", hint
    years = window.slots * window.step_min / (365.25 * DAY_MIN)
    first, last = window.start.year, window.start.year + years
    if not (first >= FIRST_YEAR and last <= LAST_YEAR):
        value = f"{show(window.start)} and {years:.3g} years from then"
        allowed, hint = (
            f"a horizon in {FIRST_YEAR} to {LAST_YEAR}",
            "slots * step_min is its length",
        )
        yield "start", value, allowed, hint


def _read_network(parts: Parts) -> None:
    document, where = parts.document, ("network",)
    raw = _required(document, "network", 'add [network] with, say, pandapower = "case33bw"')
    if raw is None:
        return
    head = {key: value for key, value in raw.items() if key not in ("bus", "line")}
    if "bus" in raw or "line" in raw:
        parts.inline = read_inline(document, raw.get("bus", []), raw.get("line", []))
    table, sound = read_table(NetworkTable, head, document, "[network]", where)
    if not sound:
        # Names of buses and lines can be checked all the same: go on with the keys that are right.
        keys = NetworkTable.model_fields
        right = {k: v for k, v in head.items() if k in keys and getattr(table, k) is not None}
        table = NetworkTable.model_validate(right)
    inline = {
        "bus": tuple(parts.inline.buses.values()),
        "line": tuple(line for line, _ in parts.inline.lines),
    }
    table = table.model_copy(update=inline)
    try:
        feeder = read_feeder(table)
    except FeederError as error:
        document.add_findings(where, "[network]", error.findings)
    else:
        network = feeder.network
        lines = [line for line, _ in parts.lines if line.name and network.has_line(line.name)]
        parts.network = finish_network(network, table, lines)
        if parts.storm is not None and parts.storm.lines == "all":
            usable = network.in_service | parts.network.switchable
            usable &= ~cables(network, lines)
            parts.network = replace(parts.network, breakpoint=usable)
        stated = (Omission(words, ()) for words in table.not_modelled)
        parts.places, parts.omissions = feeder.places, (*feeder.omissions, *stated)


def _read_profiles(parts: Parts) -> dict[str, Floats]:
    document = parts.document
    raw = document.data.get("profiles", {})
    table, sound = read_table(ProfilesTable, raw, document, "[profiles]", ("profiles",))
    if parts.window is None:
        return {}
    uses = list(_profile_uses(parts))
    powers = {name for _, _, key, name in uses if key == "profile"}
    prices = {name: name not in powers for *_, name in uses}
    arrays, names, findings = read_profiles(table.file, table.columns or {}, parts.window, prices)
    for file, finding in findings:
        document.add_findings(("profiles",), "[profiles]", [finding], file)
    for where, title, key, name in uses:
        if sound and names is not None and name not in names:
            hint = did_you_mean(name, sorted(names)) if names else "add [profiles] with a file"
            document.add(where, title, key, show(name), "a column of the profiles", hint)
    return arrays


def _profile_uses(parts: Parts) -> Iterator[tuple[Place, str, str, str]]:
    """`(place, title, key, column)` for every profile that a device names."""
    tables = [((kind, str(device.name)), device, t) for kind, device, t in parts.all_devices()]
    tables += [(SITES, unit, title) for _, unit, title in parts.sites]
    for where, table, title in tables:
        for key in ("profile", "price_profile"):
            name = getattr(table, key, None)
            if name is not None:
                yield (*where, key), title, key, name


def _read_outages(parts: Parts, head: HeadTable) -> tuple[Outage, ...]:
    if not head.outages:
        return ()
    document = parts.document
    file = document.file_of("outages")
    specs, mistakes = split_specs(head.outages, file, "outages")
    network = parts.network if parts.inline.complete else None
    units = [str(table.name) for _, table, _ in parts.all_devices() if isinstance(table, UnitTable)]
    units += [str(tank.name) for tank, _ in parts.tanks if tank.delivery]
    outages, more = place_outages(specs, file, network, parts.window, units)
    document.mistakes += [*mistakes, *more]
    return outages
