r"""The best that anybody without foreknowledge can do where only the end of a blackout is unknown.

What an operator knows of a blackout is that it has not ended yet. So the futures are a comb: a
trunk on which the lines are down, and from every slot in which they may come back a tooth, on which
nothing is unknown any more. Its optimum is one linear program,

$$ \min \sum_t P(D > t)\, C_t(x_t) + \sum_r P(D = r) \sum_{t \ge r} C_t(x^r_t), $$

and no method that does not know the end costs less on average. `Comb` does what it says: on the
trunk while the lines are down, then on the tooth of their return.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.dispatch.merged_grid import merged_grid
from resilience.dispatch.window_program import check_stored
from resilience.errors import UsageError
from resilience.fragility.outages.blackout import Blackout, case_blackout
from resilience.models.backends.highs import LONG_HORIZON_OPTIONS, Highs
from resilience.models.backends.lower import lower
from resilience.models.case_program import terminal_cuts
from resilience.models.language.tree import Tree
from resilience.models.program.unroll import unroll
from resilience.models.simulator import MilpSimulator
from resilience.simulation.observation import Action, Observation, Rationed
from resilience.simulation.setting import CASE, Setting

if TYPE_CHECKING:
    from resilience.case import Case

COMB = "comb"
"""The dispatcher's name."""
UNASKED_NODES = 10_000
"""Up to so many nodes, 140 slots, a comparison solves a comb unasked: in ten seconds."""


@dataclass(frozen=True)
class CombTree:
    """The futures of a blackout.

    Attributes:
        tree: trunk first, slot by slot, then the teeth, the earliest return first.
        slot: (nodes,) of the horizon.
        is_dark: (nodes,) whether the lines are down.
        first_of_tooth: (slots + 1,) first node of the tooth of a return in that slot, -1: none.
    """

    tree: Tree
    slot: Ints
    is_dark: np.ndarray
    first_of_tooth: Ints

    @classmethod
    def of_blackout(cls, blackout: Blackout) -> CombTree:
        """The comb of a blackout over its horizon."""
        first, chance, slots = blackout.first, blackout.chance, blackout.slots
        longest = int(np.flatnonzero(chance > 0.0)[-1]) + 1
        trunk = first + longest
        lasting = np.cumsum(chance[::-1])[::-1]
        probability = [np.append(np.ones(first), lasting[:longest])]
        parent, slot = [np.arange(trunk) - 1], [np.arange(trunk)]
        names = [f"t{t}" for t in range(trunk)]
        tooth, node = np.full(slots + 1, -1), trunk
        for back in (first + 1 + np.flatnonzero(chance > 0.0)).tolist():
            after = np.arange(back, slots)
            tooth[back] = node if len(after) else -1
            parent.append(np.append(back - 1, node + np.arange(len(after) - 1))[: len(after)])
            probability.append(np.full(len(after), chance[back - first - 1]))
            slot.append(after)
            names += [f"t{t} back at t{back}" for t in after]
            node += len(after)
        every = np.concatenate(slot)
        is_dark = (np.arange(node) < trunk) & (every >= first)
        weights = np.concatenate(probability)
        stage = np.zeros(node, np.intp)
        tree = Tree(np.concatenate(parent).astype(np.intp), weights, stage, tuple(names))
        return cls(tree, every, is_dark, tooth)

    def nodes(self, t: int, back: Ints) -> Ints:
        """(batch,) node of slot t where the lines came back in slots `back`, after t: not yet.

        Raises:
            UsageError: a return that the law holds to be impossible.
        """
        first = self.first_of_tooth[np.minimum(back, len(self.first_of_tooth) - 1)]
        node = np.where(back > t, t, first + t - back)
        if ((back <= t) & (first < 0)).any() or self.slot[node].max() != t:
            raise UsageError(
                "the lines of the blackout came back when its law has them down; allowed: returns "
                "of a probability above 0",
                hint="`comb` plans for the law of [blackout]; leave it out on other scenarios",
            )
        return node


@dataclass(frozen=True, eq=False)
class CombPlan:
    """The optimum of a comb.

    Attributes:
        comb: the futures.
        optimum: $ that nobody without foreknowledge costs less than on average, proven from
            multipliers.
        power: (units, nodes) charging power, MW.
        burner_mw: (burners, nodes) MW of generators with a tank; None without tanks.
    """

    comb: CombTree
    optimum: float
    power: Floats
    burner_mw: Floats | None


