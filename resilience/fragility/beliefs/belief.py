"""What a dispatcher believes of outages to come, given what an operator has seen.

`BellBelief` believes in the paper's bell (`bell_day.py`), `StormBelief` in a storm on its track
(`storm_belief.py`), `BlackoutBelief` in a blackout of unknown length (`blackout_belief.py`),
`ScenarioBelief` in scenarios (`scenario_belief.py`), and `UnitBelief` beside one of them in units
that fail (`unit_belief.py`); `case_belief` gives a case its own.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from resilience.fragility.beliefs.bell_belief import BellBelief
from resilience.fragility.beliefs.blackout_belief import BlackoutBelief
from resilience.fragility.beliefs.protocol import Belief
from resilience.fragility.outages.bell import Bell, case_bell
from resilience.fragility.outages.blackout import case_blackout

if TYPE_CHECKING:
    from resilience.case import Case

__all__ = ["Belief", "case_belief"]


def case_belief(
    case: Case, lines: tuple[str, ...], *, bell: Bell | None = None, seed: int = 0
) -> Belief:
    """What the operator of a case believes: its blackout, its storm, or else its bell.

    Args:
        case: the case.
        lines: that can fail, and units, in the order of what is known of them.
        bell: believed in, whatever the case says.
        seed: of sampled futures.

    Raises:
        CaseError: the case does not say where its lines are.
        UsageError: a setting out of range.
    """
    of_lines = tuple(name for name in lines if case.network.has_line(name))
    if len(of_lines) < len(lines):
        from resilience.fragility.beliefs.unit_belief import UnitBelief

        return UnitBelief(case_belief(case, of_lines, bell=bell, seed=seed), case, lines, seed)
    if bell is None and case.blackout is not None:
        return BlackoutBelief(case_blackout(case), lines, seed)
    if bell is None and case.storm is not None and case.storm.points:
        from resilience.fragility.beliefs.storm_belief import StormBelief
        from resilience.fragility.chain import storm

        return StormBelief.from_storm(storm(case), lines, seed=seed)
    return BellBelief(bell or case_bell(case), case.window.slots_per_day, len(lines), seed)
