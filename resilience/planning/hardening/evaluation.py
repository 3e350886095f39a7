"""What storms cost with something built: every storm solved for itself, as it really is.

The same program that any plan over scenarios is measured against: each storm known from its start,
islands without a source dark, as many crews as there are. The choice is made in a program that lets
every island live and has crews without limit; what it is worth is told from here.
"""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.case import Case
from resilience.case.critical import critical_loads
from resilience.fragility.outages.scenarios import Scenarios
from resilience.fragility.outages.weights import standard_error
from resilience.models.microgrid import Physics
from resilience.models.program.risk import Risk
from resilience.models.program.risk_measures import conditional_value_at_risk
from resilience.planning.scenarios.program import DistinctScenarios, scenario_program
from resilience.planning.two_stage.recourse import Recourse
from resilience.simulation.world import microgrid_with_fallible_lines
from resilience.tolerances import RELAXATION_TOLERANCE


@dataclass(frozen=True, eq=False)
class StormOutcomes:
    """What each of some storms costs.

    Attributes:
        probability: (storms,) of each.
        cost: (storms,) $, operating cost less terminal credit.
        shed_mwh: (storms,) energy not served, MWh.
        critical_mwh: (storms,) of critical loads, MWh.
        critical_h: (storms,) hours in which a critical load is not fully served.
        customer_h: (storms,) hours without supply of a customer, on average; of a load that is
            served in part, that part of its customers. NaN where no load says how many it has.
        stratum: (storms,) which storm of a catalogue each is a draw of; None: all of the same.
    """

    probability: Floats
    cost: Floats
    shed_mwh: Floats
    critical_mwh: Floats
    critical_h: Floats
    customer_h: Floats
    stratum: Ints | None = None

    def mean(self, name: str) -> float:
        """The expected value of one of the arrays."""
        return float(self.probability @ getattr(self, name))

    def error(self, name: str) -> float:
        """Its standard error; NaN of a single storm."""
        return self._error(getattr(self, name))

    def cvar(self, alpha: float) -> float:
        """$ of the mean of the worst 1 - alpha."""
        return conditional_value_at_risk(self.cost, alpha, self.probability)

    def saving(self, before: StormOutcomes) -> tuple[float, float]:
        """$ that are saved against the same storms before, and the standard error, paired."""
        saved = before.cost - self.cost
        return float(self.probability @ saved), self._error(saved)

    def _error(self, values: Floats) -> float:
        """Standard error of the mean of values (storms,): storms come as often as they come."""
        if self.stratum is None:
            return standard_error(values, self.probability)
        errors = []
        for k in np.unique(self.stratum):
            drawn = self.stratum == k
            share = float(self.probability[drawn].sum())
            errors.append(share * standard_error(values[drawn], self.probability[drawn] / share))
        return float(np.linalg.norm(errors))

    def value(self, risk: Risk) -> float:
        """$ of the risk over the storms."""
        return risk.value(self.cost, self.probability)


def outcomes_of(case: Case, scenarios: Scenarios, physics: Physics) -> StormOutcomes:
    """What the storms cost, each known from its start.

    Args:
        case: the case.
        scenarios: the storms.
        physics: of every storm, a linear one.

    Raises:
        InfeasibleError: a storm has no plan; it is named.
        SolverError: the solver failed.
    """
    microgrid = microgrid_with_fallible_lines(case, scenarios, physics)
    distinct = DistinctScenarios.among(scenarios, microgrid.case)
    two_stage = scenario_program(microgrid, distinct, common_slots=0).two_stage
    starts = two_stage.first.initial
    x0 = np.concatenate([np.empty(0), *(two_stage.x0[name] for name in starts)])
    states = np.tile(x0, (len(two_stage.branches), 1))
    second = Recourse(two_stage, workers=os.cpu_count() or 1).solve(states)
    shed = np.stack(
        [
            point[two_stage.programs[branch.program].columns("load.shed")]
            for branch, point in zip(two_stage.branches, second.points, strict=True)
        ],
        axis=-1,
    )
    critical = shed[critical_loads(case)]
    is_unserved = (critical > RELAXATION_TOLERANCE).any(axis=0)
    cost, shed_mwh, critical_mwh, critical_h, customer_h = (
        array[distinct.index]
        for array in (
            second.cost,
            case.step_h * shed.sum(axis=(0, 1)),
            case.step_h * critical.sum(axis=(0, 1)),
            case.step_h * is_unserved.sum(axis=0),
            _customer_h(case, shed),
        )
    )
    return StormOutcomes(
        scenarios.probability, cost, shed_mwh, critical_mwh, critical_h, customer_h
    )


def _customer_h(case: Case, shed: Floats) -> Floats:
    """(storms,) hours without supply of a customer, from MW shed (loads, slots, storms)."""
    customers = np.array([load.customers or 0 for load in case.load], float)
    if not customers.any():
        return np.full(shed.shape[2], np.nan)
    demand_mw = np.array([load.p_max_mw * case.profile(load.profile) for load in case.load])
    share = shed / np.maximum(demand_mw, RELAXATION_TOLERANCE)[:, :, None]
    return case.step_h * (customers @ share.sum(axis=1)) / customers.sum()
