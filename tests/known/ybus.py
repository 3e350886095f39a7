"""AC power flow from admittances and nothing else, for networks of a few buses, meshed or not.

Branches are those of MATPOWER's manual, equations 3.2 to 3.5. They are solved by repeated
substitution, which converges where loads are small beside what the network could carry.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from resilience.arrays import Complexes


@dataclass(frozen=True)
class Pi:
    """A branch, impedances in pu on 1 MVA; `b` and `g` in all, half of them at either end."""

    i: int
    j: int
    r: float
    x: float
    b: float = 0.0
    g: float = 0.0
    tap: float = 1.0
    shift_deg: float = 0.0

    @property
    def matrix(self) -> Complexes:
        """(2, 2) currents into its ends by the voltages there."""
        y, half = 1.0 / complex(self.r, self.x), 0.5 * complex(self.g, self.b)
        a = cmath.rect(self.tap, math.radians(self.shift_deg))
        return np.array(
            [[(y + half) / abs(a) ** 2, -y / a.conjugate()], [-y / a, y + half]], complex
        )


@dataclass(frozen=True)
class Flows:
    """A solution: voltages (buses,), power into both ends of every branch (branches, 2), losses."""

    volts: Complexes
    ends: Complexes
    loss_mw: float


def power_flow(
    branches: Sequence[Pi],
    fed: Sequence[complex],
    shunts: Mapping[int, complex] | None = None,
    v_slack: float = 1.0,
) -> Flows:
    """Buses 1, 2, ...; the first holds its voltage, whatever is fed in there.

    Args:
        branches: between them.
        fed: MW + j Mvar at every bus.
        shunts: admittances by bus, pu.
        v_slack: of bus 1, pu.
    """
    n, y = len(fed), np.zeros((len(fed), len(fed)), complex)
    for branch in branches:
        at = [branch.i - 1, branch.j - 1]
        y[np.ix_(at, at)] += branch.matrix
    for bus, shunt in (shunts or {}).items():
        y[bus - 1, bus - 1] += shunt

    inner = y[1:, 1:]
    v: Complexes = np.full(n, v_slack, complex)
    for _ in range(500):  # Gauss with the impedance matrix
        v[1:] = np.linalg.solve(inner, (np.asarray(fed)[1:] / v[1:]).conj() - y[1:, 0] * v_slack)
    lacks = (v * (y @ v).conj() - np.asarray(fed))[1:]
    assert np.abs(lacks).max() < 1e-10
    ends = np.array(
        [v[[b.i - 1, b.j - 1]] * (b.matrix @ v[[b.i - 1, b.j - 1]]).conj() for b in branches]
    )
    lost = (v * (y @ v).conj()).sum().real
    return Flows(v, ends, float(lost))
