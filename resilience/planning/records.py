"""What plans of every kind share: certificate, costs and horizon."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from typing import TYPE_CHECKING, Any, ClassVar

from resilience.errors import CertificateError, UsageError
from resilience.models.case_program import case_cost_scale
from resilience.models.program import gate
from resilience.models.program.referee import Audit
from resilience.planning.reading.instructions import Instruction, instructions
from resilience.planning.tables import SlotTable
from resilience.shown import Shown

if TYPE_CHECKING:
    import pandas as pd

    from resilience.case import Case
    from resilience.models.backends.base import Status


@dataclass(frozen=True)
class Certificate:
    """How far a plan is from the best possible, and what of the model it satisfies.

    Attributes:
        status: optimal (within the gap asked for) or feasible (the best found in time).
        bound: proven lower bound on the objective, $; None where there is none.
        gap: (objective - bound) / |objective|; None without a bound.
        bound_of: the model that the bound is valid for, in words.
        relaxed: facts of the model that the plan need not satisfy, in words.
        audit: worst scaled violation per row, bound and structure.
        audit_worst: where the worst of these is, empty where nothing was audited.
        cost_scale: the most that one column of the program can cost, $, see `gate.cost_scale`; it
            is not saved, and None where a plan was read from files.
    """

    status: Status
    bound: float | None
    gap: float | None
    bound_of: str
    relaxed: list[str]
    audit: dict[str, float]
    audit_worst: str
    cost_scale: float | None = field(default=None, repr=False, compare=False)

    def check(self, objective: float, scale: float) -> None:
        """Refuses what contradicts itself.

        Args:
            objective: of the plan, $.
            scale: what rounding is relative to, $.

        Raises:
            CertificateError: gap and status do not follow from objective and bound, or the referee
                found more than is said to be relaxed.
        """
        where = {name: name for name in self.audit}
        where |= {name: self.audit_worst for name in self.audit if self._is_worst(name)}
        gate.check_audit(Audit(self.audit, where), gate.names_of(self.relaxed))
        bound = -math.inf if self.bound is None else self.bound
        gap = gate.gap(objective, bound, scale)
        stated = math.inf if self.gap is None else self.gap
        if not (math.isclose(gap, stated, rel_tol=1e-6, abs_tol=1e-12)):
            raise CertificateError(
                f"a gap of {stated:.9g} is stated, but {objective:.9g} $ and the bound of "
                f"{bound:.9g} $ are {gap:.9g} apart: {gate.FAULT}",
                hint=gate.HINT,
            )
        if self.status not in ("optimal", "feasible") or (
            self.status == "optimal" and not math.isfinite(gap)
        ):
            raise CertificateError(
                f"the status is {self.status!r} at a gap of {gap:.9g}; allowed: 'optimal' within a "
                "gap to a proven bound, or 'feasible'",
                hint=gate.HINT,
            )

    def _is_worst(self, name: str) -> bool:
        return self.audit[name] == max(self.audit.values())


@dataclass(frozen=True)
class Costs:
    """What a plan costs.

    Attributes:
        objective: what is minimised, $: operating cost less terminal credit; of a plan over
            scenarios its risk.
        operating_cost: $; of a plan over scenarios the expected one.
        terminal_credit: worth of the energy left at the end, $; the expected one likewise.
        terms: $ per term of the operating cost; empty where the terms are not told apart.
    """

    objective: float
    operating_cost: float
    terminal_credit: float
    terms: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Horizon:
    """When the slots of a plan are.

    Attributes:
        start: start of the first slot, ISO 8601, local time.
        step_min: length of a slot, min.
    """

    start: str
    step_min: float

    @classmethod
    def of_case(cls, case: Case) -> Horizon:
        """The horizon that a case is planned for."""
        return cls(case.start.isoformat(), case.step_min)

    def times(self, slots: int) -> list[datetime]:
        """Start of each of the first slots."""
        first = datetime.fromisoformat(self.start)
        return [first + timedelta(minutes=self.step_min * t) for t in range(slots)]

    def frame(self, table: SlotTable) -> pd.DataFrame:
        """A table as a DataFrame: a row per slot by its time, a column per label."""
        import pandas as pd

        index = pd.DatetimeIndex(self.times(table.values.shape[1]), name="time")
        return pd.DataFrame(table.values.T, index=index, columns=list(table.labels))


@dataclass(frozen=True, kw_only=True, repr=False)
class CertifiedPlan(Shown):
    """What every plan has; its parts can be read from the plan itself, as `plan.objective`.

    Attributes:
        name: the case's.
        method: how it was asked for, as `--method`.
        physics: copperplate, lindistflow or distflow.
        certificate: bound, gap, and what the referee says.
        totals: what the plan costs.
        horizon: when its slots are.
        notes: what else a reader should know, in words.
        not_modelled: what of the network's source is in no number of the plan, in words.
        seconds_by_phase: how long each phase took.
        tables: every quantity by slot; see `tables.table_units`.
        case: the case as solved; None where it was not kept.
    """

    summary_keys: ClassVar[tuple[str, ...]] = ()

    name: str
    method: str
    physics: str
    certificate: Certificate
    totals: Costs
    horizon: Horizon
    notes: list[str]
    not_modelled: list[str]
    seconds_by_phase: dict[str, float]
    tables: Mapping[str, SlotTable] = field(repr=False)
    case: Case | None = field(repr=False, compare=False)

    def __post_init__(self) -> None:
        self.check()

    def check(self) -> None:
        """Refuses a plan whose numbers contradict each other.

        Raises:
            CertificateError: costs that are no numbers or do not add up, a bound above them, a gap
                or a status that is another, or a row that does not hold and is not said to.
        """
        scale = self._scale()
        if self.totals.terms:
            gate.check_costs(self.totals.operating_cost, self.totals.terms, scale)
        self.check_objective(scale)
        self.certificate.check(self.objective, scale)

    def check_objective(self, scale: float) -> None:
        """Refuses an objective that the rest of the plan does not add up to.

        Args:
            scale: what rounding is relative to, $.

        Raises:
            CertificateError: likewise.
        """
        raise NotImplementedError

    def _scale(self) -> float:
        """What rounding is relative to, $: known where the plan was made, else from its case."""
        if self.certificate.cost_scale is not None:
            return self.certificate.cost_scale
        if self.case is None:
            return max((abs(cost) for cost in self.totals.terms.values()), default=0.0)
        return case_cost_scale(self.case)

    def instructions(self) -> list[Instruction]:
        """What operators are asked to do, in time.

        Raises:
            UsageError: the plan was kept without its case.
        """
        if self.case is None:
            raise UsageError(
                "the plan was kept without its case, which says what is asked of whom",
                hint="load a folder that holds case.toml",
            )
        return instructions(self.case, self.tables)

    def actions(self) -> pd.DataFrame:
        """What operators are asked to do: a row per instruction, in time.

        Columns are start and stop (times), do, unit, low_mw and high_mw (mean powers of its slots)
        and stored_mwh (at the end, of storage).

        Raises:
            UsageError: the plan was kept without its case.
        """
        import pandas as pd

        first = datetime.fromisoformat(self.horizon.start)
        step = timedelta(minutes=self.horizon.step_min)
        rows = [
            (
                first + item.first * step,
                first + item.stop * step,
                item.verb,
                item.unit,
                item.low_mw,
                item.high_mw,
                item.stored_mwh,
            )
            for item in self.instructions()
        ]
        columns = ["start", "stop", "do", "unit", "low_mw", "high_mw", "stored_mwh"]
        return pd.DataFrame(rows, columns=columns)

    @property
    def status(self) -> Status:
        """Optimal (within the gap asked for) or feasible."""
        return self.certificate.status

    @property
    def bound_of(self) -> str:
        """The model that the bound is valid for, in words."""
        return self.certificate.bound_of

    @property
    def relaxed(self) -> list[str]:
        """Facts of the model that the plan need not satisfy, in words."""
        return self.certificate.relaxed

    @property
    def audit(self) -> dict[str, float]:
        """Worst scaled violation per row, bound and structure."""
        return self.certificate.audit

    @property
    def audit_worst(self) -> str:
        """Where the worst violation is."""
        return self.certificate.audit_worst

    @property
    def objective(self) -> float:
        """What was minimised, $."""
        return self.totals.objective

    @property
    def start(self) -> str:
        """Start of the first slot, ISO 8601."""
        return self.horizon.start

    @property
    def step_min(self) -> float:
        """Length of a slot, min."""
        return self.horizon.step_min

    @property
    def seconds(self) -> float:
        """How long all phases took together."""
        return sum(self.seconds_by_phase.values())

    def summary(self) -> dict[str, Any]:
        """Everything but the tables, as plain data."""
        return {key: getattr(self, key) for key in self.summary_keys}
