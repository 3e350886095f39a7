"""A fork server: heavy libraries are imported once, every mutant is tried in a child of its own.

Each of the workers owns a copy of the tree. A mutant is written into the copy, a forked child
imports the package from there and runs the tests, and the copy is put right again. The tree
itself is never touched.
"""

from __future__ import annotations

import contextlib
import importlib
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from multiprocessing.connection import wait
from multiprocessing.context import ForkProcess
from pathlib import Path
from typing import Literal

import pytest

from scripts.mutation.mutants import Mutant

HEAVY = ["numpy", "scipy.sparse.linalg", "scipy.optimize", "pandas", "pydantic", "networkx"]
HEAVY += ["casadi", "cvxpy", "highspy", "clarabel", "pyomo.environ", "joblib"]
"""What children find imported already; nothing of the package, and nothing that pytest rewrites."""
FAST = ["-q", "-p", "no:cacheprovider", "-p", "no:benchmark", "--hypothesis-seed=0"]
FAST += ["-m", "not slow", "--tb=line"]
"""Arguments of pytest for every run, measured or mutated."""
Status = Literal["killed", "timeout", "survived"]


@dataclass(frozen=True)
class Trial:
    """A mutant, or None for a control, with the tests that shall notice.

    Attributes:
        mutant: the fault; None runs the tests on the tree as it is.
        tests: names of tests, in their order.
        limit: seconds after which they are ended.
        candidates: how many tests execute the line.
    """

    mutant: Mutant | None
    tests: list[str]
    limit: float
    candidates: int


@dataclass(frozen=True)
class Outcome:
    """How a trial ended.

    Attributes:
        trial: what was tried.
        status: a test failed, time was up, or nobody noticed.
        seconds: from fork to end.
        log: the last lines that pytest wrote.
    """

    trial: Trial
    status: Status
    seconds: float
    log: str


def copied(root: Path, target: Path) -> Path:
    """A copy of the tree: files that git knows, or would take."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=root, check=True, capture_output=True, text=True).stdout
    for name in filter(None, listed.split("\0")):
        if (root / name).is_file():
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(root / name, target / name)
    return target


def in_a_child(work: Callable[[], int], folder: Path, log: Path) -> ForkProcess:
    """Starts work in a forked child, in a folder and a group of processes of its own."""

    def run() -> None:
        os.setsid()
        os.chdir(folder)
        os.environ["PYTHONPATH"] = str(folder)
        stream = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        for standard in (1, 2):
            os.dup2(stream, standard)
        sys.path.insert(0, str(folder))
        sys.exit(work())

    process = multiprocessing.get_context("fork").Process(target=run)
    process.start()
    return process


def _tested(folder: Path, tests: list[str]) -> int:
    code = pytest.main([*FAST, "-x", f"--rootdir={folder}", *tests])
    package = sys.modules.get("resilience")
    if package is not None and not str(package.__file__).startswith(str(folder)):
        raise RuntimeError(f"the package was imported from {package.__file__}")
    return int(code)


class Worker:
    """One copy of the tree, in which one trial runs at a time."""

    def __init__(self, root: Path, folder: Path) -> None:
        self.folder = copied(root, folder)
        self.log = folder.with_suffix(".log")
        self.written = 0

    def start(self, trial: Trial) -> None:
        self.trial = trial
        if trial.mutant is not None:
            path = self.folder / trial.mutant.file
            self.module = path.read_bytes()
            path.write_bytes(trial.mutant.applied(self.module))
            self.written += 1  # a time of its own, so that no compiled file of another is taken
            os.utime(path, (self.written, self.written))
        self.begin = time.monotonic()
        self.process = in_a_child(lambda: _tested(self.folder, trial.tests), self.folder, self.log)

    def late(self) -> bool:
        return time.monotonic() - self.begin > self.trial.limit

    def end(self) -> Outcome:
        """Ends what still runs, puts the copy right, and says how it went."""
        status: Status = "timeout" if self.process.is_alive() else "survived"
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid or 0, signal.SIGKILL)
        self.process.join()
        if status == "survived" and self.process.exitcode != 0:
            status = "killed"
        if self.trial.mutant is not None:
            (self.folder / self.trial.mutant.file).write_bytes(self.module)
        log = self.log.read_text(encoding="utf-8", errors="replace").strip()
        lines = log.splitlines()[-8:]
        return Outcome(self.trial, status, time.monotonic() - self.begin, "\n".join(lines))


def warm_up() -> None:
    """Imports the heavy libraries, with one thread each: children are forked from here."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"
    for name in HEAVY:
        importlib.import_module(name)


def outcomes(root: Path, trials: Iterable[Trial], workers: int, folder: Path) -> Iterator[Outcome]:
    """Runs trials, and yields how each went as soon as it ends."""
    idle = [Worker(root, folder / f"tree{k}") for k in range(workers)]
    busy: list[Worker] = []
    queue = iter(trials)
    while True:
        while idle and (trial := next(queue, None)) is not None:
            busy.append(idle.pop())
            busy[-1].start(trial)
        if not busy:
            return
        wait([worker.process.sentinel for worker in busy], timeout=0.5)
        for worker in [one for one in busy if one.late() or not one.process.is_alive()]:
            busy.remove(worker)
            idle.append(worker)
            yield worker.end()
