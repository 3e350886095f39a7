"""Episodes of the training ground, and the worlds in which the same happens."""

from __future__ import annotations

import numpy as np

from resilience.rl.ground.episodes import Episodes, EpisodeSampler
from resilience.simulation.forecast import Outlook
from resilience.simulation.world import World, microgrid_with_fallible_lines


def world_of(sampler: EpisodeSampler, episodes: Episodes, k: int) -> World:
    """The world in which what happens is episode k of a batch, on its days of the calendar."""
    first = sampler.case.window.time(int(episodes.first[k]))
    case = sampler.case.replace(start=first, slots=episodes.slots)
    storm = episodes.scenarios.chosen([k])
    outlook = None
    if episodes.error:
        error = np.array([error[:, [k]] for error in episodes.error.values()])
        assert episodes.setting.error_correlation is not None
        outlook = Outlook(tuple(episodes.error), error, episodes.setting.error_correlation)
    return World.build(
        microgrid_with_fallible_lines(case, storm, "copperplate"),
        storm,
        end_value_per_mwh=episodes.setting.end_value_per_mwh,
        outlook=outlook,
        known_centre=episodes.setting.known_centre,
    )
