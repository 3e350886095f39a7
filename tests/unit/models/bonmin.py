"""Bonmin through CasADi: a cross-check of small mixed-integer AC plans, in a process of its own.

Bonmin may end in an uncaught C++ error, and may not heed its own time limit; neither may take the
caller with it. No method uses it: `minlp` has a proven bound, Bonmin has none on a nonconvex model.
"""

from __future__ import annotations

import pickle
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from resilience.arrays import Ints
from resilience.models.backends.base import NOTHING, Solution
from resilience.models.backends.casadi import NLP
from resilience.models.program.standard import Standard, Vectors

ALGORITHM = "B-BB"  # the others linearise, and cut off points where a cone is an equality


class Bonmin(NLP):
    """Holds what `NLP` holds, and integers; modes relaxed; no bound."""

    integers = True
    plugin = "bonmin"

    def _options(self, free: Ints, seconds: float, push: float | None) -> dict[str, Any]:
        settings: dict[str, Any] = {"algorithm": ALGORITHM, "print_level": 0, "bb_log_level": 0}
        if np.isfinite(seconds):
            settings["time_limit"] = seconds
        discrete = self.standard.integer[free].tolist()
        return {"bonmin": settings, "discrete": discrete, "print_time": False}


def solve_apart(standard: Standard, vectors: Vectors, time_limit: float) -> Solution:
    """Bonmin's answer, or nothing where it crashed or took longer than `time_limit` seconds."""
    with tempfile.TemporaryDirectory() as folder:
        request, answer = Path(folder) / "request", Path(folder) / "answer"
        request.write_bytes(pickle.dumps((standard, vectors, time_limit)))
        command = [sys.executable, __file__, str(request), str(answer)]
        try:
            subprocess.run(command, timeout=time_limit + 10.0, capture_output=True, check=True)
            return pickle.loads(answer.read_bytes())
        except (OSError, subprocess.SubprocessError):
            return NOTHING


def _main(request: str, answer: str) -> None:
    standard, vectors, time_limit = pickle.loads(Path(request).read_bytes())
    solver = Bonmin(standard, time_limit=time_limit)
    solver.update(vectors)
    Path(answer).write_bytes(pickle.dumps(solver.solve()))


if __name__ == "__main__":
    _main(*sys.argv[1:])
