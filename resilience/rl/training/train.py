"""`train`: a learning dispatcher from a case, one run per seed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from resilience.case import Case, load_case
from resilience.errors import UsageError, check_range
from resilience.rl.training.run import Run
from resilience.rl.training.trainer import TrainingOptions


def train(  # noqa: PLR0913 every one is an option of the command line
    case: Case | str | Path = "ieee33",
    method: str = "apg",
    *,
    out: str | Path | None = None,
    resume: bool = False,
    seeds: Sequence[int] = (0,),
    budget_s: float = 120.0,
    iterations: int | None = None,
    band: str | None = None,
    baseline: str = "rule",
    days: int = 1,
    forecast_error: str = "none",
    known_centre: bool = True,
    patience: int = 0,
    device: str = "cpu",
    **settings: Any,
) -> list[Run]:
    """Trains a policy per seed on the days before the test days, and judges it on days of neither.

    Args:
        case: a case, its file, or the name of an installed one.
        method: name of the algorithm, see `resilience.rl.algorithms.registry.ALGORITHMS`.
        out: folder of the run, with several seeds of `seed-0`, `seed-1`, ... in it; nothing is
            kept if omitted.
        resume: goes on with what is there; of several seeds, begins those that are not there.
        seeds: of weights, episodes and noise.
        budget_s: CPU-seconds of one thread for every seed, turned into iterations once.
        iterations: how many, in place of a budget.
        band: how outputs become MW: anchors or affine; the algorithm's own if omitted.
        baseline: whose cost rewards are relative to: none, idle or rule.
        days: of an episode.
        forecast_error: as in `compare`.
        known_centre: as in `compare`.
        patience: validations without a better policy after which training ends; 0: never.
        device: cpu or cuda.
        settings: of the algorithm.

    Returns:
        A run per seed.

    Raises:
        UsageError: an unknown algorithm or setting, or a folder that does not fit.
        SolverError: training broke down before there was a policy.
    """
    case = case if isinstance(case, Case) else load_case(case)
    if not seeds or len(set(seeds)) < len(seeds):
        raise UsageError(
            f"seeds {list(seeds)}; allowed: one or more, each once", hint="--seeds 0,1,2"
        )
    for seed in seeds:
        check_range("seed", seed, 0, 2**63 - 1, hint="0, 1 and 2 are as good as any")
    options = TrainingOptions(
        method=method,
        iterations=iterations,
        budget_s=budget_s,
        band=band,
        baseline=baseline,
        days=days,
        forecast_error=forecast_error,
        known_centre=known_centre,
        patience=patience,
        device=device,
        settings=settings,
    )
    runs = []
    for seed in seeds:
        folder = None if out is None else Path(out)
        if folder is not None and len(seeds) > 1:
            folder = folder / f"seed-{seed}"
        # Of several, those that never began are begun.
        goes_on = resume and (len(seeds) == 1 or (folder is not None and folder.is_dir()))
        runs.append(Run(case, replace(options, seed=seed), folder, goes_on).train())
    return runs
