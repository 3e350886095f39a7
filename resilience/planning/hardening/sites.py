"""Units and ties that may be built before the storm, and the case with some of them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from resilience.arrays import Floats
from resilience.case import Case
from resilience.case.schema import DEVICES, DeviceTable, ESSTable, PlanTable, PVTable
from resilience.models.components import Sited


@dataclass(frozen=True)
class UnitOption:
    """One unit that may be built at a site.

    Attributes:
        site: its name.
        kind: of the unit, a key of case files.
        number: 1 for the first unit of the site, and so on.
        units: how many the site has room for.
        unit: its table, under its own name.
        cost: $ to build it.
        life_years: how long it lasts.
    """

    site: str
    kind: str
    number: int
    units: int
    unit: DeviceTable
    cost: float
    life_years: float = 40.0

    @property
    def label(self) -> str:
        """`depot`, or `depot 2` where there may be several."""
        return self.unit.name

    @property
    def place(self) -> str:
        """What it is and where: `ess at 18`."""
        return f"{self.kind} at {self.unit.bus}"


@dataclass(frozen=True)
class TieOption:
    """A switch for an open line, so that it may be closed.

    Attributes:
        line: its name.
        cost: $ to build it.
        life_years: how long it lasts.
    """

    line: str
    cost: float
    life_years: float = 40.0

    @property
    def label(self) -> str:
        """`tie 8-21`."""
        return f"tie {self.line}"


Built = UnitOption | TieOption


def ties_of(case: Case) -> tuple[TieOption, ...]:
    """All ties that `tie_cost` of `[[line]]` offers."""
    plan = case.plan or PlanTable()
    lines = {line.name: line.tie_cost for line in case.line}
    priced = ((name, lines.get(name)) for name in case.network.line_names)
    return tuple(
        TieOption(name, cost, plan.life_years) for name, cost in priced if cost is not None
    )


def units_of(case: Case) -> tuple[UnitOption, ...]:
    """All units that `[[plan.site]]` of a case offers, site by site."""
    plan, options = case.plan or PlanTable(), []
    for site in plan.site:
        for number in range(1, site.units + 1):
            name = site.name if site.units == 1 else f"{site.name} {number}"
            unit = DEVICES[site.kind].table.model_validate({"name": name, **site.unit})
            numbers = number, site.units
            life_years = site.life_years or plan.life_years
            options.append(UnitOption(site.name, site.kind, *numbers, unit, site.cost, life_years))
    return tuple(options)


def with_built(case: Case, built: Sequence[Built], *, undecided: bool = False) -> Case:
    """The case with units and ties built, and no sites any more.

    Args:
        case: without them.
        built: what is built.
        undecided: storage is empty, and may be, until it is built; see `Sited`.

    Raises:
        CaseError: they do not fit into the case: a name that is taken, say.
    """
    if not built:
        return case
    by_kind: dict[str, list[DeviceTable]] = defaultdict(list)
    for option in built:
        if isinstance(option, UnitOption):
            unit = option.unit
            if undecided and isinstance(unit, ESSTable):
                unit = unit.model_copy(update={"soc_min": 0.0, "soc_initial": 0.0})
            by_kind[option.kind].append(unit)
    tables: dict[str, Any] = {kind: (*case.devices[kind], *more) for kind, more in by_kind.items()}
    ties = {option.line for option in built if isinstance(option, TieOption)}
    if ties:
        switch = {"switchable": True, "tie_cost": None}
        tables["line"] = [
            line.model_copy(update=switch) if line.name in ties else line for line in case.line
        ]
    if case.plan is not None:
        tables["plan"] = case.plan.model_copy(update={"site": ()})
    return case.replace(**tables)


def sited_of(built: Sequence[Built], price: Floats) -> Sited | None:
    """Units, then ties, as what they are in a program of a case in which all of them stand.

    Args:
        built: in the order of the program.
        price: (units and ties,) $ in the objective.
    """
    if not built:
        return None
    units = [option for option in built if isinstance(option, UnitOption)]
    ties = tuple(option.line for option in built if isinstance(option, TieOption))
    follows = np.array([option.number > 1 for option in units], bool)
    return Sited(tuple(o.unit for o in units), follows, price, np.ones(len(units)), ties)


def outputs(case: Case, units: Sequence[UnitOption]) -> Floats:
    """(units, slots) per unit of its greatest output, what each can feed in at most."""
    standing = {plant.name: plant for plant in case.pv}
    output = np.ones((len(units), case.slots))
    for k, option in enumerate(units):
        if isinstance(option.unit, PVTable):
            output[k] = case.profile(standing[option.unit.name].profile)
    return output
