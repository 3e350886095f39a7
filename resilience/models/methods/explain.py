"""Why there is no plan: the names of the rows and slots that conflict."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from resilience.errors import InfeasibleError, ResilienceError, SolverError
from resilience.models.backends.conic import Conic
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import lower
from resilience.models.case_program import CaseProgram, horizon
from resilience.models.methods.answer import Deadline, MethodOptions
from resilience.models.structures import Cone

PHYSICAL_ROWS = ("balance.p", "balance.q", "line.voltage")
EXPLANATION_S = 10.0  # for all searches behind one error together
MAX_LISTED = 8  # groups of conflicting rows in an error


def infeasible(program: CaseProgram, names: Sequence[str] = ()) -> InfeasibleError:
    """The error for a problem that is known to have no plan, `names` being in conflict."""
    deadline = Deadline(EXPLANATION_S)
    conflicting = names or _linear_conflict(program, deadline) or _conic_conflict(program, deadline)
    return _named(program, conflicting)


def no_plan(
    program: CaseProgram, solver: str, options: MethodOptions, *, late: bool
) -> ResilienceError:
    """The error where a solver, named in words, ended without a plan.

    Out of time (`late`), which is not spent on explanations. Otherwise infeasible if that can be
    proven, else what conflicts in the model without losses.
    """
    kind = "cone" if program.standard.structures_of(Cone) else "linear"
    if late:
        return SolverError(
            f"{solver} found no plan within {options.time_limit:g} s",
            hint="raise --time-limit" + (" or use --method lp" if kind == "cone" else ""),
        )
    deadline = Deadline(EXPLANATION_S)
    names = _linear_conflict(program, deadline)
    if names:
        return _named(program, names)
    lossless = grouped(_linear_conflict(horizon(program.case, "lindistflow"), deadline))
    also = f"; without losses there is none, in conflict: {_shown(lossless)}" if lossless else ""
    return SolverError(
        f"{solver} found no plan, though the {kind} relaxation has one{also}",
        hint="make PV curtailable, widen the voltage band, or free a limit of the devices named",
    )


def _named(program: CaseProgram, names: Sequence[str]) -> InfeasibleError:
    return InfeasibleError(
        f"no plan satisfies the {program.microgrid.physics} model; in conflict: "
        + _shown(grouped(names)),
        hint="make PV curtailable, widen the voltage band, or free a limit of the devices named",
    )


def _shown(groups: Sequence[str]) -> str:
    more = f" and {len(groups) - MAX_LISTED} more" if len(groups) > MAX_LISTED else ""
    return ", ".join(groups[:MAX_LISTED]) + more or "no small set of rows could be named"


def grouped(names: Sequence[str]) -> list[str]:
    """Names that differ only in their label or slot as one, the fewest devices first.

    >>> rows = [f"balance.p[{bus}, 09:00]" for bus in range(1, 6)]
    >>> grouped([*rows, "bounds of pv.p[roof, 09:00]", "bounds of pv.p[roof, 10:00]"])
    ['bounds of pv.p[roof, 09:00 .. 10:00]', 'balance.p[1 .. 5 (5), 09:00]']
    """
    slots: dict[tuple[str, str], list[str]] = {}
    for name in names:
        row, _, place = name.rstrip("]").partition("[")
        label, _, slot = place.rpartition(", ")
        slots.setdefault((row, label or place), []).extend([slot] if label else [])
    alike: dict[tuple[str, str], list[str]] = {}
    for (row, label), of_row in slots.items():
        first, last = (of_row[0], of_row[-1]) if of_row else ("", "")
        when = f"{first} .. {last}" if len(of_row) > 1 else first
        alike.setdefault((row, when), []).append(label)
    groups = []
    for (row, when), labels in sorted(alike.items(), key=lambda item: len(item[1])):
        many = (
            f"{labels[0]} .. {labels[-1]} ({len(labels)})" if len(labels) > 2 else ", ".join(labels)
        )
        groups.append(f"{row}[{many}, {when}]" if when else f"{row}[{many}]".replace("[]", ""))
    return groups


def conflict(program: CaseProgram, solver: Highs, seconds: float = EXPLANATION_S) -> list[str]:
    """Names of what conflicts where `solver` found no point: rows and bounds that exclude each
    other, or else the balances and voltages that have to be missed.
    """
    standard = program.standard
    physical = [row.name for row in standard.form.stage.rows if row.name in PHYSICAL_ROWS]
    rows = np.concatenate([standard.rows(name).ravel() for name in physical])
    return solver.conflict(seconds / 2) or solver.missed(rows, seconds / 2)


def _linear_conflict(program: CaseProgram, deadline: Deadline) -> list[str]:
    """What conflicts without the cones: all relaxed, else with integers and modes held."""
    standard = program.standard
    relaxed = lower(standard, integer="none", modes={}, discs="outer")
    for lowered in (relaxed, lower(standard, discs="outer")):
        if deadline.late:
            break
        solver = Highs(lowered, time_limit=deadline.remaining_s)
        solver.update(program.vectors)
        if solver.solve().status == "infeasible":
            return conflict(program, solver, deadline.remaining_s)
    return []


def _conic_conflict(program: CaseProgram, deadline: Deadline) -> list[str]:
    if deadline.late:
        return []
    solver = Conic(program.standard, time_limit=deadline.remaining_s)
    solver.update(program.vectors)
    return solver.conflict()
