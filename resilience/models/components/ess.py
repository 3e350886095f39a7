r"""Energy storage (paper eqs. 2-4 and the first term of eq. 10).

$$ e' = e + \Delta t \left(\eta^\text{ch} p^\text{ch} - p^\text{dis} / \eta^\text{dis}\right),
\qquad \underline{s} E \le e' \le \overline{s} E, \qquad p^\text{ch} p^\text{dis} = 0 $$

$$ p = p^\text{dis} - p^\text{ch}, \qquad p^2 + q^2 \le S^2, \qquad
C = \Delta t \sum \lambda p^\text{dis} $$

The paper's $\delta^\text{ch}$ is $\eta^\text{ch}$ and its $\delta^\text{dis}$ is
$1/\eta^\text{dis}$; its $P^\text{ESS}$ is $-p$, positive when charging.

| symbol | name | unit |
|---|---|---|
| $e, e'$ | `ess.energy` at the start and end of the step | MWh |
| $E$ | `e_mwh` | MWh |
| $\underline{s}, \overline{s}$ | `soc_min`, `soc_max` | 1 |
| $p^\text{ch}$ | `ess.charge`, up to `p_max_mw` | MW |
| $p^\text{dis}$ | `ess.discharge`, up to `-p_min_mw` | MW |
| $q$ | `ess.q`, only with an inverter rating `s_mva` | Mvar |
| $\eta^\text{ch}, \eta^\text{dis}$ | `efficiency_charge`, `efficiency_discharge` | 1 |
| $\lambda$ | `degradation_cost_per_mwh` | $/MWh |
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.case.schema import ESSTable
from resilience.models.algebra import Affine, scatter
from resilience.models.components.base import Injection, inverter
from resilience.models.components.fleet import DeviceFleet, EnergyTerm, Role
from resilience.models.language.stage import Stage
from resilience.models.network.situation import Situation
from resilience.models.structures import Split

FILLED = "site.filled"
"""MWh that units come with in the slot before which they were built, see `sited`."""
FORMING_SHARE = 1e-3
"""Of its capacity, what a storage has to hold above its lowest energy to form an island."""
FORMING_TOLERANCE = 1e-6
"""Of its capacity: a storage so little below counts as one that holds it."""


@dataclass(frozen=True)
class ESS(DeviceFleet):
    """All storage units."""

    kind: ClassVar[str] = "ess"
    role: ClassVar[Role] = "storage"
    title: ClassVar[str] = "storage"
    colour: ClassVar[str] = "#0072b2"
    flows: ClassVar = {"ess.discharge": 1.0, "ess.charge": -1.0}
    limit: ClassVar[str] = "ess.discharge_max"
    fed: ClassVar = EnergyTerm("discharge", "discharged")
    intake: ClassVar = EnergyTerm("charge", "charged")
    stored: ClassVar = "ess.energy"
    forms: ClassVar = "ess.forms"

    tables: Sequence[ESSTable]

    @classmethod
    def showcase(cls) -> ESSTable:
        """A unit with an inverter rating."""
        return ESSTable(name="ess", bus="1", p_max_mw=1.0, e_mwh=1.0, s_mva=1.1, soc_final_min=0.5)

    @property
    def rated(self) -> Ints:
        """Units whose inverter has a rating."""
        return np.flatnonzero([t.s_mva is not None for t in self.tables])

    @property
    def s_mva(self) -> Floats:
        """Ratings of the rated units, in MVA."""
        return np.array([self.tables[i].s_mva for i in self.rated], float)

    def _array(self, key: str) -> Floats:
        return np.array([getattr(t, key) for t in self.tables], float)

    def power_range(self) -> tuple[Floats, Floats]:
        """The charging limit, negative, and the discharging limit."""
        return -self._array("p_max_mw"), -self._array("p_min_mw")

    def capacity(self) -> tuple[Floats, Floats]:
        """Its limits, or the inverter's rating where that is more."""
        rating = np.array([t.s_mva or 0.0 for t in self.tables])
        p_min, p_max = self.power_range()
        return np.maximum(p_max, rating), np.maximum(-p_min, rating)

    def apparent_mva(self) -> Floats:
        """The larger of its limits and the inverter's rating."""
        return np.maximum(*self.capacity())

    def size_mw(self) -> Floats:
        """The charging limit."""
        return self._array("p_max_mw")

    def size_mwh(self) -> Floats:
        """Energy capacity."""
        return self._array("e_mwh")

    def forming(self) -> Bools:
        """Those marked so that can discharge at all."""
        can_give = self._array("soc_max") - self._array("soc_min") >= FORMING_SHARE
        return super().forming() & can_give & (self._array("p_min_mw") < 0.0)

    def forms_surely(self) -> Bools:
        """None: a storage may be empty."""
        return np.zeros(len(self.tables), bool)

    def has_energy(self, energy: Floats) -> Bools:
        """Whether what is stored exceeds the lowest energy by 0.1 % of the capacity."""
        size = self._array("e_mwh")
        needed_mwh = size * (self._array("soc_min") + FORMING_SHARE - FORMING_TOLERANCE)
        return energy >= needed_mwh[:, None]

    def emit_forming(self, stage: Stage) -> None:
        """Declares which units form, by their energy at the start of the step."""
        units = np.flatnonzero(self.forming())
        if not len(units):
            return
        names, size = [self.names[i] for i in units], self._array("e_mwh")[units]
        # Half of the tolerance, for plans to be alive where they are simulated; and at the lowest
        # energy a rounding below would leave a program without a solution.
        low = self._array("soc_min")[units] - FORMING_TOLERANCE / 2.0
        now = stage["ess.energy.now"][units] - size * low
        gives = now * (1.0 / (FORMING_SHARE * size))
        works: Affine | float = 1.0
        if self.may_fail()[units].any():
            works = stage.data("ess.works", names, unit="1", about="whether it is in order")
        forms = stage.var("ess.forms", names, 0.0, works, unit="1", about="forms its island")
        lacks = stage.var("ess.lacks", names, 0.0, 1.0, unit="1", about="lack of energy to form")
        ones, zero = np.ones(len(units)), Affine.constant(0.0, len(units))
        stage.le("ess.forms.energy", forms, gives)
        stage.largest("ess.lacks", lacks, 1.0 - gives, zero)
        stage.structure(Split, "ess.forms", (forms, lacks), (ones, ones))

    @property
    def ending(self) -> Ints:
        """Units with a least energy at the end of the horizon."""
        return np.flatnonzero([t.soc_final_min is not None for t in self.tables])

    def _final(self, stage: Stage, after: Affine) -> None:
        """Energy `after` (units,) is enough at the end, or what lacks is paid for where it may."""
        units = self.ending
        names = [self.names[i] for i in units]
        needed = stage.data("ess.final_min", names, unit="MWh", about="least energy after the step")
        lack_max = stage.data("ess.final_lack_max", names, unit="MWh", about="lack allowed")
        price = stage.data("ess.final_price", names, unit="$/MWh", about="price of the lack")
        lack = stage.var(
            "ess.final_lack", names, 0.0, lack_max, unit="MWh", about="lack at the end"
        )
        stage.le("ess.final", needed - after[units], lack)
        stage.cost("ess.final", lack, price)

    def _final_data(self, situation: Situation) -> dict[str, Floats]:
        units, nodes = self.ending, situation.n
        is_last = np.zeros(nodes) if situation.is_last is None else situation.is_last * 1.0
        size = self._array("e_mwh")[units, None]
        final = np.array([self.tables[i].soc_final_min for i in units], float)[:, None]
        price = situation.final_price_per_mwh
        return {
            "ess.final_min": size * final * is_last,
            "ess.final_lack_max": size * np.full(nodes, float(price is not None)),
            "ess.final_price": np.full((len(units), nodes), price or 0.0),
        }

    def emit(self, stage: Stage) -> Injection:
        """Discharge less charge; the energy is the state."""
        size = self._array("e_mwh")
        now, after = stage.state(
            "ess.energy",
            self.names,
            size * self._array("soc_min"),
            size * self._array("soc_max"),
            unit="MWh",
            about="stored energy",
        )
        charge_max, discharge_max = (
            stage.data(f"ess.{way}_max", self.names, about=f"{way} limit")
            for way in ("charge", "discharge")
        )
        limits = self._array("p_max_mw"), -self._array("p_min_mw")
        charge, discharge = stage.split(
            "ess", self.names, (charge_max, discharge_max), limits, parts=("charge", "discharge")
        )
        gain = charge * self._array("efficiency_charge")
        drain = discharge * (1.0 / self._array("efficiency_discharge"))
        begins = now
        if FILLED in stage:
            filled: Affine = stage[FILLED]
            units = np.array([self.names.index(n) for n in filled.labels or ()], np.intp)
            begins = now + scatter(filled, units, len(self.names), self.names)
        stage.eq("ess.dynamics", after, begins + (gain - drain) * stage.dt)
        if len(self.ending):
            self._final(stage, after)
        price = self._array("degradation_cost_per_mwh")
        stage.cost("ess.degradation", discharge, price * stage.dt)
        p = discharge - charge
        return Injection(p, inverter(stage, "ess", p, self.s_mva, self.rated), self.bus)

    def data(self, situation: Situation) -> dict[str, Floats]:
        """Power limits, zero in a dead island."""
        alive = self.available(situation)
        return {
            "ess.charge_max": self._array("p_max_mw")[:, None] * alive,
            "ess.discharge_max": -self._array("p_min_mw")[:, None] * alive,
            "ess.q_max": self.s_mva[:, None] * alive[self.rated],
            **self._final_data(situation),
            **self._status_data(situation),
        }

    def _status_data(self, situation: Situation) -> dict[str, Floats]:
        """Whether forming units are in order; nothing where none of them may fail."""
        forming = self.forming()
        if not self.may_fail()[forming].any():
            return {}
        works = np.broadcast_to(situation.works(self.names), (len(self.tables), situation.n))
        return {"ess.works": works[forming].astype(float)}

    def start(self) -> dict[str, Floats]:
        """Stored energy at the start, in MWh."""
        return {"ess.energy": self._array("e_mwh") * self._array("soc_initial")}
