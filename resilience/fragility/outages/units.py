r"""Units that fail: generators that do not start or stop running, storage and plants that break,
tanks that nobody can deliver to.

A unit in order fails in slot $t$ with the probability $1 - e^{-h_t}$, and one that is out is back
in the next slot with the probability $1 - e^{-\Delta / \text{MTTR}}$:

$$ h_t = \frac{\Delta}{\text{MTTF}}\, r_t - \ln(1 - f)\, c_t $$

A storage, a plant or the way to a tank is always in service, $r_t = 1$. A generator stands by:
$r_t$ is 1 where its bus is without the main grid, and $c_t$ is 1 in the first of these slots, in
which it is called on and fails to start with the probability $f$. That is so in every loss of the
grid and whatever a dispatcher does with the unit, so that everybody faces the same failures; and
all times are exponential, so that the present status says all there is to know. What has been
repaired has been tried out: it does not fail to start in the slot in which it is back.

The measures are those of Marqusee and Jenket (Reliability of emergency and standby diesel
generators, Applied Energy 268, 2020): availability, failure to start, mean time to failure.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.case.schema import UnitTable
from resilience.fragility.outages.main_grid import MainGrid

if TYPE_CHECKING:
    from resilience.case import Case
    from resilience.fragility.outages.scenarios import Scenarios

STREAM = 0x756E6974
"""Beside a seed, the key of the random numbers of units: those of lines stay as they are."""


@dataclass(frozen=True)
class FailingUnits:
    """How units fail, arrays (units,).

    Attributes:
        names: of the units.
        bus: index of each one's bus in the case's network; 0 of tanks, which never stand by.
        fail_rate: of failing in service, per slot.
        start_hazard: minus log of the chance to start.
        repair_rate: per slot; 0 where nobody repairs it.
        availability: probability that it is in order before the first slot.
        stands_by: whether it is in service only without the main grid.
    """

    names: tuple[str, ...]
    bus: Ints
    fail_rate: Floats
    start_hazard: Floats
    repair_rate: Floats
    availability: Floats
    stands_by: Bools

    @classmethod
    def of_case(cls, case: Case, names: Sequence[str] | None = None) -> FailingUnits:
        """The units of a case that say how they fail, or those of some names.

        Those that do not say it neither fail nor are repaired.
        """
        by_name = {unit.name: unit for unit in case.fallible}
        if names is None:
            names = [name for name in case.fallible_units if by_name[name].can_fail]
        units = [by_name[name] for name in names]
        step_h = case.step_h

        def per_slot(key: str) -> Floats:
            hours = [getattr(unit, key, None) for unit in units]
            return np.array([0.0 if h is None else step_h / h for h in hours], float)

        start = np.array([getattr(unit, "start_failure", 0.0) for unit in units], float)
        return cls(
            names=tuple(names),
            bus=np.array(
                [
                    case.network.bus(unit.bus) if isinstance(unit, UnitTable) else 0
                    for unit in units
                ],
                np.intp,
            ),
            fail_rate=per_slot("mttf_h"),
            start_hazard=-np.log1p(-start),
            repair_rate=per_slot("mttr_h"),
            availability=np.array([getattr(unit, "availability", 1.0) for unit in units], float),
            stands_by=np.array([unit.stands_by for unit in units], bool),
        )

    @cached_property
    def mean_left(self) -> Floats:
        """(units,) slots after the present one that a unit which is out stays so, on average."""
        chance = -np.expm1(-self.repair_rate)
        return np.where(
            chance > 0.0, np.exp(-self.repair_rate) / np.maximum(chance, 1e-300), np.inf
        )

    def hazard(self, is_lost: Bools, was_lost: Bools) -> Floats:
        """(units, slots, n) minus log of the chance to stay in order in a slot.

        Args:
            is_lost: (units, slots, n) whether the bus is without the main grid.
            was_lost: (units, n) whether it was in the slot before.
        """
        before = np.concatenate([was_lost[:, None], is_lost[:, :-1]], axis=1)
        in_service = is_lost | ~self.stands_by[:, None, None]
        hazard = in_service * self.fail_rate[:, None, None]
        return np.asarray(hazard + (is_lost & ~before) * self.start_hazard[:, None, None])

    def outages(
        self, in_order: Bools, hazard: Floats, exponential: Callable[[int], Floats]
    ) -> Bools:
        """(units, slots, n) where units are out, from the slot after the present one on.

        Args:
            in_order: (units, n) their present status.
            hazard: (units, slots, n) as `hazard` gives it.
            exponential: (units, n) standard exponential numbers of the k-th change of status.
        """
        units, slots, n = hazard.shape
        total = np.zeros((units, slots + 1, n))
        np.cumsum(hazard, axis=1, out=total[:, 1:])
        down, slot = np.zeros((units, slots, n), bool), np.arange(slots)[None, :, None]
        first = self._slots_out(exponential(0), slots)  # of those that are out now, in order again
        down |= (slot < first[:, None]) & ~in_order[:, None]
        at_risk = np.where(in_order, 0, np.minimum(first + 1, slots))
        number = 1
        while (at_risk < slots).any():
            so_far = np.take_along_axis(total, at_risk[:, None], axis=1)
            fails = (total[:, 1:] - so_far >= exponential(number)[:, None]) & (
                slot >= at_risk[:, None]
            )
            begin = np.where(fails.any(axis=1), fails.argmax(axis=1), slots)
            stop = begin + 1 + self._slots_out(exponential(number + 1), slots)
            down |= (slot >= begin[:, None]) & (slot < stop[:, None])
            at_risk = np.minimum(stop + 1, slots)
            number += 2
        return down

    def _slots_out(self, exponential: Floats, slots: int) -> Ints:
        """(units, n) slots until units that are out are back, `slots` at most."""
        with np.errstate(divide="ignore"):
            slots_out = exponential / self.repair_rate[:, None]
        return np.minimum(slots_out, slots).astype(np.intp)


def with_units(case: Case, scenarios: Scenarios, seed: int) -> Scenarios:
    """The scenarios of lines, and beside them those of the units of the case that fail.

    A stream per scenario, so that more scenarios, or a longer horizon, begin alike. Before the
    first slot all buses have the main grid, if the case has any.

    Args:
        case: says how its units fail; where none does, nothing changes.
        scenarios: of lines, from the start of the case's horizon on.
        seed: of the draw; lines of the same seed have nothing to do with it.
    """
    units = FailingUnits.of_case(case)
    if not units.names:
        return scenarios
    down = drawn_units(case, units, scenarios, seed)
    process = "; ".join([text for text in (scenarios.process,) if text] + ["units fail"])
    return replace(
        scenarios,
        lines=(*scenarios.lines, *units.names),
        down=np.concatenate([scenarios.down, down]),
        process=process,
    )


def drawn_units(case: Case, units: FailingUnits, scenarios: Scenarios, seed: int) -> Bools:
    """(units, slots, scenarios) where units are out, given what becomes of the lines."""
    grid, slots, n = MainGrid(case, scenarios.lines), scenarios.slots, scenarios.n
    lost = grid.is_lost(units.bus, scenarios.down.reshape(len(scenarios.lines), slots * n))
    lost = lost.reshape(len(units.names), slots, n)
    streams = np.random.default_rng([seed, STREAM]).spawn(n)
    in_order = np.stack([rng.random(len(units.names)) for rng in streams], axis=1)
    drawn: list[Floats] = []

    def exponential(number: int) -> Floats:
        while len(drawn) <= number:
            drawn.append(np.stack([rng.exponential(size=len(units.names)) for rng in streams], 1))
        return drawn[number]

    hazard = units.hazard(lost, np.zeros((len(units.names), n), bool))
    return units.outages(in_order < units.availability[:, None], hazard, exponential)
