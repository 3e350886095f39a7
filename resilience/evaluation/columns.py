"""The columns of a comparison, one number per method, and what each means.

Expectations weigh the episodes by their probabilities. `per_day` is per day of an episode.
"""

from __future__ import annotations

import numpy as np

from resilience.arrays import Floats
from resilience.dispatch.comb import COMB
from resilience.evaluation.ac_check import TrajectoryACCheck
from resilience.evaluation.comparison import BOUND
from resilience.evaluation.judged import Judged
from resilience.evaluation.measures import statistics
from resilience.evaluation.paired import cost_by_day
from resilience.models.program import risk_measures
from resilience.tolerances import PROBABILITY_TOLERANCE

COLUMNS = {
    "cost_per_day": "expected $: operating cost less the worth of the energy left",
    "iqm_per_day": "interquartile mean over the episodes, $; none unless they are equally likely",
    "cvar95_day": "mean of the worst 5 % of all days of all episodes, energy gained credited, $",
    "cvar95_per_day": "mean of the worst 5 % of the episodes, $",
    "worst_per_day": "the dearest episode, $",
    "worst_day": "operating cost of the dearest day of any episode, $",
    "gap_percent": "(expected cost - expected bound) / |expected bound|, %",
    "over_comb_percent": "cost above that of `comb` on the same episodes, % of it",
    "over_dual_percent": "cost above the dual bound, % of it; what penalties pay is noise",
    "score": "(rule 0.9 - cost) / (rule 0.9 - bound), all expected",
    "over_rule_per_day": "cost - rule 0.9 on the same episodes, expected $",
    "over_rule_low": "lower end of its 95 % interval over days and episodes, $",
    "over_rule_high": "upper end, $",
    "over_rule_carriers": "least number of day-episodes that carry 80 % of it",
    "perfect_information_per_day": "what knowing the future would save this method, $",
    "end_energy_mwh": "stored energy left whose worth is credited, MWh",
    "shed_mwh_per_day": "energy not served, MWh",
    "shed_mw_slots_per_day": "the same as the paper adds it up: MW over the slots, without hours",
    "eens_mwh": "expected energy not served in an episode, MWh",
    "lolp": "share of the slots with shedding",
    "lolp_episodes": "share of the episodes with shedding",
    "lole_h_per_day": "hours with shedding",
    "served_percent": "energy served / energy demanded, %",
    "critical_served_percent": "the same of the critical loads; none where the case has none",
    "critical_whole": "probability that no critical load is ever shed",
    "critical_lasts_h": "expected hours until a critical load is first shed; never: all hours",
    "asidi_h_per_day": "hours without supply of the average MW",
    "asifi_per_day": "interruptions of the average MW",
    "trapezoid_phi_per_h": "how fast service drops in the deepest drop of an episode, 1/h",
    "trapezoid_lambda": "how deep, share of the demand",
    "trapezoid_e_h": "how long it stays there, h",
    "trapezoid_pi_per_h": "how promptly it comes back, 1/h; none where it never drops",
    "trapezoid_area": "mean share of the demand served over time",
    "build_s": "wall-clock seconds to make the dispatcher once, training included",
    "build_cpu_s": "the same in seconds of the processor",
    "ms_per_decision": "wall-clock time of a decision of one episode",
    "cpu_ms_per_decision": "the same of the processor",
}
"""Column to meaning."""

AC_COLUMNS = {
    "ac_v_min_pu": "lowest voltage",
    "ac_v_max_pu": "highest voltage",
    "ac_outside_percent": "share of the slots in which a limit is exceeded, %",
    "ac_overload_mva": "greatest excess over a line's rating; none without ratings",
    "ac_root_excess_mw": "greatest power that a forming unit lacks to carry its island",
    "ac_loss_mwh_per_day": "losses",
    "ac_unfunded_mwh_per_day": "losses that the dispatch did not reckon with",
    "ac_excess_mwh_per_day": "energy that forming units give or take beyond their limits",
    "ac_not_converged_percent": "share of the slots without a solution, left out of all others, %",
    "ac_cpu_s": "seconds of the processor for all power flows",
}
"""The same of what AC power flow finds, with `ac=True`."""


def row(judged: Judged, name: str) -> dict[str, float]:
    """All columns of one method."""
    values = _costs(judged, name) | _over_best(judged, name) | _against_rule(judged, name)
    values |= _service(judged, name) | _times(judged, name)
    if judged.certificates is not None:
        values |= _ac(judged.certificates[name], judged.days, judged.scenarios.probability)
    return {column: values[column] for column in (*COLUMNS, *AC_COLUMNS) if column in values}


