"""What a dispatcher did: costs, energy and powers, slot by slot and scenario by scenario."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from resilience.arrays import Floats

if TYPE_CHECKING:
    import pandas as pd

    from resilience.case import Case
    from resilience.models.simulator import Step
    from resilience.simulation.slots import Stepper


@dataclass(frozen=True, eq=False)
class Trajectory:
    """What a dispatcher did in every scenario.

    Attributes:
        name: of the dispatcher.
        cost: (slots, scenarios) $.
        energy: (units, slots + 1, scenarios) MWh at the start of every slot, and at the end.
        storage: (units, slots, scenarios) MW fed in, discharging positive.
        flows: (columns, slots, scenarios) MW of every source.
        columns: names of the sources, as `load.shed[load1]`.
        step_h: length of a slot, hours.
        seconds: for all decisions.
        spill: (slots, scenarios) MW that had to be taken and could not be used.
        left_mwh: (scenarios,) energy whose worth is credited: what is left at the end, or at every
            midnight where the state of charge is reset; None: at the end.
        cpu_seconds: of the processor for all decisions.
        build_seconds, build_cpu_seconds: to make the dispatcher once.
        fuel: (tanks, slots + 1, scenarios) m³ at the start of every slot, and at the end; None
            without tanks.
        decisions: (decision columns, slots, scenarios) what runs, starts and stops, which lines are
            closed, and all else of the stage, states at the end of every slot; None where a case
            has neither commitment, ramps, curves nor switches.
        decision_columns: names of these, as `generator.on[gen1]`.
        proven: (scenarios,) $ that no method can stay below; of the clairvoyant only.
    """

    name: str
    cost: Floats
    energy: Floats
    storage: Floats
    flows: Floats
    columns: tuple[str, ...]
    step_h: float
    seconds: float = field(compare=False)
    spill: Floats | None = None
    left_mwh: Floats | None = None
    cpu_seconds: float = 0.0
    build_seconds: float = 0.0
    build_cpu_seconds: float = 0.0
    proven: Floats | None = None
    fuel: Floats | None = None
    decisions: Floats | None = None
    decision_columns: tuple[str, ...] = ()

    @classmethod
    def blank(cls, name: str, simulator: Stepper, case: Case, n: int) -> Trajectory:
        """Room for `n` scenarios over the horizon of a case."""
        units, slots, tanks = len(case.ess), case.slots, len(case.tank)
        columns, inner = simulator.columns, simulator.decision_columns
        return cls(
            name,
            cost=np.zeros((slots, n)),
            energy=np.zeros((units, slots + 1, n)),
            storage=np.zeros((units, slots, n)),
            flows=np.zeros((len(columns), slots, n)),
            columns=columns,
            step_h=case.step_h,
            seconds=0.0,
            spill=np.zeros((slots, n)),
            left_mwh=np.zeros(n),
            fuel=np.zeros((tanks, slots + 1, n)) if tanks else None,
            decisions=np.zeros((len(inner), slots, n)) if inner else None,
            decision_columns=inner,
        )

    def record(self, t: int, step: Step) -> None:
        """Writes what slot t did."""
        self.cost[t] = step.cost
        self.storage[:, t] = step.discharge - step.charge
        self.flows[:, t] = step.flows
        if self.spill is not None:
            self.spill[t] = step.spill.sum(0)
        if self.decisions is not None:
            self.decisions[:, t] = step.decisions

    @property
    def n(self) -> int:
        """Number of scenarios."""
        return int(self.cost.shape[1])

    def decided(self, name: str) -> Floats:
        """(devices, slots, scenarios) one kind of decision, as `generator.on`; empty without."""
        rows = [
            k for k, column in enumerate(self.decision_columns) if column.startswith(name + "[")
        ]
        nothing = np.empty((0, *self.cost.shape))
        return nothing if self.decisions is None else self.decisions[rows]

    def names_decided(self, name: str) -> tuple[str, ...]:
        """The devices of `decided`."""
        prefix = name + "["
        columns = self.decision_columns
        return tuple(c.removeprefix(prefix)[:-1] for c in columns if c.startswith(prefix))

    def flow(self, kind: str) -> Floats:
        """(devices, slots, scenarios) the flows of one kind, as `load.shed`."""
        rows = [k for k, name in enumerate(self.columns) if name.startswith(kind + "[")]
        return self.flows[rows]

    @property
    def shed(self) -> Floats:
        """(loads, slots, scenarios) MW not served, of every kind of load."""
        return self.flows[[k for k, name in enumerate(self.columns) if ".shed[" in name]]

    @property
    def shed_mwh(self) -> Floats:
        """(scenarios,) energy not served."""
        return self.shed.sum((0, 1)) * self.step_h

    @property
    def credited_mwh(self) -> Floats:
        """(scenarios,) energy left whose worth is credited."""
        return self.energy[:, -1].sum(0) if self.left_mwh is None else self.left_mwh

    def objective(self, value_per_mwh: float) -> Floats:
        """(scenarios,) $: cost less what the energy left is worth."""
        return self.cost.sum(0) - value_per_mwh * self.credited_mwh

    def frame(self, units: Sequence[str], tanks: Sequence[str] = ()) -> pd.DataFrame:
        """A row per episode and slot: $, MWh stored at its start, and MW of every device.

        Of tanks the m³ at its start.

        Storage feeds in when positive; the other columns are called as in the model.

        Args:
            units: names of the storage units.
            tanks: names of the tanks.
        """
        import pandas as pd

        slots, n = self.cost.shape
        index = pd.MultiIndex.from_product([range(n), range(slots)], names=["episode", "slot"])
        columns = {"cost": self.cost}
        columns |= {f"energy[{name}]": self.energy[k, :-1] for k, name in enumerate(units)}
        if self.fuel is not None:
            columns |= {f"fuel[{name}]": self.fuel[k, :-1] for k, name in enumerate(tanks)}
        columns |= {f"storage[{name}]": self.storage[k] for k, name in enumerate(units)}
        columns |= {name: self.flows[k] for k, name in enumerate(self.columns)}
        if self.decisions is not None:
            columns |= {name: self.decisions[k] for k, name in enumerate(self.decision_columns)}
        if self.spill is not None:
            columns["spill"] = self.spill
        return pd.DataFrame({name: v.T.ravel() for name, v in columns.items()}, index=index)


def joined(trajectories: Sequence[Trajectory]) -> Trajectory:
    """One trajectory from those of some scenarios each, in their order.

    Seconds of decisions add up; a dispatcher that was made more than once counts the longest time,
    since what it keeps on disk is found there later.
    """
    if len(trajectories) == 1:
        return trajectories[0]

    def concatenated(name: str) -> Floats | None:
        arrays = [getattr(trajectory, name) for trajectory in trajectories]
        return None if arrays[0] is None else np.concatenate(arrays, axis=-1)

    names = (
        "cost",
        "energy",
        "storage",
        "flows",
        "spill",
        "left_mwh",
        "proven",
        "fuel",
        "decisions",
    )
    arrays: dict[str, Any] = {name: concatenated(name) for name in names}
    return replace(
        trajectories[0],
        **arrays,
        seconds=sum(t.seconds for t in trajectories),
        cpu_seconds=sum(t.cpu_seconds for t in trajectories),
        build_seconds=max(t.build_seconds for t in trajectories),
        build_cpu_seconds=max(t.build_cpu_seconds for t in trajectories),
    )
