"""Which tests execute a line, how long they take, and in which order a mutant meets them."""

from __future__ import annotations

import hashlib
import json
from collections import defaultdict
from collections.abc import Generator, Iterable
from dataclasses import dataclass
from functools import cache
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from scripts.mutation.mutants import Mutant

if TYPE_CHECKING:
    from coverage import Coverage

FAST = ["-q", "-p", "no:cacheprovider", "-p", "no:benchmark", "--hypothesis-seed=0"]
FAST += ["-m", "not slow", "--tb=line"]
"""Arguments of pytest for every run, measured or mutated."""


def fingerprint(root: Path) -> str:
    """A hash of everything that decides how the tests of a tree end."""
    total = hashlib.sha256()
    folders = (root / name for name in ("resilience", "tests", "cases"))
    files = chain.from_iterable(folder.rglob("*") for folder in folders)
    for path in sorted(
        path for path in files if path.is_file() and "__pycache__" not in path.parts
    ):
        total.update(f"{path.relative_to(root)}\n".encode() + path.read_bytes())
    return total.hexdigest()[:12]


class Recorder:
    """A plugin of pytest: each test is a context of coverage.py, with its seconds if it passed.

    What fixtures of a module or a session execute counts for every test of the file, as only the
    first of them is seen to do it.
    """

    def __init__(self, coverage: Coverage) -> None:
        self.coverage = coverage
        self.test = ""
        self.seconds: dict[str, float] = defaultdict(float)
        self.failed: list[str] = []

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, object, object]:
        self.test = item.nodeid
        self.coverage.switch_context(self.test)
        return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(
        self, fixturedef: pytest.FixtureDef[object]
    ) -> Generator[None, object, object]:
        if fixturedef.scope != "function":
            self.coverage.switch_context(self.test.partition("::")[0])
        try:
            return (yield)
        finally:
            self.coverage.switch_context(self.test)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.seconds[report.nodeid] += report.duration
        if report.failed:
            self.failed.append(report.nodeid)


def measure(root: Path, folder: Path) -> int:
    """Runs the fast tests below `root` once, and writes what they execute into `folder`.

    Returns:
        The exit code of pytest; tests that fail are left out of what is written.
    """
    from coverage import Coverage

    coverage = Coverage(
        data_file=str(folder / "coverage"), source=[str(root / "resilience")], config_file=False
    )
    coverage.erase()
    recorder = Recorder(coverage)
    coverage.start()
    code = pytest.main([*FAST, str(root / "tests")], plugins=[recorder])
    coverage.stop()
    coverage.save()
    seconds = {test: time for test, time in recorder.seconds.items() if test not in recorder.failed}
    (folder / "seconds.json").write_text(json.dumps(seconds, indent=0), encoding="utf-8")
    return int(code)


@dataclass(frozen=True, eq=False)
class Selection:
    """What `measure` wrote, read again.

    Attributes:
        root: of the tree that was measured.
        folder: the files that `measure` wrote.
        seconds: of every fast test that passed, by its name.
    """

    root: Path
    folder: Path
    seconds: dict[str, float]

    @classmethod
    def read(cls, root: Path, folder: Path) -> Selection:
        seconds = json.loads((folder / "seconds.json").read_text(encoding="utf-8"))
        return cls(root, folder, seconds)

    def of_mutant(self, mutant: Mutant) -> set[str]:
        """The tests that execute what a mutant replaces.

        A line that runs when the module is imported is seen only in the test that comes first, so
        all tests that execute any function of the module count.
        """
        lines = self.executing(mutant.file)
        inside = range(mutant.line, mutant.last_line + 1)
        chosen = inside if mutant.in_function else lines
        return set[str]().union(*(lines.get(line, set()) for line in chosen))

    @cache  # noqa: B019  one selection per run
    def executing(self, file: str) -> dict[int, set[str]]:
        """The tests that execute each line of a module of the package."""
        from coverage import CoverageData

        data = CoverageData(basename=str(self.folder / "coverage"))
        data.read()
        of_file: dict[str, set[str]] = defaultdict(set)
        for test in self.seconds:
            of_file[test.partition("::")[0]].add(test)
        lines = data.contexts_by_lineno(str(self.root / file))
        return {line: self._tests(contexts, of_file) for line, contexts in lines.items()}

    def _tests(self, contexts: list[str], of_file: dict[str, set[str]]) -> set[str]:
        tests = {context for context in contexts if context in self.seconds}
        return tests.union(*(of_file[context] for context in contexts if context in of_file))

    def order(self, tests: Iterable[str], file: str, budget: float) -> list[str]:
        """Tests in the order in which they are run, as many as `budget` seconds hold.

        The test file of the module's own name is first, then one test of every file after
        another; the cheap before the dear. One test is always kept.
        """
        rank: dict[str, int] = defaultdict(int)
        places = {}
        own_name = f"test_{Path(file).stem}.py"
        for test in sorted(tests, key=lambda test: (self.seconds[test], test)):
            home = test.partition("::")[0]
            stranger = Path(home).name != own_name
            places[test] = (rank[home] if stranger else -1, self.seconds[test], test)
            rank[home] += 1
        ordered = sorted(places, key=places.__getitem__)
        total, kept = 0.0, ordered[:1]
        for test in ordered[1:]:
            total += self.seconds[test]
            if total <= budget:
                kept.append(test)
        return kept
