"""What every component is: equations for a stage, data for its nodes, states at the start."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from resilience.arrays import Floats, Ints
from resilience.models.algebra import Affine, Labels, scatter
from resilience.models.language.stage import Stage
from resilience.models.network.situation import Situation

AT_BUS = "bus.energised"
"""Name in a stage of (buses,) whether a bus is energised; where it is not there, data tell."""


@dataclass(frozen=True)
class Injection:
    """Power that a component feeds into its buses, one entry per bus index.

    Attributes:
        p: MW.
        q: Mvar; None of devices without reactive power, and where the stage carries none.
        bus: index of the bus of every entry.
    """

    p: Affine
    q: Affine | None
    bus: Ints


class Component(Protocol):
    """Anything that emits into a stage: a fleet of like devices, the lines, the voltages."""

    def emit(self, stage: Stage) -> Injection | None:
        """Declares variables, rows, structures and costs; returns what it feeds in."""

    def data(self, situation: Situation) -> dict[str, Floats]:
        """Every datum it declared, arrays (devices, nodes)."""

    def start(self) -> dict[str, Floats]:
        """Its states at the start, arrays (devices,)."""


def inverter(stage: Stage, name: str, p: Affine, s_mva: Floats, rated: Ints) -> Affine | None:
    r"""Reactive power of inverters, $\sqrt{p^2 + q^2} \le s$; units without a rating keep q = 0.

    Args:
        stage: where to emit; without reactive power nothing is emitted.
        name: the component's name; the data `name.q_max` bounds q (zero in a dead island).
        p: active power (devices,), in MW.
        s_mva: apparent power ratings of the devices `rated`.
        rated: indices of the devices that have a rating.
    """
    if not stage.reactive:
        return None
    labels: Labels = p.labels or ()
    if not len(rated):
        return Affine.constant(0.0, p.n)
    names = [labels[i] for i in rated]
    limit = stage.data(f"{name}.q_max", names, unit="Mvar", about="reactive power limit")
    q = stage.var(f"{name}.q", names, -limit, limit, unit="Mvar", about="reactive power fed in")
    stage.disc(f"{name}.rating", s_mva, p[rated], q)
    return scatter(q, rated, p.n, labels)
