"""Pages of results: `--html`. What pages need is imported only where one is asked for."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from resilience.pages.write import Pageable


def check(path: Path | None) -> None:
    """Refuses a page's file before anything is computed; None: no page is asked for."""
    if path is not None:
        from resilience.pages.document import check_page

        check_page(path)


def write(result: Pageable, path: Path) -> None:
    """Writes the page of a result."""
    from resilience.pages.write import write_page

    write_page(result, path)
