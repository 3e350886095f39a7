"""Puts small faults into the package, one at a time, and counts those that a test notices.

    python scripts/mutate.py --sample 150                    # slips of the hand
    python scripts/mutate.py --sample 100 --aimed            # a term, a factor, a guard left out
    python scripts/mutate.py --modules 'resilience/case/*' --sample 40 --seed 7
    python scripts/mutate.py --again .cache/mutate/<tree>/random-5.jsonl   # its survivors

Needs coverage.py (`pip install coverage`). What every test executes is measured once, file by file,
and kept in `.cache/mutate/`, and so is every verdict: a run that was stopped goes on where it was.
"""

from __future__ import annotations

import sys
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
    from scripts.mutation.run import main

    main()
