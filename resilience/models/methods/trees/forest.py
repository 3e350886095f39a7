r"""A forest of closed lines, and its power flow: a sweep along the paths from the roots.

With $A$ the paths (1 where a line leads from the root to a bus, -1 where it points back), currents
$I = \overline{s / U}$ drawn at the buses and impedances $z$, line currents and voltages are

$$ J = A^\top I, \qquad U = U_\text{root} - A \, (z J) $$

iterated until they agree (Shirmohammadi et al. 1988). Ratios of transformers are taken out: in
the frame of its root, in which $V_b = g_b U_b$, every impedance is $z / |g|^2$ and every power as
it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from resilience.arrays import Bools, Complexes, Floats, Ints

MAX_SWEEPS = 60
AGREED = 1e-10  # pu between two sweeps
COLLAPSED = 0.3  # pu: below, there is no operating point


@dataclass(frozen=True)
class TreeLines:
    """The lines that trees are made of, impedances in pu on 1 MVA.

    Attributes:
        ends: (lines, 2) buses.
        z: (lines,) impedance, pu.
        tap: (lines,) magnitude of the ratio at the first end.
        rating: (lines,) MVA, inf without one.
        switchable: (lines,) what may be exchanged.
        v_min, v_max: (buses,) pu.
    """

    ends: Ints
    z: Complexes
    tap: Floats
    rating: Floats
    switchable: Bools
    v_min: Floats
    v_max: Floats


@dataclass(frozen=True)
class Forest:
    """A forest that hangs on its roots.

    Attributes:
        closed: (lines,) lines of the forest.
        paths: (buses, lines) 1 or -1 where a line is on the way from the root to the bus.
        z: (lines,) impedance in the frame of the root, pu.
        gain: (buses,) magnitude of the ratios on the way.
        root: (buses,) root of every bus, -1 of those that hang on none.
    """

    closed: Bools
    paths: Floats
    z: Complexes
    gain: Floats
    root: Ints

    @classmethod
    def from_closed(cls, wires: TreeLines, closed: Bools, roots: Ints) -> Forest:
        """Follows closed lines from the roots; a line that closes a cycle is no part of it."""
        n, lines = len(wires.v_min), np.flatnonzero(closed).tolist()
        beside: list[list[tuple[int, int, float]]] = [[] for _ in range(n)]
        for line, (i, j) in zip(lines, wires.ends[lines].tolist(), strict=True):
            beside[i].append((line, j, 1.0))
            beside[j].append((line, i, -1.0))
        paths, gain = np.zeros((n, len(closed))), np.ones(n)
        root, hanging = np.full(n, -1), np.zeros(len(closed), bool)
        root[roots] = roots
        queue = [int(bus) for bus in roots]
        for bus in queue:  # it grows on the way
            for line, far, sign in beside[bus]:
                if root[far] >= 0:
                    continue
                root[far], hanging[line] = root[bus], True
                paths[far] = paths[bus]
                paths[far, line] = sign
                gain[far] = gain[bus] / wires.tap[line] ** sign
                queue.append(far)
        z = wires.z / gain[wires.ends[:, 1]] ** 2
        return cls(hanging, paths, z, gain, root)

    def swept(self, drawn: Complexes, v_root: Floats) -> tuple[Complexes, Complexes] | None:
        """Voltages and line currents in the frame of the roots, (buses, slots), (lines, slots).

        Args:
            drawn: (buses, slots) what is taken at the buses, MVA.
            v_root: (buses, slots) voltage of roots, pu.

        Returns:
            Nothing where the sweep finds no operating point.
        """
        branches = np.flatnonzero(self.closed)
        paths, z = np.ascontiguousarray(self.paths[:, branches]), self.z[branches, None]
        hanging = (self.root >= 0)[:, None]
        top = np.where(hanging, v_root[np.maximum(self.root, 0)], 1.0).astype(complex)
        drawn = np.where(hanging, drawn, 0.0)
        voltage = top
        for _ in range(MAX_SWEEPS):
            current = _real_times(paths.T, np.conj(drawn / voltage))
            after = top - _real_times(paths, z * current)
            moved = float(np.abs(after - voltage).max(initial=0.0))
            voltage = after
            if not np.isfinite(moved) or (np.abs(voltage) < COLLAPSED).any():
                return None
            if moved < AGREED:
                break
        else:
            return None
        every = np.zeros((len(self.closed), drawn.shape[1]), complex)
        every[branches] = current
        return voltage, every


def _real_times(a: Floats, x: Complexes) -> Complexes:
    """Real times complex, without making the first complex."""
    x = np.ascontiguousarray(x)
    return np.asarray(a @ x.view(float)).view(np.complex128)
