"""In cases that state every key, a slip in any table is named and breaks nothing beside it."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any

import pytest

from resilience.case.document import Document
from resilience.case.load import build_case
from resilience.errors import CaseError
from tests.fuzz.full_case import dark_case, stormy_case

CASES = {"storm": stormy_case, "dark": dark_case}
NAMED_BY_USERS = {("profiles", "columns"), ("storm", "curves"), ("storm", "repair", "priority")}
Place = tuple[str | int, ...]


def tables(node: object, place: Place = ()) -> Iterator[Place]:
    """Where every table stands whose keys are fixed."""
    if isinstance(node, dict):
        if place not in NAMED_BY_USERS:
            yield place
        for key, inner in node.items():
            yield from tables(inner, (*place, key))
    elif isinstance(node, list):
        for k, inner in enumerate(node):
            yield from tables(inner, (*place, k))


PLACES = [(name, place) for name, case in CASES.items() for place in tables(case())]


def at(data: Any, place: Place) -> dict[str, Any]:
    for key in place:
        data = data[key]
    assert isinstance(data, dict)
    return data


@pytest.mark.parametrize(("name", "place"), PLACES)
def test_an_unknown_key_is_named_and_nothing_else_is(name: str, place: Place) -> None:
    data = copy.deepcopy(CASES[name]())
    at(data, place)["hardning"] = 1.8
    with pytest.raises(CaseError) as refused:
        build_case(Document(None, data))
    assert ["hardning" in str(mistake) for mistake in refused.value.mistakes] == [True]


def wrongs() -> dict[str, Callable[[dict[str, Any], str], object]]:
    def set_to(value: object) -> Callable[[dict[str, Any], str], object]:
        return lambda table, key: table.__setitem__(key, value)

    return {"missing": dict.pop, "text": set_to("ten"), "list": set_to([[]]), "table": set_to({})}


@pytest.mark.parametrize("wrong", wrongs())
@pytest.mark.parametrize(("name", "place"), PLACES)
def test_a_wrong_value_is_refused_or_read_but_never_a_traceback(
    name: str, place: Place, wrong: str
) -> None:
    """Of every key of the table, one after the other."""
    for key in at(CASES[name](), place):
        data = copy.deepcopy(CASES[name]())
        wrongs()[wrong](at(data, place), key)
        with suppress(CaseError):
            build_case(Document(None, data))
