"""Every quantity of every component says its unit and what it is."""

from __future__ import annotations

import re

import pytest

from resilience.models.symbols import symbol_table

TABLE = symbol_table()


@pytest.mark.parametrize("row", TABLE, ids=lambda row: row["name"])
def test_a_quantity_has_a_meaning_and_the_unit_of_its_kind(row: dict[str, str]) -> None:
    assert row["meaning"]
    component, *_, quantity = row["name"].split(".")
    if re.match(r"q(_|$)", quantity):
        assert row["unit"] == "Mvar"
    elif component == "topology":
        assert row["unit"] == "1"
    elif quantity.endswith("_price"):
        assert row["unit"] == "$/MWh"
    elif quantity.endswith("_left"):
        assert row["unit"] == "h"


def test_what_a_name_means_is_said_apart_for_a_quantity_and_its_limit() -> None:
    meanings = {row["name"]: row["meaning"] for row in TABLE}
    limited = [name for name in meanings if f"{name}_max" in meanings]
    assert len(limited) > 5
    assert all(meanings[name] != meanings[f"{name}_max"] for name in limited)
