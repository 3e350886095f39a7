"""What an operator is answered: set-points of one slot, who decided them, and why."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import datetime
from functools import partial
from typing import Any, Literal, NamedTuple

import numpy as np

from resilience.case import Case
from resilience.models.components import in_roles
from resilience.models.simulator import Decision, Step
from resilience.operation.present import Present, by_name
from resilience.simulation.slots import Slot

FallbackKind = Literal["late", "failed", "unsound", "clock"]
FALLBACKS: dict[FallbackKind, str] = {
    "late": "no answer in time",
    "failed": "no answer",
    "unsound": "an answer that cannot be carried out",
    "clock": "the clock went back",
}
"""Why the rule decided in place of the method."""
CUT_SHARE = 1e-3
"""Of a storage's power, by which a set-point is told to be less than was asked for."""


@dataclass(frozen=True)
class Fallback:
    """Why the rule decided.

    Attributes:
        kind: see `FALLBACKS`.
        reason: the particulars.
    """

    kind: FallbackKind
    reason: str

    def __str__(self) -> str:
        return f"{FALLBACKS[self.kind]}: {self.reason}"


@dataclass(frozen=True)
class OperatorAnswer:
    """The decision for one slot.

    Powers are means over the slot, MW, fed in when positive: storage that charges and loads are
    negative.

    Attributes:
        slot: of the case's horizon.
        begins, ends: of the slot, local time.
        method: who was asked.
        decided_by: who decided: the method, or the rule in its place.
        fallback: why the rule did; None where the method did.
        power_mw: by device, of every kind.
        energy_mwh: by storage, at the end of the slot.
        soc: likewise, of its capacity.
        shed_mw: by load, those that are shed.
        running: by generator that needs commitment, whether it runs.
        closed: by line that can be switched, whether it is closed.
        fuel_m3: by tank, at the end of the slot.
        cost: $ of the slot, if load and weather are as told.
        why: sentences.
        notes: what was set right, cut back or taken for granted.
        audit: largest scaled violation of the stage's rows, and of which.
        seconds: that the method took.
        repeated: whether the slot had been decided before.
    """

    slot: int
    begins: datetime
    ends: datetime
    method: str
    decided_by: str
    fallback: Fallback | None
    power_mw: Mapping[str, float]
    energy_mwh: Mapping[str, float]
    soc: Mapping[str, float]
    shed_mw: Mapping[str, float]
    running: Mapping[str, bool]
    closed: Mapping[str, bool]
    fuel_m3: Mapping[str, float]
    cost: float
    why: Sequence[str] = ()
    notes: Sequence[str] = ()
    audit: Mapping[str, Any] = field(default_factory=dict)
    seconds: float = 0.0
    repeated: bool = False

    def summary(self) -> dict[str, Any]:
        """Plain data, as JSON has it."""
        stated = {name: getattr(self, name) for name in self.__dataclass_fields__}
        fallback = self.fallback
        return stated | {
            "begins": self.begins.isoformat(),
            "ends": self.ends.isoformat(),
            "fallback": None if fallback is None else asdict(fallback),
            "why": list(self.why),
            "notes": list(self.notes),
        }

    @classmethod
    def of_summary(cls, stated: Mapping[str, Any]) -> OperatorAnswer:
        """An answer from its plain data."""
        fallback = stated["fallback"]
        return cls(
            **{
                **stated,
                "begins": datetime.fromisoformat(stated["begins"]),
                "ends": datetime.fromisoformat(stated["ends"]),
                "fallback": None if fallback is None else Fallback(**fallback),
            }
        )


class SetPoints(NamedTuple):
    """What a step means for every device, by name; see `OperatorAnswer`."""

    power_mw: dict[str, float]
    energy_mwh: dict[str, float]
    soc: dict[str, float]
    shed_mw: dict[str, float]
    running: dict[str, bool]
    closed: dict[str, bool]
    fuel_m3: dict[str, float]


def set_points(present: Present, slot: Slot, step: Step) -> SetPoints:
    """The set-points of a step.

    Args:
        present: where it was made.
        slot: its data.
        step: what follows the decision.
    """
    case, fleets = present.setting.case, present.setting.microgrid.fleets.values()
    values = partial(present.flow, slot, step)
    power, shed = dict[str, float](), dict[str, float]()
    for fleet in in_roles(fleets, "storage", "dispatchable", "weather", "exchange", "load"):
        power |= by_name(fleet.names, fleet.power(values))
        if fleet.role == "load":
            shed |= {k: v for k, v in by_name(fleet.names, values(fleet.shed)).items() if v > 0.0}
    energy, soc = _stored(case, step)
    fuel = {} if step.fuel is None else by_name(present.tanks, step.fuel[:, 0])

    def switched(state: str) -> dict[str, bool]:
        names = present.labels.get(state, ())
        numbers = step.states[state][:, 0] if names else ()
        return {name: bool(round(x)) for name, x in zip(names, numbers, strict=True)}

    on, closed = switched("generator.on"), switched("line.closed")
    return SetPoints(power, energy, soc, shed, on, closed, fuel)


def _stored(case: Case, step: Step) -> tuple[dict[str, float], dict[str, float]]:
    """MWh in every storage at the end, and its state of charge."""
    names = [unit.name for unit in case.ess]
    size_mwh = np.array([unit.e_mwh for unit in case.ess])
    energy_mwh = step.energy[:, 0]
    return by_name(names, energy_mwh), by_name(names, energy_mwh / size_mwh)


def cut_back(present: Present, decision: Decision, step: Step) -> list[str]:
    """What of a decision's storage power could not be carried out, in words."""
    request, done = decision.power[:, 0], (step.charge - step.discharge)[:, 0]
    lines = []
    for unit, ask, did in zip(present.setting.case.ess, request, done, strict=True):
        size = max(unit.p_max_mw, -unit.p_min_mw)
        if abs(ask - did) > CUT_SHARE * size:
            lines.append(f"{unit.name} was to {_way(ask)}, and can {_way(did)}")
    return lines


def _way(power_mw: float) -> str:
    """`charge 0.500 MW` of a charging power."""
    if abs(power_mw) < 5e-4:
        return "do nothing"
    return f"{'charge' if power_mw > 0 else 'discharge'} {abs(power_mw):.3f} MW"
