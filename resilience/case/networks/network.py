"""The network of a case: buses and branches in per unit on a base of 1 MVA."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.errors import UsageError


def did_you_mean(name: str, known: Iterable[str], *, shown: int = 8) -> str:
    """Return a hint that offers the nearest known names, or else the first few."""
    names = list(known)
    folded = {n.casefold(): n for n in names}
    close = difflib.get_close_matches(name.casefold(), folded, n=3, cutoff=0.6)
    if close:
        return "did you mean " + " or ".join(folded[c] for c in close) + "?"
    if not names:
        return "there are none"
    more = f", ... ({len(names)} in all)" if len(names) > shown else ""
    return "known are " + ", ".join(names[:shown]) + more


@dataclass(frozen=True, eq=False)
class Network:
    """Buses and branches (lines and two-winding transformers) of one feeder.

    Arrays have shape `(nb,)` for buses and `(nl,)` for branches. `vn_kv` is in kV, voltage limits
    in per unit of it, `r_pu` and `x_pu` in per unit on 1 MVA (the impedance scale of the case is
    already in them), `rating_mva` in MVA with `inf` for none, `switching_cost` in $ per action.
    `aliases` maps the names of buses that a closed switch fuses to the one that stands for them.
    """

    bus_names: tuple[str, ...]
    vn_kv: Floats
    v_min_pu: Floats
    v_max_pu: Floats
    line_names: tuple[str, ...]
    from_bus: Ints
    to_bus: Ints
    r_pu: Floats
    x_pu: Floats
    rating_mva: Floats
    in_service: Bools
    switchable: Bools
    switching_cost: Floats
    breakpoint: Bools
    aliases: Mapping[str, str] = field(default_factory=dict)
    _bus_index: dict[str, int] = field(init=False, repr=False)
    _line_index: dict[str, int] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        buses = {name: i for i, name in enumerate(self.bus_names)}
        buses |= {alias: buses[name] for alias, name in self.aliases.items()}
        object.__setattr__(self, "_bus_index", buses)
        lines = {name: i for i, name in enumerate(self.line_names)}
        object.__setattr__(self, "_line_index", lines)
        for f in fields(self):
            value = getattr(self, f.name)
            if isinstance(value, np.ndarray):
                value.setflags(write=False)

    def bus(self, name: str) -> int:
        """Return the position of a bus. Raises `UsageError` for a name the network lacks."""
        if name not in self._bus_index:
            raise UsageError(f"bus {name!r} is not in the network", self.bus_hint(name))
        return self._bus_index[name]

    def line(self, name: str) -> int:
        """Return the position of a line. Raises `UsageError` for a name the network lacks."""
        if name not in self._line_index:
            raise UsageError(f"line {name!r} is not in the network", self.line_hint(name))
        return self._line_index[name]

    def has_bus(self, name: str) -> bool:
        """Say whether a bus, or a bus fused into another, has this name."""
        return name in self._bus_index

    def has_line(self, name: str) -> bool:
        """Say whether a line has this name."""
        return name in self._line_index

    def bus_hint(self, name: str) -> str:
        """Return what to write instead of an unknown bus name."""
        return did_you_mean(name, self._bus_index)

    def line_hint(self, name: str) -> str:
        """Return what to write instead of an unknown line name; ends may be swapped."""
        swapped = "-".join(reversed(name.split("-")))
        if swapped in self._line_index:
            return f"did you mean {swapped}?"
        return did_you_mean(name, self._line_index)

    def equals(self, other: Network) -> bool:
        """Say whether both networks are the same, number for number."""
        return all(
            np.array_equal(getattr(self, f.name), getattr(other, f.name))
            if isinstance(getattr(self, f.name), np.ndarray)
            else getattr(self, f.name) == getattr(other, f.name)
            for f in fields(self)
        )
