"""Feeders with ties as published: kW and kvar of buses, ohm of lines, ties open.

- `feeder69`: M. E. Baran, F. F. Wu, Optimal capacitor placement on radial distribution systems,
  IEEE Transactions on Power Delivery 4 (1989) 725-734; with the five ties that the literature on
  reconfiguration gives it, 11-43, 13-21, 15-46, 50-59, 27-65: see J. S. Savier, D. Das, Impact of
  network reconfiguration on loss allocation of radial distribution systems, IEEE Transactions on
  Power Delivery 22 (2007) 2473-2480.
- `feeder118`: D. Zhang, Z. Fu, L. Zhang, An improved TS algorithm for loss-minimum reconfiguration
  in large-scale distribution systems, Electric Power Systems Research 77 (2007) 685-694.
- `feeder136`: J. R. S. Mantovani, F. Casari, R. A. Romero, Reconfiguração de sistemas de
  distribuição radiais utilizando o critério de queda de tensão, Controle & Automação 11 (2000)
  150-159.

Read from the data of MATPOWER 8 (case69, case118zh, case136ma).
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.case import Case
from resilience.case.document import Document
from resilience.case.load import build_case


@dataclass(frozen=True)
class PublishedFeeder:
    """Buses from 0, the first of them the root; impedances and loads in pu on 1 MVA.

    Attributes:
        name: of the case.
        ends: (lines, 2) buses.
        z: (lines,) complex.
        load: (buses,) complex.
        closed: (lines,) as published.
    """

    name: str
    ends: Ints
    z: Any
    load: Any
    closed: Bools

    def case(self) -> Case:
        """One hour, every line switchable; the objective is the losses in kW."""
        ohm = self.z * 100.0  # 1 pu at 10 kV
        total = self.load.sum()
        return build_case(Document(None, {
            "name": self.name,
            "loss_cost_per_mwh": 1000.0,
            "terminal_value_per_mwh": 0.0,
            "time": {"start": datetime(2026, 1, 1), "slots": 1, "step_min": 60},
            "network": {
                "v_min_pu": 0.9,
                "v_max_pu": 1.1,
                "bus": [{"name": str(k + 1), "vn_kv": 10.0} for k in range(len(self.load))],
                "line": [
                    {"name": str(k + 1), "from": str(i + 1), "to": str(j + 1)}
                    | {"r_ohm": z.real, "x_ohm": z.imag, "in_service": bool(closed)}
                    for k, ((i, j), z, closed) in enumerate(
                        zip(self.ends.tolist(), ohm, self.closed, strict=True)
                    )
                ],
            },
            "line": [{"name": str(k + 1), "switchable": True} for k in range(len(self.z))],
            "load": [
                {"name": f"load{k + 1}", "bus": str(k + 1), "p_max_mw": s.real, "q_mvar": s.imag}
                | {"shed_cost_per_mwh": 3000.0}
                for k, s in enumerate(self.load)
                if s
            ],
            "grid": [
                {"bus": "1", "v_pu": 1.0, "import_max_mw": 1.3 * total.real}
                | {"q_max_mvar": 1.3 * total.imag, "import_cost_per_mwh": 0.0}
            ],
        }))  # fmt: skip


def published(buses: int) -> PublishedFeeder:
    """The feeder of 69, 118 or 136 buses."""
    text = Path(__file__).with_name(f"feeder{buses}.csv").read_text()
    rows = list(csv.reader(text.splitlines()))[1:]
    kv = float(rows[0][1])
    places = {row[1]: k for k, row in enumerate(row for row in rows if row[0] == "bus")}
    lines = [row for row in rows if row[0] in ("line", "tie")]
    impedance: Floats = np.array([row[3:] for row in lines], float)
    load: Floats = np.array([row[2:4] for row in rows if row[0] == "bus"], float)
    return PublishedFeeder(
        name=f"feeder{buses}",
        ends=np.array([[places[row[1]], places[row[2]]] for row in lines], np.intp),
        z=(impedance[:, 0] + 1j * impedance[:, 1]) / kv**2,
        load=(load[:, 0] + 1j * load[:, 1]) / 1e3,
        closed=np.array([row[0] == "line" for row in lines]),
    )
