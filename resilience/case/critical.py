"""Which loads are critical."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from resilience.arrays import Bools
from resilience.case.schema import LoadTable

if TYPE_CHECKING:
    from resilience.case.data import Case


def critical_loads(case: Case) -> Bools:
    """(loads,) those marked `critical`; where none is, those of a priority above 1."""
    loads = case.tables_of(LoadTable)
    marked = np.array([load.critical for load in loads], bool)
    if marked.any():
        return marked
    return np.array([load.priority > 1.0 for load in loads], bool)
