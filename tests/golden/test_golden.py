"""One LP file per component, as Pyomo writes it: a change of physics shows up as a difference.

Each file holds one component alone, over two slots of 15 minutes, with `rest_p` and `rest_q` for
whatever else feeds into its buses. Line 2-3 is out in the second slot.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from resilience.case import Case
from resilience.models.algebra import scatter
from resilience.models.backends.pyomo import Pyomo
from resilience.models.case_program import status
from resilience.models.components import DeviceFleet, Sited, Strengthened
from resilience.models.language.stage import Stage
from resilience.models.language.tree import Tree
from resilience.models.microgrid import Microgrid, Physics
from resilience.models.program.unroll import unroll
from resilience.testing import small_case

HERE = Path(__file__).parent
LOAD = {"p_max_mw": 2.0, "profile": "day", "power_factor": 0.8, "shed_cost_per_mwh": 10.0}
PV = {"p_max_mw": 3.0, "profile": "day", "cost_per_mwh": 0.5}
ESS = {
    "p_max_mw": 1.0,
    "p_min_mw": -2.0,
    "e_mwh": 4.0,
    "soc_min": 0.25,
    "efficiency_charge": 0.8,
    "efficiency_discharge": 0.5,
    "degradation_cost_per_mwh": 0.5,
    "s_mva": 2.5,
}
UNIT = {"p_max_mw": 4.0, "cost_per_mwh": 8.0, "q_min_mvar": -1.0, "q_max_mvar": 2.0}
COMMITTED = {
    "p_min_mw": 1.0,
    "no_load_cost_per_h": 4.0,
    "start_cost": 5.0,
    "min_up_h": 1.0,
    "min_down_h": 0.5,
}
RAMPED = {"ramp_up_mw_per_h": 2.0, "ramp_down_mw_per_h": 3.0, "p_initial_mw": 1.0}
CURVE = {"p_max_mw": 2.0, "cost_curve": [[0.0, 1.0], [1.0, 3.0], [2.0, 7.0]]}
COLD = {"cold_load_share": 0.8, "cold_load_h": 2.0}
TANKS = [
    {"capacity_m3": 2.0, "initial_m3": 1.5, "delivery": [{"hour": 0.25, "amount_m3": 0.5}]},
    {"capacity_m3": 1.0},
]
BURNERS = [
    {**UNIT, "tank": "tank1", "fuel_m3_per_mwh": 0.25, "fuel_no_load_m3_per_h": 0.1},
    {"p_max_mw": 2.0, "tank": "tank1", "fuel_curve": [[0.0, 0.0], [1.0, 0.25], [2.0, 0.75]]},
    {**UNIT, "tank": "tank2", "fuel_m3_per_mwh": 0.5},
    UNIT,
]
GRID = {
    "import_max_mw": 5.0,
    "export_max_mw": 2.0,
    "import_cost_per_mwh": 40.0,
    "export_cost_per_mwh": -20.0,
    "price_profile": "day",
}

# name of the file: (component, physics, tables of the case)
GOLDEN: dict[str, tuple[tuple[str, ...], Physics, dict[str, Any]]] = {
    "load": (("Loads",), "lindistflow", {"load": [LOAD, {**LOAD, "bus": "3", "priority": 2.0}]}),
    "load-block": (("Loads",), "copperplate", {"load": [{**LOAD, "block": True}]}),
    "load-cold": (("Loads", "ColdLoads"), "lindistflow", {"load": [{**LOAD, **COLD}, LOAD]}),
    "pv": (("PV",), "lindistflow", {"pv": [{**PV, "s_mva": 3.5}, {**PV, "curtailable": False}]}),
    "ess": (("ESS",), "lindistflow", {"ess": [ESS]}),
    "generator": (("Generators",), "lindistflow", {"generator": [UNIT]}),
    "generator-committed": (
        ("Generators",),
        "lindistflow",
        {"generator": [{**UNIT, **COMMITTED}]},
    ),
    "generator-ramped": (
        ("Generators",),
        "copperplate",
        {"generator": [{**UNIT, **RAMPED, "start_cost": 5.0, "p_min_mw": 1.0, "initial_on": True}]},
    ),
    "generator-curve": (("Generators",), "copperplate", {"generator": [CURVE]}),
    "tank": (("Generators", "Tanks"), "copperplate", {"tanks": TANKS, "generator": BURNERS}),
    "grid": (("Grids",), "lindistflow", {"grid": [GRID]}),
    "line-copperplate": (("Lines",), "copperplate", {}),
    "line-lindistflow": (("Buses", "Lines"), "lindistflow", {}),
    "line-distflow": (("Buses", "Lines"), "distflow", {}),
    "line-switchable": (
        ("Buses", "Lines", "Topology"),
        "lindistflow",
        {"line_tables": [{"name": "2-3", "switchable": True, "switching_cost": 1.5}]},
    ),
    "line-strengthened": (("Strengthened", "Buses", "Lines"), "lindistflow", {}),
    "site": (
        ("Sited", "ESS", "Generators", "PV"),
        "lindistflow",
        {"pv": [{**PV, "s_mva": 3.5}], "generator": [UNIT], "ess": [{**ESS, "bus": "3"}]},
    ),
}


def with_choices(microgrid: Microgrid, name: str) -> Microgrid:
    """The microgrid with what may be built, where a file is of that."""
    if name == "line-strengthened":
        # Of line 2-3, down in the second slot as it is: mended by one option, lost at once by one.
        bare, strong = np.array([[True, False]]), np.array([[True, True], [False, True]])
        options, lines = ("2-3 x1.5", "2-3 underground"), np.zeros(2, np.intp)
        return replace(
            microgrid,
            strengthened=Strengthened(("2-3",), options, lines, np.array([3.0, 4.0]), bare, strong),
        )
    if name == "site":
        case = microgrid.case
        units = [*case.ess, *case.generator, *case.pv]
        output, follows = np.array([1.0, 1.0, 0.75]), np.array([False, False, False])
        sited = Sited(units, follows, np.array([5.0, 6.0, 7.0]), output, begins=True)
        return replace(microgrid, sited=sited)
    return microgrid


def tiny_case(**tables: Any) -> Case:
    """Three buses in a row; the last line may fail, and both ends may carry an island."""
    forming = {"import_max_mw": 5.0, "import_cost_per_mwh": 1.0, "v_pu": 1.05}
    line_tables = [{"name": "2-3", "rating_mva": 2.0}]
    tables = {"grid": [forming], "ess": [{**ESS, "bus": "3"}], "line_tables": line_tables, **tables}
    return small_case(
        step_min=15.0,
        buses=3,
        lines=[(1, 2, 0.01, 0.02), (2, 3, 0.02, 0.04)],
        profiles={"day": [0.5, 1.0]},
        outages=["2-3@00:15-00:30"],
        **tables,
    )


def alone(microgrid: Microgrid, kinds: tuple[str, ...]) -> Pyomo:
    """The components of these kinds in a stage of their own, unrolled over the case's slots."""
    case = microgrid.case
    chosen = [c for c in microgrid.components if type(c).__name__ in kinds]
    stage = Stage(case.step_h, reactive=microgrid.physics != "copperplate")
    names = microgrid.network.bus_names
    fed = []
    for component in chosen:
        if (power := component.emit(stage)) is not None:
            fed.append(power)
            if microgrid.sited is not None and isinstance(component, DeviceFleet):
                microgrid.sited.limit(stage, component, power)
    at = np.unique(np.concatenate([injection.bus for injection in fed]))
    for word in ("p", "q") if stage.reactive else ("p",):
        rest = stage.var(f"rest.{word}", [names[k] for k in at], -9.0, 9.0)
        for injection in fed:
            power = getattr(injection, word)
            rest = rest + scatter(power, np.searchsorted(at, injection.bus), len(at))
        stage.eq(f"balance.{word}", rest)
    problem = unroll([stage], Tree.chain([case.slot_label(t) for t in range(case.slots)]))
    situation = microgrid.situation(status(case))
    data = {k: v for c in chosen for k, v in c.data(situation).items()}
    start = {k: v for c in chosen for k, v in c.start().items()}
    model = Pyomo(problem, solver="scip")  # discs and cones as quadratic rows; nothing is solved
    model.update(problem.vectors(data, start))
    return model


def rounded(text: str) -> str:
    """Numbers to ten digits: the last ones differ from one machine to the next."""
    return re.sub(r"[-+]?\d+\.\d+(e[-+]?\d+)?", lambda m: f"{float(m[0]):+.10g}", text)


def written(name: str, folder: Path) -> str:
    kinds, physics, tables = GOLDEN[name]
    path = folder / f"{name}.lp"
    microgrid = with_choices(Microgrid.build(tiny_case(**tables), physics), name)
    alone(microgrid, kinds).write(path)
    return rounded(path.read_text())


@pytest.mark.parametrize("name", GOLDEN)
def test_the_component_is_written_as_it_was(name: str, tmp_path: Path, regenerate: bool) -> None:
    text, golden = written(name, tmp_path), HERE / f"{name}.lp"
    if regenerate:
        golden.write_text(text)
    assert golden.exists(), "run `pytest tests/golden --regenerate`"
    assert text == golden.read_text()


def test_no_file_is_left_over() -> None:
    assert {path.stem for path in HERE.glob("*.lp")} == set(GOLDEN)
