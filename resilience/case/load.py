"""`load_case`: from a case file to a checked, immutable `Case`."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any

from resilience.case.checks import check_parts
from resilience.case.data import Case, Outage
from resilience.case.document import Document, find_case, read_document
from resilience.case.network import FloatArray, did_you_mean
from resilience.case.outages import place_outages, split_specs
from resilience.case.parts import Parts
from resilience.case.profiles import read_profiles
from resilience.case.schema import (
    DEVICES,
    CaseTable,
    DefaultsTable,
    HeadTable,
    LineTable,
    ProfilesTable,
    TimeTable,
)
from resilience.case.tables import read_list, read_table, show
from resilience.case.window import Window
from resilience.errors import CaseError


def load_case(ref: str | os.PathLike[str]) -> Case:
    """Read a case by name (`ieee33`, `analytic/island`) or by the path of its file.

    Raises `CaseError` with every mistake in the file, and `UsageError` for a case that is not
    there.
    """
    return build_case(read_document(find_case(ref)))


def build_case(document: Document) -> Case:
    """Check a merged case file and build the case. Raises `CaseError` with every mistake."""
    if document.problems:
        raise CaseError(document.problems)
    head = _read_head(document)
    parts = Parts(document, window=_read_window(document))
    _read_lines(parts)
    network = _required(document, "network", 'for example pandapower = "case33bw"')
    if network is not None:
        parts.read_network(network)
    for kind, model in DEVICES.items():
        entries = read_list(model, kind, document.data.get(kind, []), document, (kind,))
        parts.devices[kind] = [(table, title) for table, title, _ in entries]
    check_parts(parts)
    profiles = _read_profiles(parts)
    outages = _read_outages(parts, head)
    if document.problems or parts.network is None or parts.window is None:
        raise CaseError(document.problems)
    path, window = document.path, parts.window
    devices: dict[str, Any] = {
        k: tuple(d for d, _ in entries) for k, entries in parts.devices.items()
    }
    return Case(
        name=head.name or (path.stem if path else "case"),
        description=head.description,
        path=path,
        network=parts.network,
        start=window.start,
        slots=window.slots,
        step_min=window.step_min,
        profiles=profiles,
        outages=outages,
        terminal_value_per_mwh=head.terminal_value_per_mwh,
        source=document.data,
        **devices,
    )


def _read_head(document: Document) -> HeadTable:
    for key in document.data:
        if key not in CaseTable.model_fields:
            hint = did_you_mean(key, CaseTable.model_fields, shown=30)
            document.add((key,), "", key, "an unknown key or table", "those of a case", hint)
    raw = {k: v for k, v in document.data.items() if k in HeadTable.model_fields}
    head, _ = read_table(HeadTable, raw, document, "", ())
    section = document.data.get("defaults", {})
    raw_defaults = {k: v for k, v in section.items()} if isinstance(section, dict) else section
    read_table(DefaultsTable, raw_defaults, document, "[defaults]", ("defaults",))
    return head


def _required(document: Document, key: str, hint: str) -> Any:
    if key not in document.data:
        document.add((), f"[{key}]", "", "nothing", "a table", hint)
    return document.data.get(key)


def _read_window(document: Document) -> Window | None:
    raw = _required(document, "time", "add [time] with start, slots and step_min")
    if raw is None:
        return None
    table, sound = read_table(TimeTable, raw, document, "[time]", ("time",))
    if table.start is not None and table.start.tzinfo is not None:
        where, hint = ("time", "start"), "profiles and outages are in local time; drop the offset"
        document.add(where, "[time]", "start", show(table.start), "a time without offset", hint)
        return None
    return Window(table.start, table.slots, table.step_min) if sound else None


def _read_lines(parts: Parts) -> None:
    entries = read_list(
        LineTable, "line", parts.document.data.get("line", []), parts.document, ("line",)
    )
    parts.lines = [(table, title) for table, title, _ in entries]


def _read_profiles(parts: Parts) -> dict[str, FloatArray]:
    document = parts.document
    raw = document.data.get("profiles", {})
    table, sound = read_table(ProfilesTable, raw, document, "[profiles]", ("profiles",))
    uses = list(_profile_uses(parts))
    if not sound or parts.window is None:
        return {}
    prices = {name: key == "price_profile" for _, _, key, name in uses}
    arrays, known, findings = read_profiles(table, parts.window, prices)
    for key, *rest in findings:
        document.add(("profiles", key), "[profiles]", key, *rest)
    for where, title, key, name in uses:
        if known is not None and name not in known:
            hint = did_you_mean(name, sorted(known)) if known else "add [profiles] with a file"
            document.add(where, title, key, show(name), "a column of the profiles", hint)
    return arrays


def _profile_uses(parts: Parts) -> Iterator[tuple[tuple[str, ...], str, str, str]]:
    """Yield `(place, title, key, column)` for every profile that a device names."""
    for kind, device, title in parts.all_devices():
        for key in ("profile", "price_profile"):
            name = getattr(device, key, None)
            if name is not None:
                yield (kind, str(device.name), key), title, key, name


def _read_outages(parts: Parts, head: HeadTable) -> tuple[Outage, ...]:
    if not head.outages:
        return ()
    document = parts.document
    file = document.file_of("outages")
    specs, problems = split_specs(head.outages, file, "outages")
    outages, more = place_outages(specs, file, parts.network, parts.window)
    document.problems += [*problems, *more]
    return outages
