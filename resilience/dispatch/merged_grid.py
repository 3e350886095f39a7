"""A smaller microgrid that dispatches alike: devices that no program can tell apart become one.

At copperplate, loads at one bus of the merged graph with one shed price are one load, and so are
plants and generators of one cost; their profiles add up. Storage stays as it is, because its units
have states. The optimum of the smaller problem is that of the larger one, and so are the storage
decisions.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property
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
        case: what it was made from.
        members: names of its devices to the names of those that they are made from.
    """

    microgrid: Microgrid
    mixed: dict[str, tuple[tuple[str | None, ...], Floats]]
    case: Case
    members: dict[str, tuple[str, ...]]

    @classmethod
    def as_it_is(cls, microgrid: Microgrid) -> MergedGrid:
        """A microgrid of any physics, of which nothing is joined."""
        return cls(microgrid, {}, microgrid.case, {})

    @cached_property
    def burner_shares(self) -> Floats:
        """(burners, generators of the smaller case) of what each of these gives, the share of each
        generator of the case that burns from a tank.
        """
        burners = [unit for unit in self.case.generator if unit.tank is not None]
        joined = self.microgrid.case.generator
        shares = np.zeros((len(burners), len(joined)))
        for k, unit in enumerate(joined):
            names = self.members.get(unit.name, (unit.name,))
            for i, burner in enumerate(burners):
                if burner.name in names:
                    shares[i, k] = burner.p_max_mw / (unit.p_max_mw or 1.0)
        return shares

    def profile(self, unmerged: Profile) -> Profile:
        """Profiles of the smaller case from those of the case, (nodes,) each."""

        def mixture(name: str | None) -> Floats:
            if name not in self.mixed:
                return unmerged(name)
            members, share = self.mixed[name]
            return share @ np.array([unmerged(member) for member in members])

        return mixture


def merged_grid(case: Case) -> MergedGrid:
    """Joins devices of a case that no program can tell apart."""
    microgrid = Microgrid.build(case, "copperplate")
    mixed: dict[str, tuple[tuple[str | None, ...], Floats]] = {}
    members: dict[str, tuple[str, ...]] = {}
    devices = dict(case.devices)
    for kind, fleet in microgrid.fleets.items():
        groups: dict[Hashable, list[Any]] = {}
        for bus, table in zip(fleet.bus, fleet.tables, strict=True):
            key = None if table.name in fleet.fallible else fleet.merge_key(table)
            groups.setdefault((bus, table.name if key is None else key), []).append(table)
        devices[kind] = tuple(_merged(tables, mixed) for tables in groups.values())
        for joined, tables in zip(devices[kind], groups.values(), strict=True):
            members[joined.name] = tuple(table.name for table in tables)
    return MergedGrid(replace(microgrid, case=replace(case, devices=devices)), mixed, case, members)


def _merged(members: list[Any], mixed: dict[str, tuple[tuple[str | None, ...], Floats]]) -> Any:
    """One table for several; where they follow profiles, it follows their mean by power."""
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


def profiles_of(microgrid: Microgrid) -> Iterable[str | None]:
    """Every profile that a device or a tank of the microgrid follows."""
    tanks = () if microgrid.tanks is None else microgrid.tanks.profiles()
    followed = [name for fleet in microgrid.fleets.values() for name in fleet.profiles()]
    return dict.fromkeys([*followed, *tanks, None])
