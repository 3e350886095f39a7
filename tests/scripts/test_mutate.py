"""scripts/mutate.py: which faults it makes, which tests meet them, what it says of a small tree."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from pathlib import Path

import pytest

from scripts.mutation.measurement import parts
from scripts.mutation.mutants import Mutant, Signatures, mutants
from scripts.mutation.report import Verdict, equivalents, read_verdicts, table
from scripts.mutation.selection import Selection

ROOT = Path(__file__).parents[2]


def faults(root: Path, source: str, kind: str) -> list[Mutant]:
    """The mutants of a kind in a module of this text."""
    (root / "module.py").write_text(source, encoding="utf-8")
    signatures = Signatures.of([ast.parse(source)])
    return [one for one in mutants(root, "module.py", signatures) if one.kind == kind]


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("a + b", {"(a - b)"}),
        ("a / b", {"(a * b)"}),
        ("a < b", {"(a <= b)", "(a > b)"}),
        ("a == b", {"(a != b)"}),
        ("a and b", {"(a or b)"}),
        ("-a", {"a"}),
        ("not a", {"a"}),
        ("3", {"4"}),
        ("2.5", {"2.75"}),
        ("0.0", {"1.0"}),
        ("True", {"False"}),
        ("np.minimum(a, b)", {"np.maximum(a, b)"}),
        ("max(a, b)", {"min(a, b)"}),
        ("a.sum(axis=0)", {"a.max(axis=0)", "a.sum(axis=1)"}),
    ],
)
def test_a_slip_writes_another_operator_number_or_function(
    tmp_path: Path, source: str, expected: set[str]
) -> None:
    made = faults(tmp_path, f"x = {source}\n", "random")
    assert {one.faulty.removeprefix("x = ") for one in made} == expected


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("x = a + b", {"x = a", "x = b"}),
        ("x = a - b", {"x = a", "x = (-b)"}),
        ("x = a * (b + c)", {"x = a", "x = (b + c)", "x = a * (b)", "x = a * (c)"}),
        ("x = a / b", {"x = a"}),
        ("x = a or b or c", {"x = (b or c)", "x = (a or c)", "x = (a or b)"}),
        ("x = a if b else c", {"x = a", "x = c"}),
        ("x = min(a, b)", {"x = a", "x = b"}),
        ("x = np.clip(a, b, c)", {"x = a", "x = b", "x = c"}),
        ("x = [a for a in b if c]", {"x = [a for a in b]"}),
        ("x += a", {"pass"}),
        ("stage.hold(a)", {"pass"}),
    ],
)
def test_an_aimed_fault_leaves_one_part_out(
    tmp_path: Path, source: str, expected: set[str]
) -> None:
    assert {one.faulty for one in faults(tmp_path, source + "\n", "aimed")} == expected


def test_a_guard_is_never_entered(tmp_path: Path) -> None:
    source = (
        "def f(a):\n    if a > 7:\n        return 5\n    if a < 2:\n        a = 3\n    return a\n"
    )
    assert [one.faulty for one in faults(tmp_path, source, "aimed")] == ["if False:"]


def test_an_argument_is_left_out_where_the_function_can_do_without(tmp_path: Path) -> None:
    source = "def f(a, b=2, *, c, d=3): ...\nf(a=5, b=6, c=7, d=8)\n"
    source += "np.sum(x, axis=3)\nzip(x, strict=True)\n"
    made = {one.faulty for one in faults(tmp_path, source, "aimed")}
    calls = {"f(a=5, c=7, d=8)", "f(a=5, b=6, c=7)", "np.sum(x)"}
    assert made - {"pass"} == calls


def test_messages_types_and_paths_are_left_alone(tmp_path: Path) -> None:
    source = (
        "Number = int | None\n"
        "def f(a: int | None) -> int | None:\n"
        "    progress.say(a + 2)\n"
        "    path = a / 'file'\n"
        "    raise ValueError(f'{a + 3}', a + 4)\n"
    )
    assert faults(tmp_path, source, "random") == []
    assert faults(tmp_path, source, "aimed") == []


def test_a_key_and_its_rank_do_not_move_with_the_line(tmp_path: Path) -> None:
    source = "def f(a):\n    return a + 5\n"
    first = faults(tmp_path, source, "random")
    later = faults(tmp_path, "import math\n\n\n" + source, "random")
    assert [one.key for one in first] == [one.key for one in later]
    assert [one.rank(7) for one in first] == [one.rank(7) for one in later]
    assert [one.line for one in first] != [one.line for one in later]
    assert first[0].rank(7) != first[0].rank(8)


def test_every_fault_is_python_in_a_module_with_characters_of_several_bytes() -> None:
    file = "resilience/models/components/ess.py"
    signatures = Signatures.of([])
    module = (ROOT / file).read_bytes()
    made = mutants(ROOT, file, signatures)
    assert len(made) > 50
    for one in made:
        assert ast.dump(ast.parse(one.applied(module))) != ast.dump(ast.parse(module)), one.key


def selection(seconds: dict[str, float]) -> Selection:
    return Selection(Path("nowhere"), [], seconds)


def test_own_tests_come_first_then_one_of_every_file_and_the_cheap_before_the_dear() -> None:
    seconds = {
        "tests/a.py::slow": 5.0,
        "tests/a.py::quick": 2.0,
        "tests/b.py::only": 3.0,
        "tests/test_load.py::dear": 7.0,
        "tests/test_load.py::cheap": 4.0,
    }
    order = selection(seconds).order(seconds, "resilience/models/load.py", budget=60.0)
    assert [test.removeprefix("tests/") for test in order] == [
        "test_load.py::cheap",
        "test_load.py::dear",
        "a.py::quick",
        "b.py::only",
        "a.py::slow",
    ]


def test_a_budget_leaves_out_what_does_not_fit_but_never_the_first() -> None:
    seconds = {"tests/a.py::x": 9.0, "tests/b.py::y": 11.0, "tests/c.py::z": 12.0}
    chosen = selection(seconds)
    assert chosen.order(seconds, "module.py", budget=21.0) == ["tests/a.py::x", "tests/b.py::y"]
    assert chosen.order(seconds, "module.py", budget=2.0) == ["tests/a.py::x"]


def verdict(mutant: Mutant, status: str) -> Verdict:
    return Verdict.of(mutant, status, tests=3, candidates=8)


def test_the_rate_counts_what_changes_anything_and_what_no_test_executes(tmp_path: Path) -> None:
    source = "x = a + 5\ny = a - 7\nz = a * 3\n"
    made = faults(tmp_path, source, "random")
    assert len(made) == 6
    statuses = ["killed", "timeout", "survived", "unexecuted", "equivalent", "killed"]
    printed = table(verdict(*pair) for pair in zip(made, statuses, strict=True))
    assert printed.splitlines()[-1].split() == ["all", "3/5", "60%", "1", "1"]


def test_verdicts_are_read_as_they_were_written(tmp_path: Path) -> None:
    made = [verdict(one, "survived") for one in faults(tmp_path, "x = a + 5\n", "random")]
    file = tmp_path / "verdicts.jsonl"
    file.write_text("".join(one.line_of_json() for one in made), encoding="utf-8")
    assert list(read_verdicts(file).values()) == made
    assert made[0].difference().endswith("[3/8 tests]\n  - x = a + 5\n  + x = (a - 5)")


def test_every_noted_mutant_is_one_that_can_still_be_made() -> None:
    noted = equivalents()
    files = {key.partition(": ")[0] for key in noted}
    signatures = Signatures.of(
        ast.parse(path.read_bytes()) for path in (ROOT / "resilience").rglob("*.py")
    )
    made = {one.key for file in files for one in mutants(ROOT, file, signatures)}
    assert set(noted) - made == set(), "lines of scripts/mutation/equivalent.toml are out of date"


MODULE = """
def doubled(a):
    while a > 9:
        a -= 4
    return a * 2


