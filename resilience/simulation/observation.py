"""What a dispatcher sees in a slot, and what it has to answer."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

from resilience.arrays import Bools, Floats, Ints
from resilience.models.simulator import Decision

Forecast = Callable[[str | None, Ints], Floats]
"""Per-unit values of a profile, by its name (None: constant 1) and slots from now on."""


@dataclass(frozen=True)
class Observation:
    """What an operator sees at the start of a slot, for a batch of scenarios.

    Attributes:
        t: the slot, 0 for the first of the horizon.
        energy: (units, batch) stored energy, MWh; units are in the order of `case.ess`.
        line_up: (elements of the case, batch) which lines and fallible units are up now; a failure
            is seen in its slot.
        island: (buses of the merged graph, batch) number of each bus's island.
        centre: (batch,) slot of 15 minutes at which today's hazard is forecast to peak, -1 where
            unknown.
        forecast: per-unit values of a profile by its name (None: constant 1) and slots from `t`
            on, (len(slots), batch): true now, expected later.
        data: (n_data, batch) demand, weather, prices and limits of the slot as they are, stacked
            as `Simulator.stacked` does.
        fuel: (tanks, batch) m³ in every tank, in the order of `case.tank`; None without tanks.
        states: what else devices carry from slot to slot, (devices, batch) by name: `generator.on`,
            hours still to wait `generator.up_left` and `generator.down_left`, MW before
            `generator.p_before`, `line.closed`; empty where a case has none of them.
        line_up_before: (lines of the case, batch) which lines were up one slot ago, all at the
            start; None: as now. Units may trip where an outage begins.
    """

    t: int
    energy: Floats
    line_up: Bools
    island: Ints
    centre: Ints
    forecast: Forecast
    data: Floats
    fuel: Floats | None = None
    states: Mapping[str, Floats] = field(default_factory=dict)
    line_up_before: Bools | None = None

    def forecast_of(self, k: int) -> Forecast:
        """The forecast of scenario k alone, (len(slots),)."""
        return lambda name, slots: self.forecast(name, slots)[:, k]


class Rationed(NamedTuple):
    """An action that says what generators with a tank may give, too, so that fuel is kept.

    Attributes:
        power: (units, batch) charging power, MW, negative when discharging.
        burner_mw: (burners, batch) MW that each of these generators may give in the slot, in the
            order of `case.generator`.
    """

    power: Floats
    burner_mw: Floats


Action = Floats | Rationed | Decision
"""(units, batch) charging power in MW, negative when discharging, with fuel rationed or not, or
with units committed and lines switched."""


def parts_of(action: Action) -> Decision:
    """An action of any kind as a decision."""
    if isinstance(action, Decision):
        return action
    return Decision(*action) if isinstance(action, Rationed) else Decision(action)


class Dispatcher(Protocol):
    """Decides the storage power in every slot, and what runs; the rest follows by recourse.

    A dispatcher is made from the setting in which it acts, once for a batch of scenarios, and then
    asked slot by slot. It may remember what it has observed. It does not need to keep to limits:
    the simulator cuts its answer back to what the units can do, see `Simulator.limits`.

        class Full:
            name = "full"

            def __init__(self, setting: Setting) -> None:
                self.capacity = np.array([[unit.e_mwh] for unit in setting.case.ess])
                self.step_h = setting.case.step_h

            def act(self, observation: Observation) -> Floats:
                return (self.capacity - observation.energy) / self.step_h

        report = rs.compare("ieee33-tou", {"full": Full}, days=2, draws=4)

    `resilience.testing.check_dispatcher` holds one against the rules of the game: nobody may see
    the future, and nobody may cost less than the clairvoyant bound.

    Attributes:
        name: of the method, in reports.
    """

    name: str

    def act(self, observation: Observation, /) -> Action:
        """(units, batch) charging power in MW, negative when discharging.

        Where there are tanks, it may be `Rationed`; if not, fuel is burnt as merit asks. Where
        units need commitment or lines can be switched, it may be a `Decision`; if not, the
        simulator commits and switches by merit.

        Args:
            observation: of the slot; do not change its arrays.
        """
