"""Rules for units that fail and loads that return: what keys say together, what a name means."""

from __future__ import annotations

from collections.abc import Iterator

from resilience.case.checks.parts import Parts
from resilience.case.document import Finding
from resilience.case.reading import show
from resilience.case.schema import FallibleTable, LoadTable, UnitTable


def check_failing(parts: Parts) -> None:
    """Notes what is wrong with how units fail, and with what loads return."""
    for kind, unit, title in parts.all_devices():
        if isinstance(unit, UnitTable):
            findings = [*_wrong_name(parts, unit), *_wrong_times(parts, unit)]
            parts.document.add_findings((kind, str(unit.name)), title, findings)
        if isinstance(unit, LoadTable):
            parts.document.add_findings((kind, str(unit.name)), title, _wrong_surplus(unit))
    for tank, title in parts.tanks:
        findings = [*_wrong_name(parts, tank), *_wrong_times(parts, tank)]
        if tank.can_fail and tank.delivery == ():
            hint = "what fails of a tank is that nothing comes; add [[tank.delivery]]"
            findings += [("delivery", "none", "some, for a tank that may be out", hint)]
        parts.document.add_findings(("tank", str(tank.name)), title, findings)


def _wrong_surplus(load: LoadTable) -> Iterator[Finding]:
    if load.cold_load_share and load.p_max_mw == 0.0:
        hint = "a load without active power has no surplus; drop cold_load_share"
        yield "cold_load_share", f"{load.cold_load_share:g}", "0 where p_max_mw = 0", hint


def _wrong_name(parts: Parts, unit: FallibleTable) -> Iterator[Finding]:
    """Outages and scenarios go by name, and there a line comes first."""
    if unit.can_fail and parts.network is not None and parts.network.has_line(str(unit.name)):
        allowed = "a name that no line has, for a unit that fails"
        yield "name", show(unit.name), allowed, "rename the unit, or drop its keys of failing"


def _wrong_times(parts: Parts, unit: FallibleTable) -> Iterator[Finding]:
    to_failure_h, to_repair_h = (getattr(unit, key, None) for key in ("mttf_h", "mttr_h"))
    if to_repair_h is not None and not unit.can_fail:
        hint = "add mttf_h, start_failure or availability, or drop mttr_h"
        yield "mttr_h", f"{to_repair_h:g}", "nothing where nothing fails", hint
    step_min = None if parts.window is None else parts.window.step_min
    if to_failure_h is not None and step_min is not None and to_failure_h < step_min / 60.0:
        allowed = f"a slot, {step_min / 60.0:g} h, or more"
        hint = "hours in service, not years; a generator has some 1100, a storage many more"
        yield "mttf_h", f"{to_failure_h:g}", allowed, hint
