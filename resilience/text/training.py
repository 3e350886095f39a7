"""Trainings as text."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from resilience.rl.adapters.checks import Check
    from resilience.rl.algorithms.described import DescribedSetting
    from resilience.rl.training.run import Run


def print_runs(runs: Sequence[Run], console: Console) -> None:
    """A line per run, and how they do together."""
    from rich.table import Table

    first = runs[0]
    console.print(
        f"{first.case.name}: {first.training.options.method}, "
        f"{first.training.iterations} iterations, judged on "
        f"{first.training.validation_days:g} validation days that nothing was learned on"
    )
    table = Table(box=None, padding=(0, 2), pad_edge=False)
    for name in ("seed", "CPU s", "best $/day", "over the bound", "ended"):
        table.add_column(name, justify="left" if name == "ended" else "right")
    for run in runs:
        best = run.best
        table.add_row(
            str(run.training.options.seed),
            f"{run.training.cpu_s:.1f}",
            f"{best.cost_per_day:.3f}",
            f"{100 * best.gap:.2f} %",
            run.ended,
        )
    console.print(table)
    if len(runs) > 1:
        gaps = [100 * run.best.gap for run in runs]
        console.print(f"median {np.median(gaps):.2f} %, worst {max(gaps):.2f} % over the bound")
    if first.folder is not None:
        console.print(
            "judge it on the test days: resilience compare "
            f"{first.case.name} --methods rule,mpc,{first.name}"
        )


def print_settings(method: str, settings: Sequence[DescribedSetting], console: Console) -> None:
    """The settings of an algorithm."""
    from rich.table import Table

    console.print(f"{method}: settings, each to be given as --set NAME=VALUE")
    table = Table(box=None, padding=(0, 2), pad_edge=False)
    for name in ("name", "default", "what it is"):
        table.add_column(name)
    for setting in settings:
        table.add_row(setting.name, repr(setting.default), setting.about)
    console.print(table)


def print_environment(facts: dict[str, Any], checks: Sequence[Check], console: Console) -> None:
    """What is seen and done in a case, and how the official checks went."""
    from rich.table import Table

    console.print(
        f"{facts['case']}: episodes of {facts['slots']} slots of "
        f"{facts['step_min']:g} min, on {facts['days_to_begin_on']} training days"
    )
    agents = ", ".join(facts["agents"])
    console.print(f"actions: {len(facts['agents'])} in [-1, 1], one per unit: {agents}")
    console.print(f"an observation has {facts['numbers']} numbers:")
    table = Table(box=None, padding=(0, 2), pad_edge=False, show_header=False)
    for name, count in facts["observation"].items():
        table.add_row(name, str(count))
    console.print(table)
    for check in checks:
        reason = f" ({check.reason})" if check.reason else ""
        console.print(f"{check.verdict:>7}  {check.name}{reason}")
