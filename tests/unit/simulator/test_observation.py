"""The page of the manual that every writer of a dispatcher reads: its example must work."""

from __future__ import annotations

import inspect
import textwrap
from typing import Any

import numpy as np

import resilience as rs
from resilience.arrays import Floats
from resilience.testing import check_dispatcher


def test_the_dispatcher_of_the_docstring_keeps_to_the_rules() -> None:
    lines = inspect.getsource(rs.Dispatcher).splitlines()
    first = next(k for k, line in enumerate(lines) if line.strip() == "class Full:")
    last = next(k for k, line in enumerate(lines) if "rs.compare" in line)
    names: dict[str, Any] = {
        "np": np, "Floats": Floats, "World": rs.World, "Observation": rs.Observation,
    }  # fmt: skip
    exec(textwrap.dedent("\n".join(lines[first:last])), names)
    trajectory = check_dispatcher(names["Full"])
    assert trajectory.name == "full"
    assert trajectory.energy[:, -1].sum() > trajectory.energy[:, 0].sum()
