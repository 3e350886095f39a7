"""What counts as rounding, in one table: physical and solver tolerances that modules share.

From fine to coarse each leaves room for the one before: solvers satisfy rows to 1e-8 (Ipopt,
Clarabel) or 1e-7 (HiGHS), a relaxed structure may be open by 1e-6, and an audit passes at 1e-5.
A *scaled* violation is relative to 1 + the largest term of its row, 1 + its bound, or what its
structure is about (`models.program.referee`). Guards that only keep a quotient finite stay where
they are used.
"""

AUDIT_TOLERANCE = 1e-5
"""Scaled violation up to which an audited plan is called clean: ten times what may stay open."""

BOUND_TOLERANCE = 1e-6
"""By how much a proven bound may lie above an objective, relative to the objective or to the most
that one quantity of the program can cost: solvers meet optimality to 1e-7 or 1e-8."""

INTEGRALITY_TOLERANCE = 2e-6
"""Distance from a whole number, in units of an integer column, that is rounded off in a plan;
HiGHS and SCIP leave up to 1e-6."""

RELAXATION_TOLERANCE = 1e-6
"""Scaled violation up to which a relaxed structure (split, cone, disc, piecewise) or an integer
holds, and a bound equals an objective: HiGHS meets rows to 1e-7, so more is no rounding."""

CONFLICT_TOLERANCE = 1e-6
"""Scaled violation from which a row takes part in a conflict, where an infeasible program is
relaxed to find one, and fixed columns contradict each other."""

CROSSED_BOUNDS_TOLERANCE = 1e-9
"""Excess of a lower bound over its upper one, relative to 1 + |lower|, that is rounding of data;
beyond, nothing needs to be solved to see that a program is infeasible."""

NLP_TOLERANCE = 1e-8
"""Ipopt's stopping and constraint tolerance: its points must pass at `RELAXATION_TOLERANCE`."""

COMPLEMENTARITY_TOLERANCE = 1e-7
"""Ipopt's; with its own 1e-4 a warm start may stop 4e-5 above the optimum, relatively."""

REDUCED_COST_TOLERANCE = 1e-9
"""$ per unit of a column: what a column without a bound may have by rounding, where duality says
zero; taken at its word it would make a cut worthless."""

PLAN_GAP = 1e-3
"""Relative gap at which the search for a plan may stop: far below the error of any forecast."""

SCENARIO_GAP = 1e-4
"""The same over scenarios: finer than the value of a stochastic solution, which it is to show."""

EXACT_GAP = 1e-5
"""Relative gap that counts as a proof of global optimality; SCIP's own tolerances (1e-6) are not
far below."""

AC_LIMIT_TOLERANCE = 1e-6
"""pu, MVA, degrees or MW beyond a limit that count as none in an AC check: what a power flow leaves
open."""

SHED_TOLERANCE_MW = 1e-6
"""Shedding of a load in a slot up to this is a solver's rounding, in measures of service."""

SHED_TOLERANCE_MWH = 1e-6
"""Shedding of a scenario up to this is a solver's rounding, in the probability of shedding."""

AT_LIMIT_TOLERANCE = 1e-4
"""MW, MWh or pu from its limit at which a value is at it, and MW of shedding that need a reason: a
plan within its gap leaves sources a little below the limits that an optimum would reach."""

DRAWN_TOLERANCE_MW = 1e-4
"""Shedding or curtailment up to this is not drawn: no pixel would show it."""

PERFORMANCE_TOLERANCE = 1e-9
"""Share of demand: served this close to normal is normal, so that sums of shares may be rounded."""

COST_TOLERANCE = 1e-9
"""A difference of costs this small, relative to the cost, is rounding, and there is nothing to
compare."""

POWER_TOLERANCE_MW = 1e-12
"""Power in a simulated step up to this is none: some hundred roundings of a double at 10 MW."""

PRICE_TOLERANCE = 1e-12
"""$ per MW: two prices together must earn more than this for importing and exporting at once."""

PRICE_DIGITS = 10
"""Digits, of the largest price, in which prices of one tier of the merit order agree."""

PROBABILITY_TOLERANCE = 1e-12
"""Rounding of a sum of probabilities: 0.1 * 9 is less than 0.9."""

INPUT_TOLERANCE = 1e-9
"""By how much numbers of a case file may miss each other: a sum of decimals is not exact."""

SLOT_TOLERANCE = 1e-9
"""Slots: a duration this little over a whole number of slots is that number, 0.1 / 0.05 say."""
