"""What is decided of a slot before its islands are closed."""

from __future__ import annotations

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
