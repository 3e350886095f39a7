"""Where a program of a merged grid holds what is decided, and the decision of a point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.dispatch.merged_grid import MergedGrid
from resilience.models.program.standard import Standard
from resilience.models.simulator import Decision


@dataclass(frozen=True)
class DecisionColumns:
    """Columns of a program, (rows, nodes) each; None where a case decides nothing of the kind.

    Attributes:
        charge, discharge: of storage.
        generators: of the power of all generators, where some burn from a tank.
        shares: (burners, generators) see `MergedGrid.burner_shares`.
        on: of units with commitment.
        closed: of lines that can be switched.
        ramped: of the power of units with a ramp.
    """

    charge: Ints
    discharge: Ints
    generators: Ints | None
    shares: Floats
    on: Ints | None
    closed: Ints | None
    ramped: Ints | None

    @classmethod
    def of_program(cls, standard: Standard, merged: MergedGrid) -> DecisionColumns:
        """Those of a program of a merged grid."""

        def columns(name: str, state: str | None = None) -> Ints | None:
            """Of a variable, of those labels that a state has."""
            if not standard.has(state or name):
                return None
            labels = standard.labels(name)
            rows = [labels.index(label) for label in standard.labels(state or name)]
            return standard.columns(name)[rows]

        shares, none = merged.burner_shares, np.empty((0, standard.tree.n), np.intp)
        charge, discharge = (columns(f"ess.{way}") for way in ("charge", "discharge"))
        return cls(
            charge=none if charge is None else charge,
            discharge=none if discharge is None else discharge,
            generators=columns("generator.p") if len(shares) else None,
            shares=shares,
            on=columns("generator.on"),
            closed=columns("line.closed"),
            ramped=columns("generator.p", "generator.p_before"),
        )

    def decision(self, z: Floats, nodes: int | slice) -> Decision:
        """What a point (columns,) decides at one node, (rows,) each, or at some, (rows, nodes)."""

        def values(columns: Ints | None) -> Floats | None:
            return None if columns is None else z[columns[:, nodes]]

        power = values(self.generators)
        return Decision(
            power=z[self.charge[:, nodes]] - z[self.discharge[:, nodes]],
            burner_mw=None if power is None else self.shares @ power,
            on=values(self.on),
            closed=values(self.closed),
            ramped_mw=values(self.ramped),
        )
