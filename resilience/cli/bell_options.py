"""The settings of the bell as options of a command line; see `Bell`."""

from __future__ import annotations

from typing import Annotated

from typer import Option

Probability = Annotated[
    float | None, Option(help="Of an outage of a line on a day that the bell fits into.")
]
Height = Annotated[
    float | None, Option(help="Of the bell, per slot of 15 min; replaces the probability.")
]
SigmaSlots = Annotated[float | None, Option(help="Width of the bell, slots of 15 min.")]
DurationSlots = Annotated[
    tuple[int, int] | None, Option(help="Shortest and longest outage, slots of 15 min.")
]
DurationLaw = Annotated[
    str | None, Option(help="Of lengths between these two: uniform or lognormal.")
]
ShiftSlots = Annotated[
    int | None, Option(help="Other breakpoints peak up to so many slots earlier or later.")
]
SharedShift = Annotated[bool | None, Option(help="All of them are shifted alike.")]
CommonDraw = Annotated[bool | None, Option(help="One random number per slot for all lines.")]
Refail = Annotated[bool | None, Option(help="A line may fail more than once a day.")]
Wrap = Annotated[bool | None, Option(help="The bell goes round midnight within its day.")]
Overnight = Annotated[bool | None, Option(help="Outages run on past midnight.")]
Centre = Annotated[
    list[int] | None, Option(help="Slot of 15 min that may be the peak; may be repeated.")
]
CentreErrorSlots = Annotated[
    int | None, Option(help="Error of the forecast of the peak, up to so many slots.")
]
Rate = Annotated[bool | None, Option(help="A rate per hour, so that the step does not matter.")]
Shift = Annotated[
    float,
    Option(
        help="Moves the common strength of a storm's poles by so many standard deviations: at -1 "
        "damage is drawn more often and weighs less."
    ),
]
Reduce = Annotated[
    int | None,
    Option(
        help="Keep so many that stand best for all, weighted to have their means, and a few more "
        "where so many cannot.",
        min=1,
    ),
]
