"""A comparison as files, in a folder that appears whole or not at all.

summary.json          what `--json` prints, and `kind`
report.parquet, .csv  a row per method, see `columns.COLUMNS`
differences.parquet   a row per two methods
episodes.parquet      $ of every episode: a column per method, and the bound
per_episode.parquet   a row per method and episode
per_day.parquet       a row per method, episode and day
slots/NAME.parquet    a row per episode and slot: cost, energy, and the power of every device
trajectories/NAME.npz the same as arrays, exactly
case.toml, scenarios.npz   what was run
parts/                finished parts, if the comparison was made with `out`
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from resilience.case import case_text
from resilience.evaluation.columns import AC_COLUMNS, COLUMNS
from resilience.evaluation.judged import Judged
from resilience.evaluation.measures import statistics
from resilience.results import COMPARISON, replacing, write_readme, write_summary
from resilience.simulation.trajectory_file import save_trajectories

if TYPE_CHECKING:
    import pandas as pd


FILES = {
    "summary.json": "all of the comparison: what `--json` prints",
    "report.csv, report.parquet": "a row per method",
    "differences.parquet": "a row per two methods: $/day, 95 % interval, whether it excludes zero",
    "episodes.parquet": "$ of every episode: a column per method, and the bound",
    "per_episode.parquet": "a row per method and episode: $, MWh, shares and indices",
    "per_day.parquet": "a row per method, episode and day: $ of operation, MWh shed and stored",
    "slots/METHOD.parquet": "a row per episode and slot: $, MWh, and MW of every device",
    "trajectories/METHOD.npz": "the same as arrays, exactly; see resilience.Trajectory",
    "case.toml": "the case as it was run; it loads back",
    "scenarios.npz": "the storms: which line or unit is out when, and how likely that is",
    "parts": "finished parts, with which an interrupted comparison goes on",
}
"""What is in every file of a report."""


def save_report(
    judged: Judged, frame: pd.DataFrame, summary: Mapping[str, Any], folder: Path
) -> Path:
    """Writes all files; an earlier report is replaced, finished parts are kept.

    Args:
        judged: the comparison.
        frame: a row per method.
        summary: what stands in `summary.json`.
        folder: where.
    """
    import pandas as pd

    with replacing(folder, COMPARISON) as target:
        frame.to_parquet(target / "report.parquet")
        frame.to_csv(target / "report.csv")
        judged.differences().to_parquet(target / "differences.parquet")
        pd.DataFrame({**judged.objective, "bound": judged.bound}).to_parquet(
            target / "episodes.parquet"
        )
        per_episode(judged).to_parquet(target / "per_episode.parquet")
        per_day(judged).to_parquet(target / "per_day.parquet")
        (target / "slots").mkdir()
        units = [unit.name for unit in judged.case.ess]
        tanks = [tank.name for tank in judged.case.tank]
        for name, trajectory in judged.trajectories.items():
            frame = trajectory.frame(units, tanks)
            frame.to_parquet(target / "slots" / f"{name}.parquet")
        save_trajectories(judged.trajectories, target)
        (target / "case.toml").write_text(case_text(judged.case), encoding="utf-8")
        judged.scenarios.save(target / "scenarios.npz")
        write_readme(target, COMPARISON, FILES, {**COLUMNS, **AC_COLUMNS})
        write_summary(target, COMPARISON, summary)
    return folder


def per_episode(judged: Judged) -> pd.DataFrame:
    """A row per method and episode: $, shares and indices of `metrics.Service` and others."""
    import pandas as pd

    rule, n = judged.objective[judged.reference], judged.scenarios.n
    tables = []
    for name, measures in judged.measures.items():
        columns = {
            "method": np.full(n, name),
            "episode": np.arange(n),
            "probability": judged.scenarios.probability,
            "objective": measures.objective,
            "operating_cost": measures.trajectory.cost.sum(0),
            "end_energy_mwh": measures.trajectory.credited_mwh,
            "bound": judged.bound,
            "gap_percent": 100.0 * statistics.gap_to_bound(measures.objective, judged.bound),
            "score": statistics.score(measures.objective, rule, judged.bound),
            "asifi": measures.indices.asifi,
            "asidi_h": measures.indices.asidi_h,
        }
        columns |= {key: np.asarray(value) for key, value in vars(measures.service).items()}
        if not measures.has_critical:
            del columns["critical_served_share"], columns["first_critical_shed_h"]
        columns |= {f"trapezoid_{key}": value for key, value in vars(measures.shape).items()}
        tables.append(pd.DataFrame(columns))
    return pd.concat(tables, ignore_index=True)


def per_day(judged: Judged) -> pd.DataFrame:
    """A row per method, episode and day: operating cost, shed energy, energy at both ends."""
    import pandas as pd

    day = judged.world.day
    first = np.flatnonzero(np.diff(day, prepend=day[0] - 1))
    tables = []
    for name, measures in judged.measures.items():
        stored = measures.trajectory.energy.sum(0)
        days, n = measures.daily_cost.shape
        columns = {
            "method": np.full(days * n, name),
            "episode": np.repeat(np.arange(n), days),
            "day": np.tile(np.arange(days), n),
            "operating_cost": measures.daily_cost.T.ravel(),
            "shed_mwh": measures.daily_shed_mwh.T.ravel(),
            "energy_start_mwh": stored[first].T.ravel(),
        }
        tables.append(pd.DataFrame(columns))
    return pd.concat(tables, ignore_index=True)
