"""What is decided of a slot before its islands are closed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from resilience.arrays import Floats


class Decision(NamedTuple):
    """What an operator decides ahead in a slot; everything else follows by recourse.

    Rows are in the order of the case. What is None is left to the simulator: units are committed
    and lines switched as costs least in the slot itself, and generators with a tank or a ramp give
    what merit asks. What cannot be followed, as a stop within the minimum up time or a loop of
    closed lines, is not: as much of the decision is done as the rows of the model allow.

    Attributes:
        power: (units, batch) charging power, MW, negative when discharging.
        burner_mw: (burners, batch) MW that each generator with a tank may give, at most.
        on: (committed generators, batch) 1 where a generator that needs commitment runs.
        closed: (switchable lines, batch) 1 where a line is closed.
        ramped_mw: (generators with a ramp, batch) MW that each of them gives, so that a ramp to
            come can be prepared for.
    """

    power: Floats
    burner_mw: Floats | None = None
    on: Floats | None = None
    closed: Floats | None = None
    ramped_mw: Floats | None = None


def part_by_part(
    function: Callable[[list[Floats]], Floats], decisions: Sequence[Decision]
) -> Decision:
    """One decision from some of the same parts, made part by part; what is None stays so.

    Args:
        function: makes a part from those of all decisions.
        decisions: one or more.
    """

    def joined(arrays: Sequence[Floats | None]) -> Floats | None:
        values = [array for array in arrays if array is not None]
        return function(values) if values else None

    power, *more = (joined(arrays) for arrays in zip(*decisions, strict=True))
    assert power is not None  # every decision has it
    return Decision(power, *more)
