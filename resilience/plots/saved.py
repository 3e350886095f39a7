"""Pictures of what a folder holds: a plan, survival, training, or a comparison and its storms."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from resilience.errors import UsageError
from resilience.files import check_picture
from resilience.plots.learning import plot_learning
from resilience.plots.plan import plot_plan
from resilience.plots.report import plot_report
from resilience.plots.scenario_plan import plot_scenario_plan
from resilience.plots.storm import plot_storm
from resilience.plots.survival import plot_survival
from resilience.results import settle, stated_kind
from resilience.rl.training.curves import run_folders

if TYPE_CHECKING:
    from resilience.planning.plan import Plan
    from resilience.planning.scenarios.plan import ScenarioPlan


def draw_run(
    run: Path,
    out: Path | None = None,
    *,
    method: str | None = None,
    episode: int | None = None,
    day: str | None = None,
) -> tuple[Path, str]:
    """Draws what a folder holds: a plan, survival, training, comparison, or with `method` a storm.

    Args:
        run: the folder.
        out: picture file; in the folder if omitted.
        method: dispatchers, with commas.
        episode: see `plot_storm`.
        day: the same, as text.

    Returns:
        The picture, and the command that draws one storm where a comparison was drawn.

    Raises:
        UsageError: the folder holds nothing that can be drawn, or not what is asked for.
        FileError: the picture cannot be written.
    """
    from resilience.evaluation.comparison import is_comparison, load_comparison
    from resilience.evaluation.survival import holds_survival, load_survival
    from resilience.evaluation.verdict import ranked
    from resilience.planning.plan import load_plan
    from resilience.planning.scenarios.files import holds_scenario_plan, load_scenario_plan

    if out is not None:
        check_picture(out)
    settle(run)
    if run_folders(run):
        _refuse(run, method=method, episode=episode, day=day)
        target = out or run / "learning.png"
        plot_learning(run, target)
        return target, ""
    if holds_survival(run):
        _refuse(run, method=method, episode=episode, day=day)
        target = out or run / "survival.png"
        plot_survival(load_survival(run), target)
        return target, ""
    if not is_comparison(run):
        _refuse(run, method=method, episode=episode, day=day)
        target = out or run / "plan.png"
        draw_plan(load_scenario_plan(run) if holds_scenario_plan(run) else load_plan(run), target)
        return target, ""
    if method is None and (episode is not None or day is not None):
        raise UsageError(
            "an episode or a day without a method; allowed: --method with them",
            hint="the comparison as a whole is drawn without --episode and --day",
        )
    compared = load_comparison(run)
    if method is None:
        target = out or run / "report.png"
        plot_report(compared, target)
        best = ",".join(ranked(compared)[:2])
        return target, f"resilience plot {run} --method {best}"
    names = [name.strip() for name in method.split(",") if name.strip()]
    target = out or run / f"storm-{'-'.join(names)}.png"
    plot_storm(compared, names, episode, _day(day), target)
    return target, ""


MAP_STEM = "map"
"""Name of a picture, without its suffix, that is to be the map of the feeder."""


def draw_plan(plan: Plan | ScenarioPlan, path: Path) -> None:
    """Draws a plan of either kind, or its map where the picture is called `map`.

    Raises:
        UsageError: a suffix that is no picture format.
    """
    from resilience.planning.plan import Plan

    if path.stem == MAP_STEM:
        from resilience.plots.feeder.picture import plot_map

        plot_map(plan, path)
    elif isinstance(plan, Plan):
        plot_plan(plan, path)
    else:
        plot_scenario_plan(plan, path)


def _refuse(run: Path, **options: object) -> None:
    wrong = [f"--{name}" for name, value in options.items() if value is not None]
    kind = "a training" if run_folders(run) else f"a {stated_kind(run) or 'plan'}"
    if wrong and (kind == "a training" or (run / "summary.json").is_file()):
        raise UsageError(
            f"{', '.join(wrong)}: {run} holds {kind}, no comparison",
            hint="`resilience compare --out` writes a folder whose storms can be drawn",
        )


def _day(text: str | None) -> int | str | None:
    return int(text) if text is not None and text.isdecimal() else text
