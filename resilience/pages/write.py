"""`write_page`: whatever was computed, as the page that belongs to its kind."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from resilience.pages.document import check_page, write
from resilience.planning.plan import Plan
from resilience.planning.scenarios.plan import ScenarioPlan

if TYPE_CHECKING:
    from resilience.evaluation.report import Report
    from resilience.evaluation.survival import Survival
    from resilience.fragility.feeder_hazard import Hazard
    from resilience.revisions.runs import RunDiff

    Pageable = Plan | ScenarioPlan | Report | Hazard | Survival | RunDiff


def write_page(result: Pageable, path: str | Path) -> Path:
    """Writes a result as one self-contained HTML file, to be opened anywhere.

    Args:
        result: a plan of either kind, a report of `compare`, a hazard, a survival, or a difference.
        path: a .html file.

    Raises:
        UsageError: a suffix that is not that of a page, or a plan that was kept without its case.
        FileError: the system refuses.
    """
    target = Path(path)
    check_page(target)
    return write(_page(result), target)


def _page(result: Pageable) -> str:
    if isinstance(result, Plan):
        from resilience.pages.plan_page import plan_page

        return plan_page(result)
    if isinstance(result, ScenarioPlan):
        from resilience.pages.scenario_page import scenario_page

        return scenario_page(result)
    from resilience.fragility.feeder_hazard import Hazard

    if isinstance(result, Hazard):
        from resilience.pages.hazard_page import hazard_page

        return hazard_page(result.summary())
    from resilience.evaluation.survival import Survival

    if isinstance(result, Survival):
        from resilience.pages.survival_page import survival_page

        return survival_page(result)
    from resilience.revisions.runs import RunDiff

    if isinstance(result, RunDiff):
        from resilience.pages.diff_page import diff_page

        return diff_page(result)
    from resilience.pages.comparison_page import comparison_page

    return comparison_page(result, result.summary())
