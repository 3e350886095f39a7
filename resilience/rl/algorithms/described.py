"""What settings mean: what the docstrings of their dataclasses say of each."""

from __future__ import annotations

import inspect
import re
from dataclasses import fields
from typing import Any, NamedTuple

ATTRIBUTE = re.compile(r"^    (\w+(?:, \w+)*): (.*(?:\n {8,}.*)*)", re.MULTILINE)


class DescribedSetting(NamedTuple):
    """A setting.

    Attributes:
        name: of the field.
        default: its value unless another is given.
        about: what it is.
    """

    name: str
    default: Any
    about: str


def described(kind: type) -> list[DescribedSetting]:
    """The settings of a dataclass, of those that it inherits from as well."""
    about: dict[str, str] = {}
    for one_kind in reversed(kind.__mro__):
        _, _, section = inspect.cleandoc(one_kind.__doc__ or "").partition("Attributes:\n")
        for names, text in ATTRIBUTE.findall(section):
            about |= dict.fromkeys(names.split(", "), " ".join(text.split()))
    return [DescribedSetting(f.name, f.default, about[f.name]) for f in fields(kind)]
