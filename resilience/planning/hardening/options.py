"""What a case, or a user, offers to build: lines to strengthen, then units, then ties."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from resilience.case import Case
from resilience.case.schema import LineTable, PlanTable, StrengthTable
from resilience.errors import UsageError
from resilience.planning.hardening.draws import StrengthOption
from resilience.planning.hardening.sites import Built, ties_of, units_of


def options_of(
    case: Case,
    fallible: Sequence[str],
    *,
    factor: float | None = None,
    cost: float = 1.0,
    lines: Sequence[str] | None = None,
) -> tuple[StrengthOption | Built, ...]:
    """The options of every line that can be strengthened, units of every site, and ties.

    Args:
        case: its `[[line]] harden`, or else `[plan] harden`, says what there is of lines, and its
            `[[plan.site]]` of units, its `[[line]] tie_cost` of ties.
        fallible: lines that the storm may break.
        factor: in place of what the case says, one option for every line: so many times as strong.
        cost: of that option, $.
        lines: those alone, of the lines that the storm may break.

    Raises:
        UsageError: nothing to choose, a line that the storm does not break, one that is
            switchable, or numbers out of range.
    """
    if factor is not None and not (1.0 < factor < math.inf and 0.0 <= cost < math.inf):
        raise UsageError(
            f"factor {factor:g}, cost {cost:g} $; allowed: a factor above 1, a cost of 0 or more",
            hint="factor 1.5 is half as strong again",
        )
    strange = [name for name in lines or () if name not in fallible]
    if strange:
        raise UsageError(
            f"line {', '.join(strange)} cannot be strengthened; allowed: {', '.join(fallible)}",
            hint="cables, and lines that the storm does not break, have nothing to gain",
        )
    stated = {line.name: line for line in case.line}
    plan = case.plan or PlanTable()
    options: list[StrengthOption] = []
    for name in fallible:
        table = stated.get(name, LineTable(name=name))
        if (lines is not None and name not in lines) or table.switchable:
            continue
        if factor is not None:
            options.append(StrengthOption(name, factor, cost, plan.life_years))
        else:
            options += [_option(name, way, plan) for way in table.harden or plan.harden]
    others: list[Built] = [*units_of(case), *ties_of(case)]
    if not options and not others:
        raise UsageError(
            f"case {case.name!r} offers nothing to build",
            hint="state harden = [{ factor = 1.5, cost = 40000 }] in [plan] or in [[line]], or "
            "[[plan.site]], or give --factor and --cost for all lines",
        )
    return (*options, *others)


def _option(line: str, table: StrengthTable, plan: PlanTable) -> StrengthOption:
    factor = math.inf if table.factor is None else table.factor
    return StrengthOption(line, factor, table.cost, table.life_years or plan.life_years)


def strengths(options: Iterable[StrengthOption | Built]) -> list[StrengthOption]:
    """Those of lines alone."""
    return [option for option in options if isinstance(option, StrengthOption)]
