"""Measured series straight from ENTSO-E's server, by way of entsoe-py."""

from __future__ import annotations

from datetime import datetime
from typing import TYPE_CHECKING, Any, Protocol

from resilience.case.measured.exports import LOAD, SOLAR
from resilience.case.measured.series import Measured, checked_series, joined_series
from resilience.errors import UsageError
from resilience.extras import need

if TYPE_CHECKING:
    import pandas as pd

SOLAR_CODE = "B16"
SERVER_ZONE = "Europe/Brussels"


class EntsoeClient(Protocol):
    """What is used of `entsoe.EntsoePandasClient`."""

    def query_load(self, country_code: str, start: Any, end: Any) -> Any:
        """A frame with the column `Actual Load`, MW."""

    def query_generation(self, country_code: str, start: Any, end: Any, psr_type: str) -> Any:
        """A series, or a frame with `Solar`, maybe above `Actual Aggregated`, MW."""


def query_measured(
    area: str,
    start: datetime,
    end: datetime,
    api_key: str = "",
    *,
    step_min: float | None = None,
    client: EntsoeClient | None = None,
) -> Measured:
    """Load and solar power of an area, asked for at ENTSO-E.

    Args:
        area: as `DE_LU`.
        start: first slot, in Brussels' time where it says no zone.
        end: the slot after the last one.
        api_key: a token of one's own, from the account on transparency.entsoe.eu.
        step_min: as in `read_measured`.
        client: asks the server; one of entsoe-py with the token if omitted.

    Raises:
        UsageError: entsoe-py is missing, or the answer has gaps or no such series.
    """
    import pandas as pd

    if client is None:
        need("entsoe", "asking ENTSO-E", "entsoe")
        from entsoe import EntsoePandasClient

        client = EntsoePandasClient(api_key=api_key)
    first, stop = _in_zone(pd.Timestamp(start)), _in_zone(pd.Timestamp(end))
    answers = {
        LOAD: client.query_load(area, first, stop),
        SOLAR: client.query_generation(area, first, stop, psr_type=SOLAR_CODE),
    }
    names = {LOAD: "Actual Load", SOLAR: "Actual Aggregated"}
    columns = {
        name: checked_series(f"ENTSO-E {area}", name, _column(answer, names[name]))
        for name, answer in answers.items()
    }
    return joined_series(f"ENTSO-E {area}", columns, step_min)


def _in_zone(time: pd.Timestamp) -> pd.Timestamp:
    return time.tz_localize(SERVER_ZONE) if time.tz is None else time


def _column(answer: Any, name: str) -> pd.Series:
    """The only column of an answer, or that of a name, in UTC.

    Raises:
        UsageError: there are several others.
    """
    import pandas as pd

    table = pd.DataFrame(answer)
    labels = [label if isinstance(label, tuple) else (label,) for label in table.columns]
    chosen = [k for k, label in enumerate(labels) if len(labels) == 1 or name in label]
    if len(chosen) != 1:
        raise UsageError(
            f"ENTSO-E answers with {', '.join(map(str, table.columns)) or 'nothing'}; "
            f"allowed: {name}",
            hint="is it another version of entsoe-py?",
        )
    return table.iloc[:, chosen[0]].tz_convert("UTC").astype(float)
