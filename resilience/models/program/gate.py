"""One gate for every answer: what does not hold is an error, never a number made to look right.

Whoever makes an answer shows it here first: `gap` for objective and bound, `check_costs` for cost
terms that have to add up, `check_audit` for what the referee found, and `status_of` for what it may
be called. Rounding is measured against
what the program itself can cost (`cost_scale`), so that a case in kW, in another currency or with
other prices is judged alike.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Literal, overload

import numpy as np

from resilience.arrays import Floats
from resilience.errors import CertificateError
from resilience.models.program.referee import Audit
from resilience.models.program.standard import Vectors
from resilience.tolerances import AUDIT_TOLERANCE, BOUND_TOLERANCE

FAULT = "this is a fault of the program or of the solver"
HINT = "report it with the case; another --method may do meanwhile"


def cost_scale(vectors: Vectors) -> float:
    """The most that any one column can cost or earn, $: what rounding is relative to.

    A column without a finite bound counts as one that may reach 1.
    """
    ends = [np.where(np.isfinite(end), np.abs(end), 1.0) for end in (vectors.lower, vectors.upper)]
    return float(np.max(np.abs(vectors.cost) * np.maximum(*ends), initial=0.0))


@overload
def rounding(objective: float, scale: float) -> float: ...


@overload
def rounding(objective: Floats, scale: float) -> Floats: ...


def rounding(objective: float | Floats, scale: float) -> float | Floats:
    """$ by which a proven bound may lie above an objective: the tolerances of two solvers.

    Args:
        objective: $, one or an array.
        scale: `cost_scale` of the program, $.
    """
    if isinstance(objective, np.ndarray):
        return BOUND_TOLERANCE * np.maximum(np.abs(objective), scale)
    return BOUND_TOLERANCE * max(abs(objective), scale)


def gap(objective: float, bound: float, scale: float) -> float:
    """(objective - bound) / |objective|; inf where there is no answer yet, or no bound.

    Below the rounding of the program's own costs, that takes the place of |objective|.

    Args:
        objective: of the answer, $; inf: there is none.
        bound: proven, $; -inf: there is none.
        scale: `cost_scale` of the program, $.

    Raises:
        CertificateError: the bound lies above the objective by more than rounding, or one of the
            two is no number.
    """
    if objective == math.inf or bound == -math.inf:
        return math.inf
    room = rounding(objective, scale)
    if not (math.isfinite(objective) and bound - objective <= room):
        raise CertificateError(
            f"a bound of {bound:.9g} $ is proven, but an answer costs {objective:.9g} $: {FAULT}",
            hint=HINT,
        )
    return (objective - bound) / max(abs(objective), room) if objective > bound else 0.0


def status_of(gap: float, wanted_gap: float) -> Literal["optimal", "feasible"]:
    """What an answer may be called: optimal only within the gap wanted of its proven bound.

    An answer that leaves facts of the model relaxed is so for a relaxation, and is shown with these
    words; its status is judged alike.

    Args:
        gap: relative, to the proven bound; inf without one.
        wanted_gap: asked for.
    """
    return "optimal" if gap <= wanted_gap else "feasible"


def check_costs(objective: float, terms: Mapping[str, float], scale: float) -> None:
    """Refuses an objective that is no number, or that its terms do not add up to.

    Args:
        objective: $.
        terms: $ of every part of it, credits negative.
        scale: `cost_scale` of the program, $.

    Raises:
        CertificateError: likewise.
    """
    total = sum(terms.values())
    if not (np.isfinite(objective) and abs(total - objective) <= rounding(objective, scale)):
        parts = ", ".join(f"{name} {cost:.9g}" for name, cost in terms.items())
        raise CertificateError(
            f"the objective is {objective:.9g} $, but its terms add up to {total:.9g} $ ({parts}): "
            + FAULT,
            hint=HINT,
        )


def check_energy(stated: Mapping[str, float], tabulated: Mapping[str, float]) -> None:
    """Refuses an energy balance that is not that of its tables.

    Args:
        stated: MWh by term.
        tabulated: the same, from the tables.

    Raises:
        CertificateError: likewise; the term that is farthest off is named.
    """
    largest = max((abs(mwh) for mwh in tabulated.values()), default=0.0)
    off = {name: abs(stated.get(name, math.nan) - mwh) for name, mwh in tabulated.items()}
    wrong = [name for name, mwh in off.items() if not mwh <= AUDIT_TOLERANCE * largest]
    if wrong:
        worst = max(wrong, key=lambda name: off[name])
        raise CertificateError(
            f"{worst} is {stated.get(worst, math.nan):.9g} MWh in the energy balance, and "
            f"{tabulated[worst]:.9g} MWh in the tables: {FAULT}",
            hint=HINT,
        )


@contextmanager
def of_file(path: Path) -> Iterator[None]:
    """What is refused inside was read from a file or folder, which is named.

    Raises:
        CertificateError: likewise.
    """
    try:
        yield
    except CertificateError as error:
        raise CertificateError(
            f"{path} contradicts itself: {error.message}",
            hint="it was changed or damaged, or written by a version with a fault; delete it and "
            "run the command again",
        ) from None


def names_of(relaxed: Iterable[str]) -> set[str]:
    """What is said to be left relaxed, as an audit calls it: `ess` of "ess: 1 of 2 modes ..."."""
    return {fact.partition(":")[0] for fact in relaxed}


def check_audit(audit: Audit, relaxed: Collection[str]) -> None:
    """Refuses a point that the referee does not pass.

    Args:
        audit: what the referee found.
        relaxed: names of what the answer says that it leaves relaxed; that may be open.

    Raises:
        CertificateError: something else is; the worst is named.
    """
    failed = {
        name: violation
        for name, violation in audit.worst.items()
        if not violation <= AUDIT_TOLERANCE and name not in relaxed
    }
    if failed:
        worst = max(failed, key=lambda name: failed[name])
        raise CertificateError(
            f"an answer violates {audit.where[worst]} by {failed[worst]:.2g} (scaled; allowed: "
            f"{AUDIT_TOLERANCE:g}): {FAULT}",
            hint=HINT,
        )