def unseen(a):
    return a + 3
"""

TESTS = """
from resilience.numbers import doubled, unseen


def test_double():
    assert doubled(5) == 10


def test_once():
    assert doubled(11) == 14


def test_that_asserts_too_little():
    unseen(5)
"""

MORE = """
from resilience.numbers import unseen


def test_more():
    unseen(7)
"""

RUN = """
import json, sys
from pathlib import Path
from scripts.mutation.mutants import Signatures, mutants
from scripts.mutation.server import Trial, outcomes

root, folder = Path(sys.argv[1]), Path(sys.argv[2])
tests = ["tests/test_numbers.py"]
made = mutants(root, "resilience/numbers.py", Signatures.of([]))
chosen = [one for one in made if one.faulty in sys.argv[3:]]
trials = [Trial(None, tests, 600.0, 3)]
for one in chosen:
    trials.append(Trial(one, tests, 3.0 if one.faulty == "pass" else 600.0, 3))
for outcome in outcomes(root, trials, 2, folder):
    fault = outcome.trial.mutant
    print(json.dumps([fault.faulty if fault else None, outcome.status]), flush=True)
"""


def small_tree(root: Path) -> Path:
    for name, text in [
        ("pyproject.toml", '[tool.pytest.ini_options]\nmarkers = ["slow: no"]\n'),
        ("resilience/__init__.py", ""),
        ("resilience/numbers.py", MODULE),
        ("tests/test_numbers.py", TESTS),
        ("tests/test_more.py", MORE),
    ]:
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text, encoding="utf-8")
    subprocess.run(["git", "init", "-q", str(root)], check=True)
    return root


def test_children_say_what_became_of_each_fault_and_the_tree_stays_as_it_is(tmp_path: Path) -> None:
    root = small_tree(tmp_path / "tree")
    expected = {
        None: "survived",
        "return (a / 2)": "killed",
        "return (a - 3)": "survived",
        "pass": "timeout",
    }
    command = [sys.executable, "-c", RUN, str(root), str(tmp_path / "copies")]
    done = subprocess.run(
        [*command, *filter(None, expected)], capture_output=True, text=True, cwd=ROOT, check=True
    )
    ends = dict(json.loads(line) for line in done.stdout.splitlines())
    assert ends == expected
    assert (root / "resilience" / "numbers.py").read_text(encoding="utf-8") == MODULE


MEASURE = """
import sys
from pathlib import Path
from scripts.mutation.measurement import measured

