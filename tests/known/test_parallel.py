"""Two parallel circuits of which one fails."""

from __future__ import annotations

from datetime import datetime
from typing import Any

import numpy as np
import pytest

from resilience import solve
from resilience.case import Case
from resilience.case.document import Document
from resilience.case.load import build_case

Z = {"a": 0.013 + 0.021j, "b": 0.027 + 0.017j}  # pu on 1 MVA; 100 ohm are 1 pu at 10 kV
LOAD, PRICE, V_PU = 0.9 + 0.4j, 20.0, 1.03


def twin() -> Case:
    """A grid and a load at the ends of lines a and b, which point in opposite directions."""
    cos_phi = LOAD.real / abs(LOAD)
    lines = [
        {"name": name, "from": i, "to": j, "r_ohm": Z[name].real * 100, "x_ohm": Z[name].imag * 100}
        for name, i, j in (("a", "1", "2"), ("b", "2", "1"))
    ]
    case: dict[str, Any] = {
        "name": "twin",
        "outages": ["b@01:00-03:00"],
        "time": {"start": datetime(2016, 7, 12), "slots": 4, "step_min": 60.0},
        "network": {"bus": [{"name": k, "vn_kv": 10.0} for k in "12"], "line": lines},
        "load": [{"name": "load", "bus": "2", "p_max_mw": LOAD.real, "power_factor": cos_phi,
                  "shed_cost_per_mwh": 90.0}],
        "grid": [{"name": "grid", "bus": "1", "import_max_mw": 5.0, "v_pu": V_PU,
                  "import_cost_per_mwh": PRICE}],
    }  # fmt: skip
    return build_case(Document(None, case))


Z_OF_SLOT = [Z["a"] * Z["b"] / (Z["a"] + Z["b"]), Z["a"]]  # both up; b out


def test_without_losses_the_drop_is_that_of_what_is_up() -> None:
    plan = solve(twin(), method="lp", physics="lindistflow")
    squares = [V_PU**2 - 2 * (z.real * LOAD.real + z.imag * LOAD.imag) for z in Z_OF_SLOT]
    assert plan.tables["voltage"]["2"][:2] == pytest.approx(np.sqrt(squares), rel=1e-6)
    assert plan.objective == pytest.approx(4 * PRICE * LOAD.real)


@pytest.mark.parametrize("method", ["socp", "nlp", "minlp"])
def test_with_losses_it_is_the_power_flow_of_what_is_up(method: str) -> None:
    plan = solve(twin(), method=method)
    for t, z in enumerate(Z_OF_SLOT):
        v = complex(V_PU)
        for _ in range(60):
            v = V_PU - z * np.conj(LOAD / v)
        assert plan.tables["voltage"]["2"][t] == pytest.approx(abs(v), abs=1e-5)


def test_merged_buses_carry_it_all() -> None:
    plan = solve(twin(), method="lp", physics="copperplate")
    assert plan.objective == pytest.approx(4 * PRICE * LOAD.real)
