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


def grown(value: object) -> object:
    """The value, every number in it beyond all measure."""
    if isinstance(value, list):
        return [grown(inner) for inner in value]
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return 1.7e308 if is_number else value


WRONGS: dict[str, Callable[[object], object]] = {
    "text": lambda _: "ten",
    "list": lambda _: [[]],
    "table": lambda _: {},
    "huge": grown,
}


@pytest.mark.parametrize("wrong", ["missing", *WRONGS])
@pytest.mark.parametrize(("name", "place"), PLACES)
def test_a_wrong_value_is_refused_or_read_but_never_a_traceback(
    name: str, place: Place, wrong: str
) -> None:
    """Of every key of the table, one after the other."""
    for key in at(CASES[name](), place):
        data = copy.deepcopy(CASES[name]())
        table = at(data, place)
        if wrong == "missing":
            del table[key]
        else:
            table[key] = WRONGS[wrong](table[key])
        with suppress(CaseError):
            build_case(Document(None, data))
