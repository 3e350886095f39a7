"""Many changed files of a kind, by hand: `python -m tests.fuzz.run KIND ... -n 20000 --seed 1`.

Goes on after a fault, tells every place of the code once, and says how many files were read and
how many refused. Without kinds it lists them.
"""

from __future__ import annotations

import argparse
import time
import traceback
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory

from hypothesis import HealthCheck, Phase, given, seed, settings

from tests.fuzz.every import KINDS
from tests.fuzz.kinds import Files, Ground
from tests.fuzz.verdict import FaultError


def place(error: FaultError) -> str:
    """Where in the package a fault comes from, and what it says."""
    cause = error.__cause__ or error
    frames = traceback.extract_tb(cause.__traceback__)
    inner = [f"{Path(f.filename).name}:{f.lineno}" for f in frames if "/resilience/" in f.filename]
    return f"{' < '.join(reversed(inner[-2:]))}  {str(error)[:160]!r}"


def campaign(name: str, n: int, number: int, keep: Path | None) -> None:
    """Tries `n` files of a kind and prints what came of them."""
    counts, faults = Counter[str](), dict[str, int]()
    began = time.process_time()
    with TemporaryDirectory() as folder:
        ground = Ground(KINDS[name], Path(folder))

        @seed(number)
        @settings(
            max_examples=n,
            database=None,
            deadline=None,
            phases=[Phase.generate],
            suppress_health_check=list(HealthCheck),
        )
        @given(ground.changes)
        def each_file(changed: Files) -> None:
            try:
                counts[ground.judge(changed)] += 1
            except FaultError as error:
                counts["fault"] += 1
                key = place(error).split("  ")[0] + str(error)[:40]
                faults[key] = faults.get(key, 0) + 1
                if faults[key] == 1:
                    print(f"  {place(error)}", flush=True)
                    for file, data in changed.items():
                        if keep is not None:
                            kept = f"{name}-{len(faults)}-{Path(file).name}".replace(" ", "_")
                            keep.mkdir(parents=True, exist_ok=True)
                            (keep / kept).write_bytes(data)

        each_file()
    seconds = time.process_time() - began
    print(
        f"{name}: seed {number}, {sum(counts.values())} files, {dict(counts)}, {seconds:.0f} s",
        flush=True,
    )


def main() -> None:
    """Reads the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kinds", nargs="*")
    parser.add_argument("-n", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="folder for the first file of every fault")
    options = parser.parse_args()
    if not options.kinds:
        print("\n".join(KINDS))
    for name in KINDS if options.kinds == ["all"] else options.kinds:
        campaign(name, options.n, options.seed, options.keep)


if __name__ == "__main__":
    main()
