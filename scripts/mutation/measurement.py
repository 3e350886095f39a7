"""What each test executes, and how long it takes, measured one file of tests after another."""

from __future__ import annotations

import hashlib
import json
from collections import defaultdict
from collections.abc import Generator, Iterable, Iterator
from functools import partial
from itertools import chain
from multiprocessing.connection import wait
from multiprocessing.context import ForkProcess
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from scripts.mutation.server import FAST, in_a_child, warm_up

if TYPE_CHECKING:
    from coverage import Coverage


def _files(root: Path) -> Iterator[Path]:
    """Everything that decides how the tests of a tree end."""
    folders = (root / name for name in ("resilience", "tests", "cases"))
    files = chain.from_iterable(folder.rglob("*") for folder in folders)
    return (path for path in files if path.is_file() and "__pycache__" not in path.parts)


def _hash(root: Path, files: Iterable[Path], begin: str = "") -> str:
    total = hashlib.sha256(begin.encode())
    for path in sorted(files):
        total.update(f"{path.relative_to(root)}\n".encode() + path.read_bytes())
    return total.hexdigest()[:12]


def fingerprint(root: Path) -> str:
    """A hash of everything that decides how the tests of a tree end."""
    return _hash(root, _files(root))


def parts(root: Path, folder: Path, tests: Iterable[str]) -> dict[str, Path]:
    """Where the measurement of every file of tests is kept: a path without suffix, by file.

    The files are in the order of the folders and files named in `tests`.

    Its name changes with the file and with all that the files of tests share, so that a changed
    file is measured again, and the others are not.
    """
    shared = _hash(root, (path for path in _files(root) if not path.name.startswith("test_")))
    files = chain.from_iterable(
        [root / name] if (root / name).is_file() else sorted((root / name).rglob("test_*.py"))
        for name in tests
    )
    return {
        str(path.relative_to(root)): folder / f"{path.stem}-{_hash(root, [path], shared)}"
        for path in files
    }


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


def measure(root: Path, file: str, part: Path) -> int:
    """Runs the fast tests of one file once, and writes what they execute beside `part`.

    The coverage is in `part` with the suffix `.coverage`. The seconds of every test that passed
    are in `.json`, which is written last: where it stands, the measurement is whole.

    Returns:
        The exit code of pytest.
    """
    from coverage import Coverage

    data = str(part.with_suffix(".coverage"))
    coverage = Coverage(data_file=data, source=[str(root / "resilience")], config_file=False)
    coverage.erase()
    recorder = Recorder(coverage)
    coverage.start()
    code = pytest.main([*FAST, str(root / file)], plugins=[recorder])
    coverage.stop()
    coverage.save()
    seconds = {test: time for test, time in recorder.seconds.items() if test not in recorder.failed}
    if code != pytest.ExitCode.INTERRUPTED:
        part.with_suffix(".json").write_text(json.dumps(seconds, indent=0), encoding="utf-8")
    return int(code)


def measured(root: Path, folder: Path, tests: Iterable[str], workers: int) -> list[Path]:
    """Measures the files of tests that were not measured yet, each in a child of its own.

    Returns:
        The parts of the measurement, see `parts`.

    Raises:
        SystemExit: a file of tests could not be measured.
    """
    folder.mkdir(parents=True, exist_ok=True)
    files = parts(root, folder, tests)
    missing = [file for file, part in files.items() if not _seconds(part).is_file()]
    if missing:
        print(f"measuring what the tests of {len(missing)} files execute", flush=True)
        warm_up()
    busy: dict[ForkProcess, str] = {}
    while missing or busy:
        while missing and len(busy) < workers:
            file = missing.pop(0)
            work = partial(measure, root, file, files[file])
            busy[in_a_child(work, root, files[file].with_suffix(".log"))] = file
        wait([child.sentinel for child in busy])
        for child in [child for child in busy if not child.is_alive()]:
            _told(busy.pop(child), files)
    return list(files.values())


def _seconds(part: Path) -> Path:
    return part.with_suffix(".json")


def _told(file: str, files: dict[str, Path]) -> None:
    """Says that a file was measured; stops where it could not be."""
    part = files[file]
    if not _seconds(part).is_file():
        raise SystemExit(f"{file} could not be measured; see {part.with_suffix('.log')}")
    tests = json.loads(_seconds(part).read_text(encoding="utf-8"))
    print(f"measured  {file}: {len(tests)} tests, {sum(tests.values()):.0f} s", flush=True)
