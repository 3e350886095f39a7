"""Rules for what may be built before the storm: each option says one thing, and is told apart."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from resilience.case.checks.parts import Parts
from resilience.case.document import Finding
from resilience.case.schema import StrengthTable


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
        document.add_findings(("line", str(line.name)), title, findings)
    if parts.plan is not None:
        findings = [*_wrong_options(parts.plan.harden or ())]
        document.add_findings(("plan",), "[plan]", findings)


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
