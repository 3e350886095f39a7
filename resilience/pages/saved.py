"""The page of what a folder holds: a plan of either kind, a comparison, a hazard or a survival."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from resilience.errors import UsageError
from resilience.files import reading
from resilience.pages.document import check_page, write
from resilience.results import HAZARD, SUMMARY_FILE, settle

PAGE_FILE = "report.html"


def write_saved_page(run: str | Path, path: str | Path | None = None) -> Path:
    """Writes the page of a result in a folder.

    Args:
        run: the folder, as `--out` wrote it.
        path: a .html file; `report.html` in the folder if omitted.

    Returns:
        Where the page is.

    Raises:
        UsageError: the folder holds no result that has a page, or the path is not that of a page.
        FileError: the system refuses.
    """
    folder = Path(run)
    target = folder / PAGE_FILE if path is None else Path(path)
    check_page(target)
    settle(folder)
    return write(_page(folder), target)


def _page(folder: Path) -> str:
    from resilience.evaluation.comparison import is_comparison, load_comparison
    from resilience.evaluation.survival import holds_survival, load_survival
    from resilience.planning.plan import load_plan
    from resilience.planning.scenarios.files import holds_scenario_plan, load_scenario_plan

    if (folder / HAZARD.mark).is_file():
        from resilience.pages.hazard_page import hazard_page

        with reading(folder / HAZARD.mark, "hazard"):
            return hazard_page(_summary(folder / HAZARD.mark))
    if is_comparison(folder):
        from resilience.pages.comparison_page import comparison_page

        compared = load_comparison(folder)
        with reading(folder / SUMMARY_FILE, "summary of a comparison"):
            return comparison_page(compared, _summary(folder / SUMMARY_FILE))
    if not (folder / SUMMARY_FILE).is_file():
        raise UsageError(
            f"{folder} holds no result; allowed: what solve, compare, hazard or survive wrote with "
            "--out",
            hint="name the folder that was given to --out",
        )
    if holds_survival(folder):
        from resilience.pages.survival_page import survival_page

        return survival_page(load_survival(folder))
    if holds_scenario_plan(folder):
        from resilience.pages.scenario_page import scenario_page

        return scenario_page(load_scenario_plan(folder))
    from resilience.pages.plan_page import plan_page

    return plan_page(load_plan(folder))


def _summary(path: Path) -> dict[str, Any]:
    """What `--json` printed."""
    summary = dict(json.loads(path.read_text(encoding="utf-8")))
    summary.pop("kind", None)
    return summary
