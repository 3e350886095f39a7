"""What lines are made of: arrays that `line.py` puts into equations, and the limits of flows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from resilience.arrays import Bools, Complexes, Floats, Ints
from resilience.models.algebra import Labels
from resilience.models.network.limits import MARGIN, FlowLimits


@dataclass(frozen=True)
class LineData:
    """The lines that can be closed. Arrays are (lines,); powers in MW, impedances in pu (1 MVA).

    Attributes:
        names: of the lines.
        from_bus, to_bus: indices of the buses at their ends.
        r, x: series impedance, pu.
        ratio: of the ideal transformer at the first end, tap and phase shift.
        y_from, y_to: charging at the two ends, pu; the first behind the ratio.
        rating: thermal limit, MVA; infinite without one.
        angle_min, angle_max: how much the voltage behind the ratio may lead that at the second end,
            rad; infinite without a limit.
        limits: F in the module's docstring, and what it is made of.
        determined: lines whose flow follows from the injections; elsewhere it may circulate.
        fallible: lines that data may take out.
        switchable: lines with a binary status.
        closed: status of the switchable lines at the start.
        switching_cost: $ each time a line is opened or closed.
        v_min, v_max: (buses,) lowest and highest voltage, pu; None where there are no voltages, and
            a rating is a bound in place of a disc.
        losses: DistFlow; without it LinDistFlow where the stage carries reactive power.
        loss_cost_per_mwh: of what is lost, besides what feeding it in costs.
        may_be_dark: a dead island has no voltage; elsewhere it means nothing there.
        strengthened: (lines,) lines whose status follows from what is built, see `strengthened`;
            None where there are none.
        looped: (lines,) those in a loop; None where the network is radial.
        loop_shift: (lines,) phase shift that is left of each round its loop, rad.
    """

    names: Labels
    from_bus: Ints
    to_bus: Ints
    r: Floats
    x: Floats
    ratio: Complexes
    y_from: Complexes
    y_to: Complexes
    rating: Floats
    angle_min: Floats
    angle_max: Floats
    limits: FlowLimits
    determined: Bools
    fallible: Bools
    switchable: Bools
    closed: Bools
    switching_cost: Floats
    v_min: Floats | None
    v_max: Floats | None
    losses: bool
    loss_cost_per_mwh: float = 0.0
    may_be_dark: bool = False
    strengthened: Bools | None = None
    looped: Bools | None = None
    loop_shift: Floats | None = None

    @property
    def decided(self) -> Bools:
        """(lines,) lines whose status is a column: switchable, or strengthened."""
        if self.strengthened is None:
            return self.switchable
        return np.asarray(self.switchable | self.strengthened)

    @property
    def in_loop(self) -> Bools:
        """(lines,) `looped`, of which there are none in a radial network."""
        return np.zeros(len(self.names), bool) if self.looped is None else self.looped

    @property
    def tap(self) -> Floats:
        """(lines,) magnitude of the ratio."""
        return np.abs(self.ratio)

    @property
    def peaks(self) -> tuple[Floats, Floats, Floats]:
        """(lines,) `forth`, `back` and `l_max` at the peaks of all profiles."""
        forth, back, l_max = self._limits(self.limits.peak[:, None])
        return forth[:, 0], back[:, 0], l_max[:, 0]

    def _limits(self, profiles: Floats) -> tuple[Floats, Floats, Floats]:
        """(lines, nodes) `forth`, `back` and `l_max` of lines that are up, at (profiles, nodes)."""
        limits, rating = self.limits, self.rating[:, None]
        forth, back = limits.forth @ profiles, limits.back @ profiles
        if self.v_min is None or self.v_max is None:
            rated = np.isfinite(rating)
            return np.where(rated, rating, forth), np.where(rated, rating, back), 0.0 * forth
        v_max = self.v_max[self.from_bus] / self.tap
        rating = rating + (np.abs(self.y_from) * v_max**2)[:, None]  # charging may set flow off
        forth, back = (np.minimum(flow, MARGIN * rating) for flow in (forth, back))
        if limits.current is None:
            return forth, back, 0.0 * forth
        by_rating = MARGIN * rating / (self.v_min[self.from_bus] / self.tap)[:, None]
        return forth, back, np.minimum(limits.current @ profiles, by_rating) ** 2
