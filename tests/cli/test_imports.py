"""A command imports what it needs and nothing else."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

import resilience as rs
from resilience.dispatch.registry import DISPATCHERS, register_dispatcher
from resilience.dispatch.rules import Idle

PRINT_MODULES = """
import json, sys
from resilience.cli import app

app(sys.argv[1:], standalone_mode=False)
print(json.dumps([name for name in sys.modules if name.startswith("resilience.")]), file=sys.stderr)
"""


def modules_of(*arguments: str) -> list[str]:
    """Modules of the package that a command has imported by its end."""
    done = subprocess.run(
        [sys.executable, "-c", PRINT_MODULES, *arguments],
        capture_output=True,
        text=True,
        check=True,
    )
    names: list[str] = json.loads(done.stderr.splitlines()[-1])
    return names


@pytest.mark.parametrize("folder", ["dispatch.sddp", "plots", "evaluation", "pages", "revisions"])
def test_a_plan_without_a_picture_needs_no_policy_picture_or_judge(
    folder: str, lp_modules: list[str]
) -> None:
    assert "resilience.planning.solve" in lp_modules
    assert [name for name in lp_modules if name.startswith(f"resilience.{folder}")] == []


@pytest.fixture(scope="module")
def lp_modules() -> list[str]:
    return modules_of("solve", "analytic/arbitrage", "--method", "lp")


def test_help_imports_the_command_line_only() -> None:
    light = (
        *("cli", "dispatch", "dispatch.registry", "errors", "extras", "inputs", "lazy", "progress"),
        *("rl", "rl.algorithms", "rl.algorithms.registry"),
    )
    names = modules_of("compare", "--help")
    allowed = {f"resilience.{name}" for name in light}
    assert {name for name in names if not name.startswith("resilience.cli.")} <= allowed


def test_a_dispatcher_is_registered_from_above(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("resilience.dispatch.registry.DISPATCHERS", DISPATCHERS.copy())
    from resilience.dispatch import registry

    register_dispatcher("asleep", Idle)
    assert "asleep" in registry.DISPATCHERS
    assert not registry.is_batched(registry.DISPATCHERS["asleep"])
    with pytest.raises(rs.UsageError, match="'asleep' is registered already"):
        register_dispatcher("asleep", Idle)