measured(Path(sys.argv[1]), Path(sys.argv[2]), ["tests"], 2)
"""


def measurement(root: Path, folder: Path) -> list[str]:
    """Measures a tree, and returns the files of tests that were measured now."""
    pytest.importorskip("coverage", reason="coverage.py measures which test executes what")
    command = [sys.executable, "-c", MEASURE, str(root), str(folder)]
    done = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True)
    lines = [line for line in done.stdout.splitlines() if line.startswith("measured")]
    return sorted(line.split()[1].rstrip(":") for line in lines)


def test_a_mutant_is_met_by_the_tests_that_execute_it(tmp_path: Path) -> None:
    root, folder = small_tree(tmp_path / "tree"), tmp_path / "measured"
    measurement(root, folder)
    selection = Selection.read(root, parts(root, folder, ["tests"]).values())
    names = {
        one.faulty: {test.partition("::")[2] for test in selection.of_mutant(one)}
        for one in mutants(root, "resilience/numbers.py", Signatures.of([]))
    }
    assert names["return (a / 2)"] == {"test_double", "test_once"}
    assert names["pass"] == {"test_once"}
    assert names["return (a - 3)"] == {"test_that_asserts_too_little", "test_more"}


def test_only_what_has_changed_is_measured_again(tmp_path: Path) -> None:
    root, folder = small_tree(tmp_path / "tree"), tmp_path / "measured"
    first, second = "tests/test_more.py", "tests/test_numbers.py"
    assert measurement(root, folder) == [first, second]
    assert measurement(root, folder) == []
    # As it is left where a measurement is ended: coverage, and no seconds.
    parts(root, folder, [first])[first].with_suffix(".json").unlink()
    assert measurement(root, folder) == [first]
    with (root / second).open("a", encoding="utf-8") as file:
        file.write("\n\ndef test_later():\n    assert doubled(7) == 14\n")
    assert measurement(root, folder) == [second]
    (root / "resilience" / "other.py").write_text("", encoding="utf-8")
    assert measurement(root, folder) == [first, second]
