"""Feeders of growing size, every one with devices in the same density: the sizes of `growth`."""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Any

from resilience.case import Case, load_case
from resilience.case.schema import ESSTable, PVTable
from resilience.case.starter import new_case_text

SLOTS, STEP_MIN = 24, 60.0
DAY = [0.5 + 0.4 * math.sin((t - 9) * math.pi / 12) for t in range(SLOTS)]
SUN = [round(max(math.sin((t - 6) * math.pi / 12), 0.0), 6) for t in range(SLOTS)]
PV_EVERY, ESS_EVERY = 5, 7  # loads per plant: those of ieee33


def feeders(folder: Path) -> list[Case]:
    """33 buses from pandapower; 117 and about 1,000 from SimBench, written to `folder`.

    Raises ImportError where SimBench is not installed.
    """
    medium = _simbench("1-MV-semiurb--0-sw", 117, folder)
    both = _simbench("1-MVLV-semiurb-all-0-sw", 1000, folder)
    return [_case(source, folder) for source in ("case33bw", medium, both)]


def _simbench(code: str, buses: int, folder: Path) -> str:
    """The medium-voltage grid with as many of its low-voltage grids as `buses` allows."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # pandas and pandapower, about their own future
        import pandapower as pp
        import simbench
        from pandapower import toolbox

        net = simbench.get_simbench_net(code)
        sizes = net.bus.subnet[net.bus.subnet.str.match(r"LV[\d.]+$")].value_counts(sort=False)
        medium_voltage = (~net.bus.subnet.isin(sizes.index)).sum()
        fitting = set(sizes.index[sizes.cumsum() <= buses - medium_voltage])
        keep = net.bus.index[~net.bus.subnet.isin(set(sizes.index) - fitting)]
        # Two transformers side by side are a cycle, which radial physics does not take.
        net.trafo.loc[net.trafo.index[net.trafo.vn_hv_kv > 100][1:], "in_service"] = False
        path = folder / f"{code}.json"
        pp.to_json(toolbox.select_subnet(net, keep), str(path))
    return str(path)


def _case(source: str, folder: Path) -> Case:
    path = folder / f"{Path(source).stem}.toml"
    path.write_text(new_case_text(source), encoding="utf-8")
    case = load_case(path)
    load = tuple(table.model_copy(update={"profile": "day"}) for table in case.load)
    changes: dict[str, Any] = {"profiles": {"day": DAY, "sun": SUN}, "load": load}
    total_mw = sum(table.p_max_mw for table in load)
    changes["pv"] = tuple(
        PVTable(name=f"pv {t.bus}", bus=t.bus, p_max_mw=p, s_mva=1.1 * p, profile="sun")
        for t in load[::PV_EVERY]
        for p in [total_mw / len(load[::PV_EVERY])]
    )
    changes["ess"] = tuple(
        ESSTable(
            name=f"ess {t.bus}",
            bus=t.bus,
            p_max_mw=p,
            e_mwh=3.0 * p,
            s_mva=1.1 * p,
            efficiency_charge=0.95,
            efficiency_discharge=0.95,
            degradation_cost_per_mwh=5.0,
        )
        for t in load[::ESS_EVERY]
        for p in [0.5 * total_mw / len(load[::ESS_EVERY])]
    )
    return case.replace(slots=SLOTS, step_min=STEP_MIN, generator=(), **changes)
