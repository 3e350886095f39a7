"""Results in brief: the facts that stand in one line of a terminal or a table of a notebook."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from html import escape
from importlib import import_module
from typing import TYPE_CHECKING, Any, TextIO

from resilience.case.outages import outage_texts
from resilience.errors import UsageError, shortened
from resilience.text.console import plain_console

if TYPE_CHECKING:
    import pandas as pd

    from resilience.case import Case
    from resilience.evaluation.compare import Report
    from resilience.evaluation.survival import Survival
    from resilience.fragility.feeder_hazard import Hazard
    from resilience.fragility.outages.scenarios import Scenarios
    from resilience.planning.plan import Plan
    from resilience.planning.scenarios.plan import ScenarioPlan

MAX_ROWS = 12
"""Of a table in a notebook."""
REPORT_COLUMNS = 6
"""Of a comparison, those that come first."""


@dataclass(frozen=True)
class View:
    """What is shown of a result.

    Attributes:
        name: what it is of.
        facts: by their names, in words and numbers.
        short: which facts stand in one line.
        frame: rows to go with them; None where there are none.
    """

    name: str
    facts: Mapping[str, str]
    short: tuple[str, ...]
    frame: pd.DataFrame | None = None


def one_line(result: object) -> str:
    """`<Plan ieee33: method minlp on distflow, objective 33.4526 $, ...>`."""
    view = _view(result)
    facts = ", ".join(f"{key} {view.facts[key]}" for key in view.short if key in view.facts)
    return f"<{type(result).__name__} {shortened(view.name, 60)}: {facts}>"


def as_html(result: object) -> str:
    """A table of all facts, everything escaped, and a few rows below it."""
    view = _view(result)
    rows = "".join(
        f'<tr><th style="text-align:left">{escape(key)}</th>'
        f'<td style="text-align:left">{escape(value)}</td></tr>'
        for key, value in view.facts.items()
    )
    title = f"{escape(type(result).__name__)} <b>{escape(view.name)}</b>"
    table = f"<table><tbody>{rows}</tbody></table>"
    frame = view.frame
    if frame is None or frame.empty:
        return f"<div>{title}{table}</div>"
    more = f"<p>... {len(frame) - MAX_ROWS} more</p>" if len(frame) > MAX_ROWS else ""
    below = frame.head(MAX_ROWS).to_html(border=0, float_format=lambda x: f"{x:.4g}")
    return f"<div>{title}{table}{below}{more}</div>"


def printed(
    result: object, file: TextIO | None, width: int | None, options: Mapping[str, Any]
) -> None:
    """Prints the report that the command line prints; see `Shown.print`.

    Raises:
        UsageError: there is no report of such a thing.
    """
    name = type(result).__name__
    if name not in PRINTERS:
        raise UsageError(
            f"a {name} has no report; allowed: {', '.join(PRINTERS)}",
            hint="print() says what it is",
        )
    console = plain_console(file=file, **({} if width is None else {"width": width}))
    module, _, function = PRINTERS[name].partition(":")
    getattr(import_module(module), function)(result, console, **options)


def _view(result: object) -> View:
    return _VIEWS[type(result).__name__](result)


def _of_case(case: Case) -> View:
    network = case.network
    kinds = {kind: len(tables) for kind, tables in case.devices.items() if tables}
    outages = outage_texts(case.outages, case.window)
    facts = {
        "buses": str(len(network.bus_names)),
        "lines": str(len(network.line_names)),
        "devices": ", ".join(f"{count} {kind}" for kind, count in kinds.items()) or "none",
        "slots": f"{case.slots} of {case.step_min:g} min from {case.start:%Y-%m-%d %H:%M}",
        "outages": shortened(", ".join(outages), 80) or "none",
        "storms": _storms(case),
    }
    if case.omissions:
        facts["not modelled"] = "; ".join(map(str, case.omissions))
    if case.description:
        facts["about"] = case.description
    return View(case.name, facts, ("buses", "lines", "devices", "slots"))


def _storms(case: Case) -> str:
    if case.blackout is not None:
        return "a blackout"
    if case.storm is not None and case.storm.points:
        return "a storm on its track"
    return "a bell" if case.network.breakpoint.any() else "none"


def _of_plan(plan: Plan) -> View:
    facts = _of_any_plan(plan) | {"shed": f"{plan.shed_mwh:.4g} MWh"}
    facts["outages"] = shortened(", ".join(plan.outages), 80) or "none"
    return View(plan.name, facts, _SHORT, None if plan.case is None else plan.actions())


def _of_scenario_plan(plan: ScenarioPlan) -> View:
    facts = _of_any_plan(plan) | {
        "risk": plan.risk,
        "scenarios": f"{plan.scenarios}, {plan.different} of them different",
        "shed": f"{plan.expected_shed_mwh:.4g} MWh expected",
    }
    return View(plan.name, facts, _SHORT, None if plan.case is None else plan.actions())


_SHORT = ("method", "status", "objective", "gap", "shed")


def _of_any_plan(plan: Plan | ScenarioPlan) -> dict[str, str]:
    status = f"{plan.status} for a relaxation" if plan.relaxed else plan.status
    bound, gap = plan.certificate.bound, plan.certificate.gap
    return {
        "method": f"{plan.method} on {plan.physics}",
        "status": status,
        "objective": f"{plan.objective:.4f} $",
        "bound": "none" if bound is None else f"{bound:.4f} $",
        "gap": "unknown" if gap is None else f"{100 * gap:.4f} %",
    }


def _of_report(report: Report) -> View:
    frame = report.frame()
    facts = {
        "methods": ", ".join(map(str, frame.index)),
        "setting": ", ".join(report.setting),
    }
    return View(report.case.name, facts, ("methods", "setting"), frame.iloc[:, :REPORT_COLUMNS])


def _of_hazard(hazard: Hazard) -> View:
    import pandas as pd

    here, closest = hazard.storm, hazard.closest
    facts = {
        "storm": here.track.name or "unnamed",
        "strongest wind": f"{float(here.strongest_mps.max(initial=0.0)):.3g} m/s",
        "lines down": f"{float(here.failed_by[:, -1].sum()):.3g} expected",
        "storms drawn": str(hazard.scenarios.n),
    }
    if closest is not None:
        facts["closest"] = f"{closest[0]:.3g} km at {closest[1]:%Y-%m-%d %H:%M}"
    return View(
        here.case.name, facts, ("storm", "strongest wind", "lines down"), pd.DataFrame(hazard.lines)
    )


def _of_scenarios(drawn: Scenarios) -> View:
    count, slots = drawn.n, drawn.down.shape[1]
    shares = drawn.down.any(axis=1) @ drawn.probability
    facts = {
        "scenarios": str(count),
        "slots": str(slots),
        "lines": shortened(", ".join(drawn.lines), 80) or "none",
        "lines down": f"{float(shares.sum()):.3g} expected",
        "process": drawn.process or "unknown",
    }
    if drawn.represents is not None:
        facts["stand for"] = f"{drawn.represents.n} scenarios"
    return View("outages", facts, ("scenarios", "slots", "lines", "lines down"))


def _of_survival(survival: Survival) -> View:
    facts = {
        "method": survival.method,
        "durations": ", ".join(f"{hours:g} h" for hours in survival.durations_h),
    }
    return View(survival.case.name, facts, tuple(facts), survival.frame())


_VIEWS: Mapping[str, Callable[[Any], View]] = {
    "Case": _of_case,
    "Plan": _of_plan,
    "ScenarioPlan": _of_scenario_plan,
    "Report": _of_report,
    "Hazard": _of_hazard,
    "Scenarios": _of_scenarios,
    "Survival": _of_survival,
}
"""What says what a result is, by its class."""


PRINTERS: Mapping[str, str] = {
    "Case": "resilience.text.plan:print_case",
    "Plan": "resilience.text.plan:print_plan",
    "ScenarioPlan": "resilience.text.scenario_plan:print_scenario_plan",
    "Report": "resilience.text.comparison:print_report",
    "Hazard": "resilience.text.hazard:print_hazard",
    "Survival": "resilience.text.survival:print_survival",
}
"""What prints a result, by its class, imported when it is used."""