class Comb:
    """Dispatch by the optimum of the comb; see above.

    Args:
        setting: where it acts.

    Raises:
        UsageError: more than the end of a blackout is unknown.
    """

    def __init__(self, setting: Setting) -> None:
        check_comb(setting)
        self.name = COMB
        self.first = case_blackout(setting.case).first
        self.lines = _lines(setting.case)
        self.back = np.full(setting.n, setting.case.slots)
        self.plan = comb_plan(setting.case, setting.end_value_per_mwh)

    def act(self, observation: Observation) -> Action:
        """What the node says in which each scenario is: (units, batch) charging power, MW."""
        plan, t = self.plan, observation.t
        is_up = observation.line_up[self.lines].all(axis=0)
        returned = is_up & (t > self.first) & (self.back > t)
        self.back = np.where(returned, t, self.back)
        node = plan.comb.nodes(t, self.back)
        power = plan.power[:, node]
        return power if plan.burner_mw is None else Rationed(power, plan.burner_mw[:, node])


def check_comb(setting: Setting) -> None:
    """Checks that nothing but the end of a blackout is unknown.

    Raises:
        UsageError: it is, or nothing is decided ahead of time.
    """
    if reason := beyond_comb(setting):
        raise UsageError(
            f"{COMB} needs a future in which nothing but the end of a blackout is unknown, and "
            f"{reason}",
            hint="`stochastic` plans for any belief",
        )
    check_stored(setting.case)


def is_small_comb(setting: Setting) -> bool:
    """Whether a setting is one of a comb that is solved in seconds."""
    if beyond_comb(setting) or not setting.case.ess:
        return False
    return CombTree.of_blackout(case_blackout(setting.case)).tree.n <= UNASKED_NODES


def beyond_comb(setting: Setting) -> str:
    """Why a setting is none of a comb, in words; empty where it is one."""
    case, limited = setting.case, setting.microgrid.physics != "copperplate"
    reasons = {
        f"case {case.name!r} has no [blackout]": case.blackout is None,
        "units may fail": bool(case.fallible_units),
        "operators believe in other scenarios": setting.believed != CASE,
        "units are committed or ramped, costs curved, lines switched, or loads return with a "
        "surplus": isinstance(setting.simulator, MilpSimulator),
        "load and PV are not as forecast": setting.error_correlation is not None,
        "lines have limits, or the state of charge is reset at midnight": limited
        or setting.reset_daily,
    }
    return next((words for words, holds in reasons.items() if holds), "")


def comb_optimum(setting: Setting) -> float:
    """$ that nobody without foreknowledge costs less than on average, proven."""
    return comb_plan(setting.case, setting.end_value_per_mwh).optimum


def _lines(case: Case) -> list[int]:
    """Positions in the network of the lines of the case's blackout."""
    return [case.network.line(name) for name in case_blackout(case).lines]


@lru_cache(maxsize=2)
def comb_plan(case: Case, end_value_per_mwh: float) -> CombPlan:
    """The optimum over the comb of a case's blackout, load and PV as the profiles say.

    Args:
        case: over the horizon of the blackout.
        end_value_per_mwh: what energy left at the end is worth.
    """
    comb, merged = CombTree.of_blackout(case_blackout(case)), merged_grid(case)
    microgrid = merged.microgrid
    stage = microgrid.stage(case.step_h, may_spill=True)
    standard = unroll([stage], comb.tree, terminal_cuts(microgrid, end_value_per_mwh))
    solver = Highs(lower(standard, integer="none", modes={}), threads=1)
    solver.tune(LONG_HORIZON_OPTIONS)
    up = np.ones((len(case.network.line_names), comb.tree.n), bool)
    up[_lines(case)] = ~comb.is_dark
    profile = merged.profile(lambda name: case.profile(name)[comb.slot])
    data = microgrid.data(microgrid.situation(up, profile))
    solver.update(standard.vectors(data, microgrid.start()))
    solution = solver.solve()
    charge, discharge = (
        solution.point[standard.columns(f"ess.{way}")] for way in ("charge", "discharge")
    )
    shares = merged.burner_shares
    burner_mw = shares @ solution.point[standard.columns("generator.p")] if len(shares) else None
    return CombPlan(comb, solver.certified_bound(solution), charge - discharge, burner_mw)
