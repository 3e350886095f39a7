"""What a solve returns: a plan with its certificate, tables to compute with, and files.

A saved plan is a folder that appears whole or not at all:

    summary.json   status, costs, bound, audit, ...: what `--json` prints, and `kind`
    case.toml      the case as solved; loads back
    NAME.parquet, NAME.csv   one table per quantity, a row per slot, a column per device or bus
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, cast

from resilience.errors import UsageError
from resilience.files import reading
from resilience.models.program.gate import check_costs, check_energy, of_file
from resilience.planning.files import Number, check_kinds, common_fields, read_tables, write_plan
from resilience.planning.records import (
    CertifiedPlan,
    Costs,
)
from resilience.planning.tables import PRICE_UNITS, SlotTable, balance, table_units
from resilience.results import PLAN, SUMMARY_FILE, replacing, steady

if TYPE_CHECKING:
    import pandas as pd

    from resilience.case import Case
    from resilience.models.microgrid import Physics
    from resilience.planning.reading.prices import PriceRow


@dataclass(frozen=True, kw_only=True, repr=False)
class Plan(CertifiedPlan):
    """A dispatch plan, its certificate, and where its costs and its shedding come from.

    What every plan has is documented in `records.CertifiedPlan`.

    Attributes:
        energy_mwh: the energy balance, MWh.
        shed_mwh: energy not served, MWh.
        shed_by_load: MWh per load, and why it could not be served: {load: {reason: MWh}}.
        shed_causes: the same reasons by name and number: {load: {reason: sentence}}.
        outages: the outages assumed, which the plan knows in advance.
    """

    summary_keys: ClassVar[tuple[str, ...]] = (
        "name",
        "method",
        "physics",
        "status",
        "objective",
        "operating_cost",
        "terminal_credit",
        "bound",
        "gap",
        "bound_of",
        "relaxed",
        "notes",
        "not_modelled",
        "audit",
        "audit_worst",
        "costs",
        "energy_mwh",
        "shed_mwh",
        "shed_by_load",
        "shed_causes",
        "outages",
        "start",
        "step_min",
        "seconds",
        "seconds_by_phase",
    )

    energy_mwh: dict[str, float]
    shed_mwh: float
    shed_by_load: dict[str, dict[str, float]]
    shed_causes: dict[str, dict[str, str]]
    outages: list[str]

    def check_objective(self, scale: float) -> None:
        """See `CertifiedPlan.check_objective`: operating cost less credit, energy as tabulated."""
        parts = {"operating cost": self.operating_cost, "terminal credit": -self.terminal_credit}
        check_costs(self.objective, parts, scale)
        if self.case is not None and "power" in self.tables:
            check_energy(self.energy_mwh, balance(self.case, self.tables))

    @property
    def bound(self) -> float | None:
        """Proven lower bound on the objective, $; None where there is none."""
        return self.certificate.bound

    @property
    def gap(self) -> float | None:
        """(objective - bound) / |objective|; None without a bound."""
        return self.certificate.gap

    @property
    def operating_cost(self) -> float:
        """Sum of `costs`, $."""
        return self.totals.operating_cost

    @property
    def terminal_credit(self) -> float:
        """Worth of the energy left at the end, $."""
        return self.totals.terminal_credit

    @property
    def costs(self) -> dict[str, float]:
        """Operating cost by term, $."""
        return self.totals.terms

    @property
    def times(self) -> list[datetime]:
        """Start of every slot."""
        slots = next(iter(self.tables.values())).values.shape[1]
        return self.horizon.times(slots)

    def frame(self, name: str) -> pd.DataFrame:
        """One table as a DataFrame indexed by time; see `table_units` for names and units.

        `bus_price`, `storage_value` and `fuel_value` are made when they are first asked for, see
        `with_prices`.

        Raises:
            UsageError: the plan has no such table.
            SolverError: there are no prices, as no optimum was found in time.
        """
        if name in PRICE_UNITS and name not in self.tables:
            prices = self._prices
            if name in prices:
                return self.horizon.frame(prices[name])
        if name not in self.tables:
            raise UsageError(
                f"the plan has no table {name!r}; it has {', '.join(self.tables)}",
                hint="voltages and reactive power need lindistflow or distflow",
            )
        return self.horizon.frame(self.tables[name])

    def with_prices(self) -> Plan:
        """The plan with tables of prices, which are marginal costs with its integers held.

        `bus_price` is what a little more demand at a bus costs, $/MWh, where it cannot be shed;
        NaN in dead islands. `storage_value` is what a MWh more saves that a storage holds at the
        end of a slot, and `fuel_value` the same of a m³ in a tank. In distflow they are of the AC
        equations. Where a plan stands at a corner of its program, cost is less for a little less
        than it is for a little more; a price is then any number between the two.

        Raises:
            UsageError: the plan was kept without its case.
            SolverError: no optimum was found in time.
        """
        return replace(self, tables={**self.tables, **self._prices})

    def price_rows(self) -> list[PriceRow]:
        """The prices in short, a row per hour: the lowest, mean and highest over the buses.

        Raises:
            UsageError: the plan was kept without its case.
            SolverError: no optimum was found in time.
        """
        from resilience.planning.reading.prices import HOUR_MIN, price_rows

        tables = self.tables if "bus_price" in self.tables else self._prices
        return price_rows(tables, max(round(HOUR_MIN / self.step_min), 1))

    @cached_property
    def _prices(self) -> dict[str, SlotTable]:
        from resilience.planning.reading.prices import price_tables

        if self.case is None:
            raise UsageError(
                "the plan was kept without its case, so there are no prices",
                hint="load a folder that holds case.toml",
            )
        return price_tables(self.case, cast("Physics", self.physics), self.tables["variables"])

    def to_excel(self, path: str | Path) -> Path:
        """Writes a workbook: summary, actions, and a sheet per table but that of all variables.

        Raises:
            UsageError: openpyxl is missing (`pip install 'resilience[excel]'`), or a name that does
                not end in .xlsx.
            FileError: the system refuses.
        """
        from resilience.planning.reading.workbook import check_workbook, write_workbook

        check_workbook(Path(path))
        write_workbook(Path(path), self._sheets())
        return Path(path)

    def _sheets(self) -> dict[str, pd.DataFrame]:
        import pandas as pd

        from resilience.planning.reading.workbook import LEFT_OUT

        names, units = [name for name in self.tables if name not in LEFT_OUT], table_units()
        summary = self.summary().items()
        rows = [(key, value) for key, value in summary if not isinstance(value, dict | list)]
        rows += [(f"cost of {name}, $", spent) for name, spent in self.costs.items()]
        rows += [(f"{name}, MWh", energy) for name, energy in self.energy_mwh.items()]
        actions = {} if self.case is None else {"actions": self.actions()}
        return {
            "summary": pd.DataFrame(rows, columns=["quantity", "value"]),
            "units": pd.DataFrame([(n, units[n]) for n in names], columns=["sheet", "holds"]),
            **actions,
            **{name: self.frame(name) for name in names},
        }

    def save(self, folder: str | Path) -> Path:
        """Writes the plan; an earlier plan in the folder is replaced, anything else is refused.

        Raises:
            UsageError: the folder holds something that is no earlier plan.
            FileError: the system refuses, as where a disk is full.
        """
        with replacing(Path(folder), PLAN) as target:
            frames = {name: self.frame(name) for name in self.tables}
            write_plan(target, PLAN, self.summary(), self.case, frames, {})
        return Path(folder)


def load_plan(folder: str | Path) -> Plan:
    """Reads a plan that `Plan.save` wrote.

    Raises:
        UsageError: the folder holds no plan, or a damaged one.
        CertificateError: its numbers contradict each other or its tables.
    """
    root = Path(folder)
    with steady(root):
        return _load_plan(root)


def _load_plan(root: Path) -> Plan:
    if not (root / SUMMARY_FILE).is_file():
        raise UsageError(
            f"{root} holds no result: there is no {SUMMARY_FILE} in it",
            hint="name the folder that `solve --out` wrote; a hazard is drawn by `hazard --plot`",
        )
    with reading(root / SUMMARY_FILE, "summary of a plan"):
        summary = dict(json.loads((root / SUMMARY_FILE).read_text(encoding="utf-8")))
    # Earlier versions said none of these.
    stated = summary.pop("kind", PLAN.name)
    summary.setdefault("not_modelled", [])
    summary.setdefault("shed_causes", {})
    if stated != PLAN.name or summary.keys() != set(Plan.summary_keys):
        raise UsageError(
            f"{root} holds another kind of result than a plan",
            hint="load_scenario_plan reads plans over scenarios",
        )
    case = None
    if (root / "case.toml").is_file():
        from resilience.case import load_case

        case = load_case(root / "case.toml")
    with reading(root, "plan"), of_file(root):
        return _read_plan(root, summary, case)


KINDS: dict[str, Any] = {
    "operating_cost": Number,
    "terminal_credit": Number,
    "costs": dict[str, Number],
    "energy_mwh": dict[str, Number],
    "shed_mwh": Number,
    "shed_by_load": dict[str, dict[str, Number]],
    "shed_causes": dict[str, dict[str, str]],
    "outages": list[str],
}
"""What stands in `summary.json` beside what every plan has."""


def _read_plan(root: Path, summary: dict[str, Any], case: Case | None) -> Plan:
    check_kinds(summary, KINDS)
    return Plan(
        **common_fields(summary),
        totals=Costs(
            objective=summary["objective"],
            operating_cost=summary["operating_cost"],
            terminal_credit=summary["terminal_credit"],
            terms=summary["costs"],
        ),
        tables=read_tables(root, {name: name for name in table_units()}),
        case=case,
        energy_mwh=summary["energy_mwh"],
        shed_mwh=summary["shed_mwh"],
        shed_by_load=summary["shed_by_load"],
        shed_causes=summary["shed_causes"],
        outages=summary["outages"],
    )
