"""Pictures of a reproduction: learning curves, and storage on a day with an outage."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from resilience.evaluation.comparison import load_comparison
from resilience.plots.learning import plot_learning
from resilience.plots.storm import plot_storm

if TYPE_CHECKING:
    from resilience.rl.reproduce.run import Reproduction


def plot_reproduction(result: Reproduction) -> list[Path]:
    """Draws what is not drawn yet; the pictures, beside what they show."""
    pictures = []
    for curve in result.learning:
        runs = result.folder / curve.runs
        pictures.append(runs / "learning.png")
        if not pictures[-1].is_file():
            plot_learning(runs, pictures[-1])
    storm = result.storm
    pictures.append(result.folder / f"{storm.folder}.png")
    if not pictures[-1].is_file():
        compared = load_comparison(result.folder / storm.folder)
        plot_storm(compared, storm.label, episode=1, day=storm.day, path=pictures[-1])
    return pictures
