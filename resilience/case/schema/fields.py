"""What the tables of a case file are made of: kinds of values, and the base of all tables."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field


def _text(value: Any) -> Any:
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else value


Name = Annotated[str, BeforeValidator(_text), Field(min_length=1)]
Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(ge=0, le=1)]
Loose = Annotated[float, Field(allow_inf_nan=True)]
Efficiency = Annotated[float, Field(gt=0, le=1)]


class Table(BaseModel):
    """Base of all tables: immutable, strict about types, and without unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


MAX_PRICE_PER_MWH = 1e6  # of anything; beyond, a price is a slip
