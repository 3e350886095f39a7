"""For those who write a backend or a dispatcher of their own, and for our own tests.

`small_case` builds a case of a few devices in memory, `TINY` holds programs small enough to solve
on paper. `check_backend` holds a backend against all of them, `check_dispatcher` a dispatcher
against the rules of the game.
"""

from __future__ import annotations

from resilience.testing import tiny_cases, tiny_linear, tiny_structures
from resilience.testing.backends import check_backend
from resilience.testing.cases import CaseOptimum, case_optimum, small_case
from resilience.testing.dispatchers import check_dispatcher, small_world
from resilience.testing.tiny import TINY, TinyProgram, tiny_program

# Importing these three fills TINY.
_SOURCES = (tiny_cases, tiny_linear, tiny_structures)

__all__ = [
    "TINY",
    "CaseOptimum",
    "TinyProgram",
    "case_optimum",
    "check_backend",
    "check_dispatcher",
    "small_case",
    "small_world",
    "tiny_program",
]
