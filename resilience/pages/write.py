"""`write_page`: whatever was computed, as the page that belongs to its kind."""

from __future__ import annotations

from pathlib import Path

from resilience.pages.document import check_page, write
from resilience.planning.plan import Plan
from resilience.planning.scenario_plan import ScenarioPlan

Pageable = Plan | ScenarioPlan
"""What has a page."""


def write_page(result: Pageable, path: str | Path) -> Path:
    """Writes a result as one self-contained HTML file, to be opened anywhere.

    Args:
        result: a plan, or a plan over scenarios.
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
    from resilience.pages.scenario_page import scenario_page

    return scenario_page(result)
