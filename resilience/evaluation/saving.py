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

EPISODE_COLUMNS = {
    "method": "who operates",
    "episode": "its number, from 0",
    "probability": "of the episode",
    "objective": "$ of the whole episode: operating cost less the worth of the energy left",
    "operating_cost": "$ of the whole episode",
    "end_energy_mwh": "stored energy left whose worth is credited, MWh",
    "bound": "$ that the clairvoyant optimum costs",
    "gap_percent": "(objective - bound) / |bound|, %",
    "score": "(rule 0.9 - objective) / (rule 0.9 - bound)",
    "asifi": "interruptions of the average MW",
    "asidi_h": "hours without supply of the average MW",
    "ens_mwh": "energy not served, MWh",
    "weighted_ens_mwh": "the same, each load's energy times its priority",
    "shed_mw_slots": "MW shed, added up over the slots",
    "shed_h": "hours in which anything is shed",
    "shed_slot_share": "share of the slots in which anything is shed",
    "served_share": "energy served / energy demanded",
    "critical_served_share": "the same of the critical loads; missing where the case has none",
    "first_critical_shed_h": "hours until a critical load is first shed; inf: never; likewise",
    "trapezoid_phi_per_h": "how fast service drops, 1/h",
    "trapezoid_lambda_share": "how deep, share of the demand",
    "trapezoid_e_h": "how long it stays there, h",
    "trapezoid_pi_per_h": "how promptly it comes back, 1/h",
    "trapezoid_area_h": "share of the demand served, added up over the hours, h",
    "trapezoid_onset_h": "hours until the drop begins; none without one",
    "trapezoid_dropped": "whether service drops at all",
    "trapezoid_restored": "whether it is back before the end",
}
DAY_COLUMNS = {
    "method": "who operates",
    "episode": "its number, from 0",
    "day": "its number, from 0",
    "operating_cost": "$ of the day",
    "shed_mwh": "energy not served, MWh",
    "energy_start_mwh": "stored in all units when the day begins, MWh",
}
PAIR_COLUMNS = {
    "method": "who is compared",
    "other": "with whom",
    "per_day": "$/day that the method costs more than the other",
    "low": "lower end of its 95 % interval, $/day",
    "high": "upper end, $/day",
    "excludes_zero": "whether the difference is no luck",
    "carriers": "least number of day-episodes that carry 80 % of it",
    "few_events": "whether these are few",
}
"""Of the tables of a report beside `report` itself."""


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
        write_readme(
            target,
            COMPARISON,
            FILES,
            {
                "report": {**COLUMNS, **AC_COLUMNS},
                "differences": PAIR_COLUMNS,
                "per_episode": EPISODE_COLUMNS,
                "per_day": DAY_COLUMNS,
            },
        )
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
