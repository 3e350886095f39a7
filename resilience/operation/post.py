"""Where an operator stands: the setting of a case in operation, and what a log says of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from resilience.case import Case, load_case
from resilience.digest import digest_of
from resilience.dispatch.registry import Factory, LearnedEntry
from resilience.fragility.draw import sample_case
from resilience.fragility.outages.files import load_scenarios
from resilience.fragility.outages.scenarios import Scenarios
from resilience.models.microgrid import Physics
from resilience.operation.state import fallible_names
from resilience.simulation.forecast import ForecastError
from resilience.simulation.setting import CASE, Setting
from resilience.simulation.world import World, microgrid_with_fallible_lines

WITHOUT_EFFECT = {"description", "path", "source", "rebuild"}
"""Fields of a case that no decision depends on."""


class Post(NamedTuple):
    """What an operator is told of its task; see `Operator`."""

    method: str
    fallback: str
    physics: Physics
    believe: Scenarios | str | Path | None
    forecast_error: ForecastError | None
    end_value_per_mwh: float | None


def operating_setting(case: Case | str | Path, post: Post) -> tuple[Setting, tuple[str, ...]]:
    """The setting of a case in operation, and the lines and units that may be out.

    Raises:
        CaseError, UsageError: as `load_case`, `load_scenarios`, `sample_case` or `World.build`.
    """
    case = case if isinstance(case, Case) else load_case(case)
    believed = post.believe
    if believed is not None and not isinstance(believed, Scenarios):
        believed = load_scenarios(believed, case)
    process = sample_case(case, 1, 0) if believed is None else believed
    world = World.build(
        microgrid_with_fallible_lines(case, process, post.physics),
        process.chosen(np.zeros(1, np.intp)),
        end_value_per_mwh=post.end_value_per_mwh,
        believed=CASE if believed is None else believed,
    )
    setting, error = replace(world.setting, numbers=np.zeros(1, np.intp)), post.forecast_error
    if error is not None:
        correlation = error.correlation_of(case.step_min)
        setting = replace(setting, error_correlation=correlation, error_law=error)
    return setting, fallible_names(world.microgrid, process.lines)


def head_of(setting: Setting, post: Post, make: Factory) -> Mapping[str, Any]:
    """What the first line of a log says: all that its decisions depend on."""
    believed = setting.believed
    return {
        "log": "resilience operate",
        "version": version("resilience"),
        "case": setting.case.name,
        "case_digest": digest_of(setting.case, WITHOUT_EFFECT),
        "method": post.method,
        "policy": make.digest if isinstance(make, LearnedEntry) else None,
        "fallback": post.fallback,
        "physics": post.physics,
        "believes": digest_of(believed) if isinstance(believed, Scenarios) else believed,
        "forecast_error": None if post.forecast_error is None else str(post.forecast_error),
        "end_value_per_mwh": setting.end_value_per_mwh,
    }
