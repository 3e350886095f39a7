"""A day of ieee33, 96 slots and 33 buses, with every method; and the command as users run it."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from bench.linear import relaxed
from bench.row import Row, below, timed
from resilience.case import load_case
from resilience.models.backends.base import Backend, Solution
from resilience.models.backends.casadi import NLP
from resilience.models.backends.conic import Conic
from resilience.models.backends.highs import Highs
from resilience.models.case_program import horizon
from resilience.models.program.standard import Vectors
from resilience.planning.solve import solve

ROOT = Path(__file__).parents[1]
ALONE = Path(__file__).with_name("alone.py")
LIMIT_S, GRACE_S = 60, 3
MAIN = "from resilience.cli import main; main()"


def help_text() -> Iterator[Row]:
    """The best of five, because the first one fills the disk cache."""
    seconds = min(run_command("--help").seconds for _ in range(5))
    yield below("resilience --help", seconds, 0.4, "s")


def day() -> Iterator[Row]:
    case = load_case("ieee33")
    flat, ac = horizon(case, "lindistflow"), horizon(case, "distflow")
    seconds, lp = timed(_solve, Highs(relaxed(flat.standard)), flat.vectors)
    yield below("LP, 96 slots x 33 buses", seconds, 1.0, "s", lp.status)
    seconds, root = timed(_solve, Conic(ac.standard), ac.vectors)
    yield below("SOCP, 96 slots x 33 buses", seconds, 5.0, "s", f"{root.status}, imports included")
    for method, limit_s in (("lp", 60.0), ("socp", 40.0), ("minlp", 90.0)):
        seconds, plan = timed(solve, "large", method, time_limit=200.0)
        yield below(f"{method} on the large case, 975 buses", seconds, limit_s, "s", plan.status)
    polish = NLP(ac.standard)
    polish.start_from(root.point)
    seconds, polished = timed(_solve, polish, ac.vectors)
    apart = (polished.objective - root.bound) / abs(root.bound)
    note = f"{polished.status}, {100 * apart:.1g} % above the bound, imports included"
    yield below("AC polish from that point", seconds, 10.0, "s", note)


def _solve(solver: Backend, vectors: Vectors) -> Solution:
    solver.update(vectors)
    return solver.solve()


def main_job() -> Iterator[Row]:
    for case, max_percent, commitment in (
        ("ieee33", 0.1, "no commitment"),
        ("ieee33-commitment", 1.0, "commitment"),
    ):
        solve = ("solve", case, "--method", "minlp", "--json", "--time-limit", str(LIMIT_S))
        run = run_command(*solve)
        plan = json.loads(run.output)
        percent, seconds = 100 * plan["gap"], plan["seconds"]
        yield Row(
            f"minlp {case} ({commitment}), gap in 60 s",
            f"{percent:.2g} % in {seconds:.1f} s",
            f"<= {max_percent:g} %",
            percent <= max_percent and seconds <= LIMIT_S + GRACE_S,
            plan["status"],
        )
        note = f"resilience solve, {run.seconds:.1f} s from start to exit"
        yield below(f"minlp {case}, peak memory", run.peak_mb / 1e3, 1.0, "GB", note)


@dataclass(frozen=True)
class CommandRun:
    """What a command took, from start to exit, and what it printed."""

    seconds: float
    peak_mb: float
    output: str


def run_command(*arguments: str) -> CommandRun:
    """Runs `resilience` with arguments, in a process that counts no memory but its own."""
    command = [sys.executable, str(ALONE), sys.executable, "-c", MAIN, *arguments]
    printed = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, check=True).stdout
    measured = json.loads(printed)
    if measured.pop("exit_code"):
        raise RuntimeError(f"resilience {' '.join(arguments)} failed")
    return CommandRun(**measured)
