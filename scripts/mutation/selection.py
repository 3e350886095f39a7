"""Which tests execute a line, and in which order a mutant meets them."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from scripts.mutation.mutants import Mutant


@dataclass(frozen=True, eq=False)
class Selection:
    """What `measure` wrote, read again.

    Attributes:
        root: of the tree that was measured.
        data: the files of coverage.py that `measure` wrote.
        seconds: of every fast test that passed, by its name.
    """

    root: Path
    data: list[Path]
    seconds: dict[str, float]

    @classmethod
    def read(cls, root: Path, parts: Iterable[Path]) -> Selection:
        """Joins the parts of a measurement that are there."""
        data: list[Path] = []
        seconds: dict[str, float] = {}
        for part in parts:
            if part.with_suffix(".json").is_file():
                seconds |= json.loads(part.with_suffix(".json").read_text(encoding="utf-8"))
                data.append(part.with_suffix(".coverage"))
        return cls(root, data, seconds)

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

        of_file: dict[str, set[str]] = defaultdict(set)
        for test in self.seconds:
            of_file[test.partition("::")[0]].add(test)
        tests: dict[int, set[str]] = defaultdict(set)
        for part in filter(Path.is_file, self.data):
            data = CoverageData(basename=str(part))
            data.read()
            for line, contexts in data.contexts_by_lineno(str(self.root / file)).items():
                tests[line] |= self._tests(contexts, of_file)
            data.close()
        return tests

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
