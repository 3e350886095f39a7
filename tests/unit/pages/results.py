"""A plan whose figures are known on paper, with names that are markup."""

from __future__ import annotations

import json
import re
from functools import cache
from pathlib import Path
from typing import Any

import resilience as rs
from resilience.case.document import find_case

SCRIPT = "<script>document.title='run'</script>"
"""A name that a page must show and never run."""
MARKED = "<b title=\"x\">east & 'co'</b>"


def marked_case(folder: Path) -> rs.Case:
    """`analytic/two-islands`, a bus, a load and the case itself called after markup."""
    text = find_case("analytic/two-islands").read_text(encoding="utf-8")
    text = re.sub(r"(?<![-\w])clinic(?=\")", lambda _: SCRIPT, text)
    text = text.replace('"east"', json.dumps(MARKED)).replace("grid-east", "way-east")
    text = text.replace(
        "to = " + json.dumps(MARKED), 'name = "way-east", to = ' + json.dumps(MARKED)
    )
    path = folder / "marked.toml"
    path.write_text(f"name = {json.dumps(SCRIPT)}\n{text}", encoding="utf-8")
    return rs.load_case(path)


@cache
def two_islands() -> rs.Plan:
    """4.52 $ and 0.4 MWh shed of the homes, see the head of the case."""
    return rs.solve("analytic/two-islands", "lp")


def data_of(page: str, key: str) -> Any:
    """The JSON of a page: `summary` or `drawn`."""
    return json.loads(page.split(f'id="{key}">', 1)[1].split("</script>", 1)[0])
