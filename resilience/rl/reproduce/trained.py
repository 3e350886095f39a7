"""Trainings on disk, called after all that they depend on: what is there is not trained again."""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path
from typing import Any

from resilience.case import Case
from resilience.case.days import training
from resilience.digest import digest_of
from resilience.progress import phase
from resilience.rl.checkpoint import case_digest
from resilience.rl.reproduce.experiments import Contender, Effort
from resilience.rl.training.curves import LAST_FILE, RESULT_FILE


def trained_runs(
    case: Case, contender: Contender, scale: Effort, seeds: int, folder: Path
) -> list[Path]:
    """The run of every seed; trained where it is missing, resumed where it was interrupted.

    Args:
        case: the case, over any horizon.
        contender: who learns.
        scale: how long.
        seeds: how many, from 0.
        folder: where runs are.
    """
    runs = seed_folders(case, contender, scale, seeds, folder)
    for seed, run in enumerate(runs):
        if not is_finished(run):
            _train(case, contender, training_facts(contender, scale), seed, run)
    return runs


def is_finished(run: Path) -> bool:
    """Whether a training into this folder came to its end."""
    return (run / RESULT_FILE).is_file()


def seed_folders(
    case: Case, contender: Contender, scale: Effort, seeds: int, folder: Path
) -> list[Path]:
    """Where the run of every seed is, or will be; arguments as for `trained_runs`."""
    ground = training(case)
    facts = [
        version("resilience"),
        case_digest(case),
        dict(ground.profiles),
        ground.start,
        contender.dispatcher,
        training_facts(contender, scale),
    ]
    root = folder / f"{contender.dispatcher}-{digest_of(facts)[:12]}"
    return [root / f"seed-{seed}" for seed in range(seeds)]


def training_facts(contender: Contender, scale: Effort) -> dict[str, Any]:
    """The settings of a training, and its budget where they do not state one."""
    settings = dict(contender.settings)
    if contender.settings.get("variant") == "paper":
        return {"settings": settings | {"episodes": scale.episodes}}
    return {"settings": settings, "budget_s": scale.budget_s}


def _train(case: Case, contender: Contender, facts: dict[str, Any], seed: int, run: Path) -> None:
    from resilience.extras import need

    need("learn", "training", "torch", "safetensors")
    from resilience.rl.training.train import train

    budget = {key: value for key, value in facts.items() if key != "settings"}
    with phase(f"training {contender.label} for {case.name}, seed {seed}"):
        train(
            case,
            contender.dispatcher,
            out=run,
            resume=(run / LAST_FILE).is_file(),
            seeds=(seed,),
            **budget,
            **facts["settings"],
        )
