"""The command line of a mutation run: a sample by seed, its verdicts, a table."""

from __future__ import annotations

import argparse
import ast
import tempfile
from collections.abc import Iterator
from fnmatch import fnmatch
from pathlib import Path
from typing import TextIO

from scripts.mutation.measurement import fingerprint, measured
from scripts.mutation.mutants import Mutant, Signatures, mutants
from scripts.mutation.report import Verdict, equivalents, read_verdicts, table
from scripts.mutation.selection import Selection
from scripts.mutation.server import Trial, outcomes, warm_up

ROOT = Path(__file__).resolve().parents[2]
MODULES = [
    "resilience/models/*",
    "resilience/dispatch/*",
    "resilience/fragility/*",
    "resilience/planning/two_stage/*",
    "resilience/evaluation/measures/*",
    "resilience/case/profiles.py",
    "resilience/case/outages.py",
]
"""The modules that carry the truth."""
GRACE = 30.0
"""Seconds for imports and collection, which come on top of a multiple of the tests' own."""
FACTOR = 5.0
"""How many times longer than without a fault the tests of a mutant may take."""
CONTROL_EVERY = 20
"""Before how many mutants the tests of the next one run without a fault."""


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="mutate.py")
    parser.add_argument("--modules", nargs="+", default=MODULES, metavar="GLOB")
    parser.add_argument(
        "--sample", type=int, default=150, help="how many mutants; 150 if not given"
    )
    parser.add_argument("--seed", type=int, default=5, help="which ones; 5 if not given")
    parser.add_argument("--aimed", action="store_true", help="leave out parts, no slips")
    parser.add_argument("--again", type=Path, metavar="RESULTS", help="survivors of another run")
    parser.add_argument("--tests", nargs="+", default=["tests"], metavar="PATH", help="of tests")
    parser.add_argument("--budget", type=float, default=20.0, help="seconds of tests per mutant")
    parser.add_argument("--workers", type=int, default=1)
    return parser.parse_args()


def candidates(modules: list[str], kind: str) -> list[Mutant]:
    """All mutants of a kind in modules whose paths match."""
    files = sorted(path.relative_to(ROOT) for path in (ROOT / "resilience").rglob("*.py"))
    signatures = Signatures.of(ast.parse((ROOT / file).read_bytes()) for file in files)
    names = [str(file) for file in files if any(fnmatch(str(file), glob) for glob in modules)]
    return [one for name in names for one in mutants(ROOT, name, signatures) if one.kind == kind]


def trials(sample: list[Mutant], selection: Selection, budget: float) -> Iterator[Trial]:
    """A trial per mutant, and a control before every twentieth."""
    for number, mutant in enumerate(sample):
        tests = selection.of_mutant(mutant)
        order = selection.order(tests, mutant.file, budget)
        limit = GRACE + FACTOR * sum(selection.seconds[test] for test in order)
        if number % CONTROL_EVERY == 0:
            yield Trial(None, order, limit, len(tests))
        yield Trial(mutant, order, limit, len(tests))


def run(
    sample: list[Mutant], selection: Selection, file: TextIO, budget: float, workers: int
) -> None:
    """Tries mutants, and writes each verdict down as soon as it is known."""
    executed = [mutant for mutant in sample if selection.of_mutant(mutant)]
    for mutant in sample:
        if mutant not in executed:
            file.write(Verdict.of(mutant, "unexecuted").line_of_json())
    warm_up()
    with tempfile.TemporaryDirectory(prefix="mutate-") as folder:
        queue = trials(executed, selection, budget)
        for outcome in outcomes(ROOT, queue, workers, Path(folder)):
            fault = outcome.trial.mutant
            if fault is not None:
                file.write(Verdict.of_outcome(fault, outcome).line_of_json())
                file.flush()
                print(f"{outcome.status:9} {fault.file}:{fault.line}", flush=True)
            elif outcome.status != "survived":
                raise SystemExit(f"a control without a fault failed:\n{outcome.log}")


def chosen(options: argparse.Namespace, folder: Path) -> tuple[list[Mutant], Path]:
    """The mutants to try, and the file of their verdicts."""
    if options.again:
        keys = {one.key for one in read_verdicts(options.again).values() if one.lives}
        every = candidates(["*"], "random") + candidates(["*"], "aimed")
        return [one for one in every if one.key in keys], folder / f"again-{options.again.name}"
    kind = "aimed" if options.aimed else "random"
    every = sorted(candidates(options.modules, kind), key=lambda one: one.rank(options.seed))
    return every[: options.sample], folder / f"{kind}-{options.seed}.jsonl"


def main() -> None:
    """Samples mutants, tries those without a verdict, and prints the survivors and a table."""
    options = arguments()
    cache = ROOT / ".cache" / "mutate"
    parts = measured(ROOT, cache / "measured", options.tests, options.workers)
    selection = Selection.read(ROOT, parts)
    folder = cache / fingerprint(ROOT)
    folder.mkdir(exist_ok=True)
    sample, results = chosen(options, folder)
    noted = equivalents()
    changing = [mutant for mutant in sample if mutant.key not in noted]
    tried = read_verdicts(results)
    with results.open("a", encoding="utf-8") as file:
        fresh = [mutant for mutant in changing if mutant.key not in tried]
        run(fresh, selection, file, options.budget, options.workers)
    verdicts = read_verdicts(results)
    for mutant in sample:
        if mutant.key in noted:
            verdicts[mutant.key] = Verdict.of(mutant, "equivalent", reason=noted[mutant.key])
    of_sample = [verdicts[mutant.key] for mutant in sample]
    print(*(verdict.difference() for verdict in of_sample if verdict.lives), sep="\n")
    print(table(of_sample), f"results: {results}", sep="\n")
