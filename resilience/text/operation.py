"""A decision on the terminal: set-points, why, and the plan behind it."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from typing import TYPE_CHECKING, Any

from resilience.text.grid import grid

if TYPE_CHECKING:
    from rich.console import Console

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
        console.print(_plan(plan))


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


def _plan(plan: Mapping[str, Any]) -> Any:
    steps = plan["steps"]
    rows = []
    for step in steps[:MAX_STEPS]:
        times = [datetime.fromisoformat(step[key]) for key in ("begins", "ends")]
        numbers = (
            sum(step["storage_mw"].values()), step["generator_mw"], step["grid_mw"],
            step["shed_mw"],
        )  # fmt: skip
        cells = [f"{mw:+.3f}" if abs(mw) > IDLE_MW else "." for mw in numbers]
        stored = sum(step["energy_mwh"].values())
        rows.append(
            (
                f"{times[0]:%H:%M}-{times[1]:%H:%M}",
                *cells,
                f"{stored:.2f}",
                f"{step['lowest_mwh']:.2f}-{step['highest_mwh']:.2f}",
            )
        )
    of_paths = f", mean of {plan['paths']} paths" if plan["paths"] > 1 else ""
    heads = ("from-to", "storage\nMW", "generators\nMW", "grid\nMW", "shed\nMW", "stored\nMWh")
    more = f" ({len(steps) - MAX_STEPS} later steps left out)" if len(steps) > MAX_STEPS else ""
    return grid(f"Plan of {plan['decided_by']}{of_paths}{more}", rows, *heads, "least-most\nMWh")
