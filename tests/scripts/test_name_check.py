"""scripts/names.py on trees of a few lines: what it finds, what it lets pass, how limits fall."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "scripts" / "names.py"


def names(root: Path, modules: dict[str, str], limits: str, *options: str) -> tuple[int, str]:
    """Exit code and errors of the script in a tree of these modules and limits."""
    (root / "pyproject.toml").write_text(f"[tool.names.limits]\n{limits}", encoding="utf-8")
    for name, source in modules.items():
        path = root / "resilience" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(source, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, str(SCRIPT), str(root), *options],
        capture_output=True,
        text=True,
        check=False,
    )
    return done.returncode, done.stderr


@pytest.mark.parametrize(
    "source",
    [
        "found = 2\n",
        "plan = [\n    found for found in (2, 3)]\n",
        "def solve(\n    found): ...\n",
        "def solve(*,\n    found=2): ...\n",
        "plan = lambda \\\n    found: 2\n",
        "\ndef found(): ...\n",
        "\nclass found: ...\n",
        "def solve(self):\n    self.found = 2\n",
        "import math\nimport json as found\n",
        "try: ...\nexcept OSError as found: ...\n",
        "match 2:\n    case found: ...\n",
        "if (\n    found := 2): ...\n",
        "class Plan:\n    found: int\n",
    ],
)
def test_a_binding_above_the_limit_is_named_with_its_place(tmp_path: Path, source: str) -> None:
    code, errors = names(tmp_path, {"models/solve.py": source}, "found = 0\n")
    line = next(k for k, text in enumerate(source.splitlines(), 1) if "found" in text)
    assert code == 1
    assert "'found' is bound 1 times; allowed: 0" in errors
    assert f"  resilience/models/solve.py:{line}\n" in errors
    assert "hint: name the thing" in errors


def test_a_word_that_is_only_read_or_is_pythons_own_passes(tmp_path: Path) -> None:
    source = (
        "print(found, plan.found, solve(found=2))\nclass A:\n    def __eq__(self, other): ...\n"
    )
    assert names(tmp_path, {"a.py": source}, "found = 0\nother = 0\n") == (0, "")


def test_a_count_below_its_limit_asks_for_a_lower_one_and_gets_it(tmp_path: Path) -> None:
    modules, limits = {"a.py": "found = 2\nleft = 3\n"}, "found = 12\nleft = 1\nmost = 4\n"
    code, errors = names(tmp_path, modules, limits)
    assert code == 1
    assert "'found' is bound 1 times; lower the limit to 1" in errors
    assert "'most' is bound 0 times; lower the limit to 0" in errors
    assert names(tmp_path, modules, limits, "--lower") == (0, "")
    written = (tmp_path / "pyproject.toml").read_text(encoding="utf-8")
    assert written == "[tool.names.limits]\nfound = 1\nleft = 1\nmost = 0\n"


def test_limits_are_lowered_and_never_raised(tmp_path: Path) -> None:
    code, errors = names(tmp_path, {"a.py": "found = left = 2\n"}, "found = 0\n", "--lower")
    assert code == 1
    assert "allowed: 0" in errors


def test_two_classes_of_one_name_are_refused_unless_one_is_inside_another(tmp_path: Path) -> None:
    modules = {"a.py": "class Plan: ...\n", "b.py": "\nclass Plan: ...\n"}
    code, errors = names(tmp_path, modules, "found = 0\n")
    assert code == 1
    assert "class Plan is defined in resilience/a.py:1, resilience/b.py:2" in errors
    inner = {"b.py": "class Case:\n    class Plan: ...\n"}
    assert names(tmp_path, inner, "found = 0\n") == (0, "")


def test_a_name_for_the_type_of_what_is_returned_at_once_is_refused(tmp_path: Path) -> None:
    source = "def solve():\n    if True:\n        plan: int = 2\n        return plan\n"
    code, errors = names(tmp_path, {"a.py": source}, "found = 0\n")
    assert code == 1
    assert "resilience/a.py:3: `plan` is returned at once" in errors
    used = source.replace("return plan", "return plan + 3")
    assert names(tmp_path, {"a.py": used}, "found = 0\n") == (0, "")
