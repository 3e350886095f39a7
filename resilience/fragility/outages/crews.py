"""How the lines of a case are mended: the crews of its `[storm.repair]`."""

from __future__ import annotations

from resilience.case import Case
from resilience.case.schema import StormTable
from resilience.errors import CaseError, Mistake, UsageError
from resilience.fragility.outages.repair import Repair


def case_repair(case: Case) -> Repair:
    """How the lines of a case are mended.

    Raises:
        CaseError: hours that its law cannot have.
    """
    table = (case.storm or StormTable()).repair
    try:
        return Repair(
            law=table.law, hours=table.hours, crews=table.crews,
            wind_limit_mps=table.wind_limit_mps, priority=table.priority,
        )  # fmt: skip
    except UsageError as error:
        file, message = case.file_name, error.message
        allowed = "hours of work that the law can have"
        mistake = Mistake(file, "[storm.repair]", "hours", message, allowed, error.hint)
        raise CaseError([mistake]) from error
