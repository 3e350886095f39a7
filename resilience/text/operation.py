"""A decision on the terminal: set-points, why, and the plan behind it."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from typing import TYPE_CHECKING, Any

from resilience.text.grid import Column, grid, pages

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from resilience.operation.answer import OperatorAnswer

IDLE_MW = 5e-4
MAX_STEPS = 24
"""Steps of a plan that are printed; --json has all."""


def print_answer(answer: OperatorAnswer, plan: Mapping[str, Any], console: Console) -> None:
    """Prints who decided what, why, and what is planned.

    Args:
        answer: of the operator.
        plan: as `Operator.plan_summary` says it.
        console: where.
    """
    from rich.text import Text

    begins, ends = answer.begins, answer.ends
    head = f"  {begins:%Y-%m-%d %H:%M} to {ends:%H:%M}"
    again = ", as decided before" if answer.repeated else ""
    console.print(Text.assemble((answer.decided_by, "bold"), f"{head}{again}"), highlight=False)
    if answer.fallback is not None:
        text = f"{answer.decided_by} in place of {answer.method}: {answer.fallback}"
        console.print(Text(text, "yellow"), highlight=False)
    console.print(grid("To do", _rows(answer), "device", "MW", "MWh at end"))
    console.print(f"costs {answer.cost:.4g} $", highlight=False)
    for line in answer.why:
        console.print(f"- {line}", highlight=False)
    for line in answer.notes:
        console.print(Text(f"note: {line}", "yellow"), highlight=False)
    if plan["steps"]:
        for table in _plan(plan, console.width):
            console.print(table)


def _rows(answer: OperatorAnswer) -> list[tuple[str, str, str]]:
    """Storage always, else whatever is not idle; loads where they are shed."""
    rows = []
    loads = [name for name, power in answer.power_mw.items() if power <= 0.0]
    for name, power in answer.power_mw.items():
        stored = answer.energy_mwh.get(name)
        if stored is not None:
            rows.append((name, f"{power:+.3f}", f"{stored:.3f}"))
        elif abs(power) > IDLE_MW and name not in loads:
            rows.append((name, f"{power:+.3f}", ""))
    rows += [(f"shed {name}", f"{mw:.3f}", "") for name, mw in answer.shed_mw.items()]
    rows += [(name, "runs" if on else "off", "") for name, on in answer.running.items()]
    rows += [(name, "closed" if on else "open", "") for name, on in answer.closed.items()]
    return rows


def _plan(plan: Mapping[str, Any], width: int) -> list[Table]:
    steps, times = plan["steps"][:MAX_STEPS], list[str]()
    for step in steps:
        begins, ends = (datetime.fromisoformat(step[key]) for key in ("begins", "ends"))
        times.append(f"{begins:%H:%M}-{ends:%H:%M}")
    powers = {
        "storage": [sum(step["storage_mw"].values()) for step in steps],
        "generators": [step["generator_mw"] for step in steps],
        "grid": [step["grid_mw"] for step in steps],
        "shed": [step["shed_mw"] for step in steps],
    }
    columns: list[Column] = [
        (f"{head}\nMW", [f"{mw:+.3f}" if abs(mw) > IDLE_MW else "." for mw in values])
        for head, values in powers.items()
    ]
    stored = [f"{sum(step['energy_mwh'].values()):.2f}" for step in steps]
    range_mwh = [f"{step['lowest_mwh']:.2f}-{step['highest_mwh']:.2f}" for step in steps]
    columns += [("stored\nMWh", stored), ("least-most\nMWh", range_mwh)]
    of_paths = f", mean of {plan['paths']} paths" if plan["paths"] > 1 else ""
    later = len(plan["steps"]) - len(steps)
    more = f" ({later} later steps left out)" if later else ""
    title = f"Plan of {plan['decided_by']}{of_paths}{more}"
    return pages(title, ("from-to", times), columns, width)
