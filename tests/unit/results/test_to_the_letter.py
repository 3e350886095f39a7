"""Names are printed and drawn to the letter, whatever terminals and pictures make of them."""

from __future__ import annotations

import ast
import io
from pathlib import Path

import numpy as np
import pytest

import resilience as rs
from resilience.case import Case
from resilience.simulation.world import World, microgrid_with_fallible_lines
from resilience.testing import small_case
from resilience.text.comparison import print_report
from resilience.text.console import plain_console
from resilience.text.plan import print_case, print_plan
from resilience.text.scenario_plan import print_scenario_plan
from resilience.text.scenarios import print_scenarios

NAMES = ("[/x]", "[red]a[/red]", ":x:", "$\\frac{$", "100%s{}", "台风")


def named(name: str) -> Case:
    """Two buses, and a load, a battery and a connection that are called so."""
    return small_case(
        slots=9,
        buses=2,
        lines=[(1, 2, 0.01, 0.02)],
        line_tables=[{"name": "1-2", "breakpoint": True}],
        outages=["1-2@02:00-05:00"],
        load=[{"name": name, "bus": "2", "p_max_mw": 0.7, "shed_cost_per_mwh": 90.0}],
        ess=[{"name": f"{name} e", "bus": "2", "p_max_mw": 0.2, "e_mwh": 0.6}],
        grid=[{"name": f"{name} g", "import_max_mw": 2.5, "import_cost_per_mwh": 3.0}],
    ).replace(name=name)


def test_every_console_of_the_package_is_plain() -> None:
    """Only one place makes them, but for the one of progress bars, whose words are our own."""
    root = Path(rs.__file__).parent
    makers = {
        path.relative_to(root).as_posix()
        for path in root.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and ast.unparse(node.func).rpartition(".")[2] == "Console"
    }
    assert makers == {"text/console.py", "cli/terminal.py"}


@pytest.mark.parametrize("name", NAMES)
def test_reports_print_names_to_the_letter(name: str) -> None:
    case = named(name)
    down = np.zeros((1, 9, 3), bool)
    down[0, 2:5, 0] = down[0, 4:7, 1] = True
    scenarios = rs.Scenarios(("1-2",), down, np.array([0.5, 0.3, 0.2]))
    over = rs.solve(case.replace(outages=()), "stochastic", scenarios=scenarios)
    assert isinstance(over, rs.ScenarioPlan)
    grounds = microgrid_with_fallible_lines(case, scenarios, "copperplate")
    report = rs.evaluate(World.build(grounds, scenarios), ["rule"])
    file = io.StringIO()
    console = plain_console(file=file, width=200)
    print_case(case, console)
    print_plan(rs.solve(case, "lp"), console)
    print_scenario_plan(over, console)
    print_scenarios(scenarios, case, console)
    print_report(report, console)
    printed = file.getvalue()
    assert printed.count(f"{name}  ") >= 4  # the case, as heads have it
    assert f"{name}@2" in printed
    assert f"{name} g@1" in printed
    assert "\\[" not in printed


@pytest.mark.parametrize("name", NAMES)
def test_pictures_show_names_to_the_letter(name: str, tmp_path: Path) -> None:
    plan = rs.solve(named(name), "lp")
    rs.plot_plan(plan, tmp_path / "plan.svg")
    assert (tmp_path / "plan.svg").stat().st_size > 10_000
