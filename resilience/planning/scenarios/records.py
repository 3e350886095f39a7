"""What of a plan over scenarios is a record: what happens, what it is worth, what few stand for."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ScenarioStatistics:
    """What happens over the scenarios; costs are operating cost less terminal credit.

    Attributes:
        expected_cost: mean by probability, $.
        cvar_95_cost: mean of the worst 5 %, $.
        worst_cost: of the dearest scenario, $.
        expected_shed_mwh: energy not served, MWh.
        shed_probability: of shedding anything at all.
    """

    expected_cost: float
    cvar_95_cost: float
    worst_cost: float
    expected_shed_mwh: float
    shed_probability: float


@dataclass(frozen=True)
class InformationValue:
    """What it is worth to plan over scenarios, and what it would be worth to know them.

    Attributes:
        clairvoyant_cost: risk of the costs if every scenario were known beforehand, $.
        mean_value_cost: risk of the costs with the plan for mean data, $; None where undefined.
        value_of_stochastic_solution: what the plan for the mean costs more, $; None likewise.
        value_of_perfect_information: what knowing the scenario beforehand would save, $.
    """

    clairvoyant_cost: float
    mean_value_cost: float | None
    value_of_stochastic_solution: float | None
    value_of_perfect_information: float


@dataclass(frozen=True)
class Unreduced:
    """What the common schedule of a plan over few scenarios costs over all that they stand for.

    Every scenario follows the schedule until its own outage shows, and from then on knows its own
    end, as in the plan; storage and grids may there be in two modes at once, which costs less if
    anything. Standard errors are those of the scenarios as a sample.

    Attributes:
        scenarios: number of all.
        objective: of the risk over their costs, $.
        expected_cost: mean by probability, $.
        cost_error: its standard error, $.
        expected_shed_mwh: energy not served, MWh.
        shed_error: its standard error, MWh.
        shed_probability: of shedding anything at all.
    """

    scenarios: int
    objective: float
    expected_cost: float
    cost_error: float
    expected_shed_mwh: float
    shed_error: float
    shed_probability: float
