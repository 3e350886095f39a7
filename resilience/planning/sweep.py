"""`sweep`: one plan per combination of values, as a table."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from resilience.case import Case, load_case
from resilience.errors import InfeasibleError, UsageError, did_you_mean, shortened
from resilience.planning.solve import solve

if TYPE_CHECKING:
    import pandas as pd

RESULTS = (
    "status", "objective", "operating_cost", "expected_operating_cost", "terminal_credit",
    "expected_terminal_credit", "bound", "gap", "shed_mwh", "expected_shed_mwh",
    "shed_probability", "seconds",
)  # fmt: skip
"""Keys of a plan's summary that are columns, as far as the plan has them."""
_LISTS = ("line", "tank")


def sweep(
    case: Case | str | Path,
    values: Mapping[str, Iterable[Any]],
    method: str = "minlp",
    *,
    workers: int = 1,
    **options: Any,
) -> pd.DataFrame:
    """Plans for every combination of values: what a larger battery, or a dearer grid, changes.

    `sweep(case, {"ess.ess1.e_mwh": [2.0, 4.0, 8.0], "load.clinic.p_max_mw": [0.5, 1.0]})` solves
    six times. All cases are checked before the first is solved.

    Args:
        case: a case, its file, or the name of an installed one.
        values: by key. `KIND.NAME.KEY` is a key of a device, of a `line` or of a `tank`; any
            other is one that `Case.replace` takes, as `outages` or `slots`.
        method: as for `solve`.
        workers: processes that solve at once.
        options: for `solve`.

    Returns:
        A row per combination, the last key varying fastest: a column per key, then status,
        objective and costs in $, shed energy in MWh and so on, as far as plans of the method have
        them. Where there is no plan, the status is infeasible and all else empty.

    Raises:
        UsageError: no such device, line or key, no values, or options that `solve` does not take.
        CaseError: a combination is no valid case.
        SolverError: no plan was found in time.
    """
    import pandas as pd
    from joblib import Parallel, delayed

    base = case if isinstance(case, Case) else load_case(case)
    columns = {key: _listed(key, entries) for key, entries in values.items()}
    if workers < 1:
        raise UsageError(f"{workers} workers; allowed: 1 or more", hint="workers=2 solves two")
    combinations = list(itertools.product(*columns.values()))
    cases = [_changed(base, dict(zip(columns, row, strict=True))) for row in combinations]
    call = delayed(_results)
    rows = Parallel(n_jobs=workers)(call(changed, method, options) for changed in cases)
    inputs = pd.DataFrame(
        {key: pd.Series([row[k] for row in combinations]) for k, key in enumerate(columns)}
    )
    results = pd.DataFrame(rows)
    order = [key for key in RESULTS if key in results]
    return pd.concat([inputs, results[order]], axis=1)


def _listed(key: str, entries: Iterable[Any]) -> list[Any]:
    if isinstance(entries, str | Mapping) or not isinstance(entries, Iterable):
        raise UsageError(
            f"values of {key}: {shortened(repr(entries))}; allowed: a list of them",
            hint=f'sweep(case, {{"{key}": [...]}})',
        )
    listed = list(entries)
    if not listed:
        raise UsageError(f"no values of {key}; allowed: one or more", hint="leave the key out")
    return listed


def _changed(case: Case, values: Mapping[str, Any]) -> Case:
    """The case with these values, keys of one device or line changed at once."""
    alone: dict[str, Any] = {}
    tables: dict[tuple[str, str], dict[str, Any]] = {}
    for path, value in values.items():
        kind, _, tail = path.partition(".")
        name, _, key = tail.rpartition(".")
        if not tail:
            alone[path] = value
        elif not name or kind not in (*case.devices, *_LISTS):
            kinds = [*case.devices, *_LISTS]
            raise UsageError(
                f"key {path!r} of a sweep; allowed: KIND.NAME.KEY, or a key of the case",
                did_you_mean(kind, kinds) if name else "ess.ess1.e_mwh is the size of storage ess1",
            )
        else:
            tables.setdefault((kind, name), {})[key] = value
    changed = case.replace(**alone) if alone else case
    for (kind, name), changes in tables.items():
        if kind == "line":
            changed = changed.with_line(name, **changes)
        elif kind == "tank":
            changed = changed.with_tank(name, **changes)
        else:
            changed = changed.with_device(kind, name, **changes)
    return changed


def _results(case: Case, method: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """What a plan's summary says, or that there is none."""
    try:
        summary = solve(case, method, **options).summary()
    except InfeasibleError:
        return {"status": "infeasible"}
    return {key: summary[key] for key in RESULTS if key in summary}
