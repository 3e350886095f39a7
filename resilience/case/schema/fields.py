"""What the tables of a case file are made of: kinds of values, and the base of all tables."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Self
from unicodedata import category

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field
from pydantic_core import PydanticCustomError

from resilience.errors import UsageError, did_you_mean


def _text(value: Any) -> Any:
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else value


def _shown(value: str) -> str:
    """Refuses a name that no list or picture can show: blank, or with control characters."""
    if not value or value.strip() != value or any(category(c) in UNSEEN for c in value):
        raise PydanticCustomError("name", "a name without blanks around it and control characters")
    return value


UNSEEN = ("Cc", "Cs", "Zl", "Zp")  # control, surrogate, line and paragraph separators
Name = Annotated[
    str, Field(min_length=1, max_length=200), BeforeValidator(_text), AfterValidator(_shown)
]
Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(ge=0, le=1)]
Loose = Annotated[float, Field(allow_inf_nan=True)]
Efficiency = Annotated[float, Field(gt=0, le=1)]
MAX_PRICE_PER_MWH = 1e6  # of anything; beyond, a price is a slip
Price = Annotated[float, Field(ge=-MAX_PRICE_PER_MWH, le=MAX_PRICE_PER_MWH)]
Money = Annotated[float, Field(ge=0, le=1e9)]


class Table(BaseModel):
    """Base of all tables: immutable, strict about types, and without unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)
    has_any_size: ClassVar[bool] = False
    """Whether its numbers may be as small and large as they like."""

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """A copy with other values, as pydantic's; the case that takes it checks them.

        Raises:
            UsageError: an unknown key.
        """
        keys = type(self).model_fields
        if unknown := [key for key in update or () if key not in keys]:
            title = type(self).__name__.removesuffix("Table").lower()
            raise UsageError(
                f"a table of {title} has no key {unknown[0]!r}; allowed: {', '.join(keys)}",
                hint=did_you_mean(unknown[0], keys),
            )
        return super().model_copy(update=update, deep=deep)