def _costs(judged: Judged, name: str) -> dict[str, float]:
    cost, likely, days = judged.objective[name], judged.scenarios.probability, judged.days
    alike = np.ptp(likely) <= PROBABILITY_TOLERANCE
    by_day = cost_by_day(judged, name)
    mean, rule, bound = (
        statistics.expected(values, likely)
        for values in (cost, judged.objective[judged.reference], judged.bound)
    )
    return {
        "cost_per_day": mean / days,
        "iqm_per_day": statistics.interquartile_mean(cost) / days if alike else float("nan"),
        "cvar95_day": risk_measures.conditional_value_at_risk(
            by_day.ravel(), 0.95, np.repeat(likely / by_day.shape[1], by_day.shape[1])
        ),
        "cvar95_per_day": risk_measures.conditional_value_at_risk(cost, 0.95, likely) / days,
        "worst_per_day": risk_measures.worst(cost, likely) / days,
        "worst_day": judged.measures[name].worst_day[0],
        "gap_percent": 100.0 * float(statistics.gap_to_bound(mean, bound)),
        "score": float(statistics.score(mean, rule, bound)),
        "perfect_information_per_day": statistics.value_of_perfect_information(
            cost, judged.bound, likely
        )
        / days,
        "end_energy_mwh": statistics.expected(judged.trajectories[name].credited_mwh, likely),
    }


def _over_best(judged: Judged, name: str) -> dict[str, float]:
    """How far a method is from what nobody without foreknowledge stays below."""
    likely, over = judged.scenarios.probability, {}
    if COMB in judged.objective and name != BOUND:
        mean, best = (statistics.expected(judged.objective[n], likely) for n in (name, COMB))
        over["over_comb_percent"] = 100.0 * float(statistics.gap_to_bound(mean, best))
    if judged.dual is not None and name in judged.dual.penalty:
        bound = judged.dual.mean(judged.objective)
        above = judged.dual.over(name, judged.objective[name])
        over["over_dual_percent"] = 100.0 * float(statistics.gap_to_bound(bound + above, bound))
    return over


def _against_rule(judged: Judged, name: str) -> dict[str, float]:
    more = judged.difference(name, judged.reference)
    return {
        "over_rule_per_day": more.mean,
        "over_rule_low": more.low,
        "over_rule_high": more.high,
        "over_rule_carriers": more.carriers,
    }


def _service(judged: Judged, name: str) -> dict[str, float]:
    measures, likely, days = judged.measures[name], judged.scenarios.probability, judged.days
    service, shape = measures.adequacy, measures.shape
    critical = measures.has_critical
    lasts_h = np.minimum(measures.service.first_critical_shed_h, 24.0 * days)
    none = float("nan")
    return {
        "shed_mwh_per_day": service.eens_mwh / days,
        "shed_mw_slots_per_day": service.shed_mw_slots / days,
        "eens_mwh": service.eens_mwh,
        "lolp": service.lolp_slots,
        "lolp_episodes": service.lolp_members,
        "lole_h_per_day": service.lole_h / days,
        "served_percent": 100.0 * service.served_share,
        "critical_served_percent": 100.0 * service.critical_served_share if critical else none,
        "critical_whole": service.p_critical_served if critical else none,
        "critical_lasts_h": statistics.expected(lasts_h, likely) if critical else none,
        "asidi_h_per_day": statistics.expected(measures.indices.asidi_h, likely) / days,
        "asifi_per_day": statistics.expected(measures.indices.asifi, likely) / days,
        "trapezoid_phi_per_h": statistics.expected(shape.phi_per_h, likely),
        "trapezoid_lambda": statistics.expected(shape.lambda_share, likely),
        "trapezoid_e_h": statistics.expected(shape.e_h, likely),
        "trapezoid_pi_per_h": statistics.expected(shape.pi_per_h, likely),
        "trapezoid_area": statistics.expected(shape.area_h, likely) / (24.0 * days),
    }


def _times(judged: Judged, name: str) -> dict[str, float]:
    trajectory = judged.trajectories[name]
    decisions = trajectory.cost.size
    return {
        "build_s": trajectory.build_seconds,
        "build_cpu_s": trajectory.build_cpu_seconds,
        "ms_per_decision": 1e3 * trajectory.seconds / decisions,
        "cpu_ms_per_decision": 1e3 * trajectory.cpu_seconds / decisions,
    }


def _ac(check: TrajectoryACCheck, days: float, likely: Floats) -> dict[str, float]:
    return {
        "ac_v_min_pu": check.lowest_pu,
        "ac_v_max_pu": check.highest_pu,
        "ac_outside_percent": 100.0 * check.outside_share(likely),
        "ac_overload_mva": check.worst_overload_mva,
        "ac_root_excess_mw": check.worst_root_excess_mw,
        "ac_loss_mwh_per_day": check.loss_mwh(likely) / days,
        "ac_unfunded_mwh_per_day": check.unfunded_mwh(likely) / days,
        "ac_excess_mwh_per_day": check.excess_mwh(likely) / days,
        "ac_not_converged_percent": 100.0 * check.not_converged_share(likely),
        "ac_cpu_s": check.cpu_seconds,
    }
