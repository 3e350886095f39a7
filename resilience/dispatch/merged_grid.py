"""A smaller microgrid that dispatches alike: devices that no program can tell apart become one.

At copperplate, loads at one bus of the merged graph with one shed price are one load, and so are
plants and generators of one cost; their profiles add up. Storage stays as it is, because its units
have states. The optimum of the smaller problem is that of the larger one, and so are the storage
decisions.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from resilience.arrays import Floats
from resilience.models.microgrid import Microgrid

if TYPE_CHECKING:
    from resilience.case import Case

Profile = Callable[[str | None], Floats]


@dataclass(frozen=True)
class MergedGrid:
    """The smaller microgrid, at copperplate.

    Attributes:
        microgrid: with fewer devices.
        mixed: name of a profile of its case to the profiles that it mixes, and their shares.
    """

    microgrid: Microgrid
    mixed: dict[str, tuple[tuple[str | None, ...], Floats]]

    def profile(self, of: Profile) -> Profile:
        """Profiles of the smaller case from those of the case, (nodes,) each."""

        def found(name: str | None) -> Floats:
            if name not in self.mixed:
                return of(name)
            members, share = self.mixed[name]
            return share @ np.array([of(member) for member in members])

        return found


def merged_grid(case: Case) -> MergedGrid:
    """Joins devices of a case that no program can tell apart."""
    microgrid = Microgrid.of(case, "copperplate")
    mixed: dict[str, tuple[tuple[str | None, ...], Floats]] = {}

    def joined(kind: str, key: Callable[[Any], Hashable]) -> tuple[Any, ...]:
        groups: dict[Hashable, list[Any]] = {}
        tables = getattr(case, kind)
        for bus, table in zip(microgrid.at(tables), tables, strict=True):
            alone = key(table)
            groups.setdefault((bus, table.name if alone is None else alone), []).append(table)
        return tuple(_one(members, mixed) for members in groups.values())

    load = joined("load", lambda t: None if t.block else t.shed_cost_per_mwh * t.priority)
    pv = joined("pv", lambda t: (t.curtailable, t.cost_per_mwh))
    generator = joined("generator", _generator_key)
    smaller = replace(case, load=load, pv=pv, generator=generator)
    return MergedGrid(replace(microgrid, case=smaller), mixed)


def _generator_key(table: Any) -> Hashable:
    """None for a unit with a curve, ramps or commitment."""
    apart = ("cost_curve", "ramp_up_mw_per_h", "ramp_down_mw_per_h")
    whole = ("p_min_mw", "no_load_cost_per_h", "start_cost", "min_up_h", "min_down_h")
    if any(getattr(table, key) is not None for key in apart) or any(
        getattr(table, key) for key in whole
    ):
        return None
    return float(table.cost_per_mwh)


def _one(members: list[Any], mixed: dict[str, tuple[tuple[str | None, ...], Floats]]) -> Any:
    first = members[0]
    if len(members) == 1:
        return first
    total = sum(t.p_max_mw for t in members)
    changes: dict[str, Any] = {"name": "+".join(t.name for t in members), "p_max_mw": total}
    if hasattr(first, "profile"):
        changes["profile"] = changes["name"]
        share = np.array([t.p_max_mw for t in members]) / (total or 1.0)
        mixed[changes["name"]] = tuple(t.profile for t in members), share
    return first.model_copy(update=changes)


def profiles_of(case: Case) -> Iterable[str | None]:
    """Every profile that a device of the case follows."""
    prices = [name for grid in case.grid for _, name in (grid.import_price, grid.export_price)]
    followed = [*(t.profile for t in case.load), *(t.profile for t in case.pv), *prices, None]
    return dict.fromkeys(followed)
