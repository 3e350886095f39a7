"""Rules for what may be built before the storm: each option says one thing, and is told apart."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from resilience.case.checks.parts import Parts
from resilience.case.checks.rules import broken_rules
from resilience.case.document import Finding
from resilience.case.reading import read_table, show
from resilience.case.schema import DEVICES, LineTable, PlanTable, SiteTable, StrengthTable
from resilience.errors import did_you_mean

SITES = ("plan", "site")


def check_plan(parts: Parts) -> None:
    """Notes what is wrong with `[plan]` and with the options of lines."""
    document = parts.document
    for line, title in parts.lines:
        findings = [*_wrong_options(line.harden or ())]
        if line.harden and line.underground:
            hint = "leave out harden: no storm breaks a cable"
            findings.append(("harden", "options of a cable", "a line on poles", hint))
        if line.harden and line.switchable:
            hint = "drop one of the two: the status of the line cannot follow from both"
            findings.append(("harden", "options of a switchable line", "another line", hint))
        if line.tie_cost is not None and not _is_open(parts, line):
            hint = "a line that is closed, or has its switch, needs none"
            value = f"{line.tie_cost:g}"
            findings.append(("tie_cost", value, "nothing but of an open line without switch", hint))
        document.add_findings(("line", str(line.name)), title, findings)
    if parts.plan is not None:
        findings = [*_wrong_options(parts.plan.harden or ()), *_wrong_catalogue(parts.plan)]
        document.add_findings(("plan",), "[plan]", findings)
        _check_sites(parts, parts.plan.site or ())


def _is_open(parts: Parts, line: LineTable) -> bool:
    """Whether a line is open, and stays so; true where nobody can tell yet."""
    network = parts.network
    if network is None or not line.name or not network.has_line(line.name):
        return True
    k = network.line(line.name)
    return not network.in_service[k] and not network.switchable[k]


def _wrong_catalogue(plan: PlanTable) -> Iterator[Finding]:
    if plan.storm and plan.storms_per_year is not None:
        hint = "drop it: the storms say per_year each"
        yield "storms_per_year", f"{plan.storms_per_year:g}", "nothing beside [[plan.storm]]", hint
    for number, entry in enumerate(plan.storm or (), start=1):
        stated = [
            key for key in ("storm", "averaging_s", "agency") if getattr(entry, key) is not None
        ]
        if entry.file is None and stated:
            key, hint = f"storm[{number}].{stated[0]}", "add file, or leave it out"
            yield key, show(getattr(entry, stated[0])), "nothing without a track file", hint


def _check_sites(parts: Parts, sites: Sequence[SiteTable]) -> None:
    """Notes what is wrong with what may be built, as of any device, and keeps the tables."""
    kinds = [kind for kind, device in DEVICES.items() if device.table.buildable is not None]
    names = _names(parts)
    for site in sites:
        title = f"[[plan.site]] {site.name}"
        if site.kind not in kinds:
            words = ", ".join(kinds)
            if site.kind is not None:
                hint = did_you_mean(site.kind, kinds)
                parts.document.add(SITES, title, "kind", show(site.kind), words, hint)
            continue
        if site.name in names:
            hint = "rename it; results are keyed by name"
            parts.document.add(SITES, title, "name", show(site.name), "a name used once", hint)
        names.add(str(site.name))
        table = DEVICES[site.kind].table
        raw = {"name": site.name, **site.unit} if isinstance(site.unit, dict) else site.unit
        unit, sound = read_table(table, raw, parts.document, f"{title} unit", SITES)
        findings = [*broken_rules(site.kind, unit), *_wrong_unit(site, unit, sound, parts)]
        parts.document.add_findings(SITES, f"{title} unit", findings)
        if sound:
            parts.sites.append((site.kind, unit, title))


def _names(parts: Parts) -> set[str]:
    """Names of all devices and tanks."""
    return {str(device.name) for _, device, _ in parts.all_devices()} | {
        str(tank.name) for tank, _ in parts.tanks
    }


def _wrong_unit(site: SiteTable, unit: Any, sound: bool, parts: Parts) -> Iterator[Finding]:
    """What a unit that may be built cannot be, though one that stands can."""
    bus, network = unit.bus, parts.network
    if (
        network is not None
        and bus
        and bus not in parts.inline.bus_names
        and not network.has_bus(bus)
    ):
        yield "bus", show(bus), "a bus of the network", network.bus_hint(bus)
    if isinstance(site.unit, dict) and "name" in site.unit:
        yield "name", show(site.unit["name"]), "none", "the site has the name"
    for key, allowed in (type(unit).buildable or {}).items():
        if sound and getattr(unit, key) != allowed:
            hint = "no commitment, ramps, curves, tanks or failures are planned for what is built"
            yield key, show(getattr(unit, key)), show(allowed), hint


def _wrong_options(options: Sequence[StrengthTable]) -> Iterator[Finding]:
    stated: set[float | None] = set()
    for number, option in enumerate(options, start=1):
        key = f"harden[{number}]"
        if (option.factor is None) == (not option.underground):
            value = "factor and underground" if option.underground else "neither of them"
            hint = "factor = 1.5 is half as strong again; underground = true is a cable"
            yield key, value, "one of factor and underground", hint
        elif option.factor in stated:
            value = "underground" if option.factor is None else f"factor {option.factor:g}"
            yield key, f"{value} twice", "every option once", "keep the cheaper one"
        stated.add(option.factor)
