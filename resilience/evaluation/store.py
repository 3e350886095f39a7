"""Finished parts of a comparison on disk, so that an interrupted one goes on where it stopped.

A part is called after a digest of all that it depends on: the case, its storms and forecast errors,
the settings of the world, the method, and the code. Whatever is different has another name, so a
folder may be used for any comparison, and one with a further method does the rest only. A part that
is damaged, was changed, or stands under the name of another counts as missing.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from resilience.digest import code, digest_of
from resilience.dispatch.registry import DISPATCHERS, Factory
from resilience.errors import CertificateError, UsageError
from resilience.evaluation.comparison import check_bound
from resilience.fragility.outages.scenarios import Scenarios
from resilience.models.case_program import case_cost_scale
from resilience.models.program.gate import HINT, of_file
from resilience.results import PARTS_FOLDER
from resilience.simulation.audit import check_trajectory
from resilience.simulation.trajectory import Trajectory
from resilience.simulation.trajectory_file import load_trajectory, save_trajectory

if TYPE_CHECKING:
    from resilience.simulation.world import World

WITHOUT_EFFECT = {
    "description", "path", "source", "rebuild", "simulator", "probability", "seed", "process",
    "represents",
}  # fmt: skip
"""Fields that no trajectory depends on."""


class Store:
    """Parts in a folder.

    Args:
        folder: that of the report; parts are kept in a folder of their own within.

    Attributes:
        damaged: how many parts could not be read.
    """

    def __init__(self, folder: Path) -> None:
        self.report_folder, self.folder = folder, folder / PARTS_FOLDER
        self.damaged = 0

    def get(self, name: str, world: World, make: Factory | None) -> Trajectory | None:
        """A part that was kept; None where there is none, or one that cannot be read.

        Raises:
            CertificateError: it can be read, but cannot have happened; its file is named.
        """
        path = self.part_file(name, world, make)
        if not path.is_file():
            return None
        try:
            trajectory = load_trajectory(path, key=path.stem)
        except UsageError:
            self.damaged += 1
            return None
        with of_file(path):
            check_trajectory(world, trajectory)
            if make is None:
                _check_proven(world, trajectory)
        return trajectory

    def put(self, trajectory: Trajectory, world: World, make: Factory | None) -> None:
        """Keeps a part: its file appears whole or not at all."""
        path = self.part_file(trajectory.name, world, make)
        save_trajectory(trajectory, path, key=path.stem)

    def part_file(self, name: str, world: World, make: Factory | None) -> Path:
        """The file of a part, called after all that its numbers depend on."""
        digest = digest_of([code(), name, _facts(world), _maker(name, make)], WITHOUT_EFFECT)
        first, last = world.index[[0, -1]]
        slug = re.sub(r"[^\w.-]+", "_", name)
        return self.folder / f"{slug}-{first}-{last}-{digest[:24]}.npz"


def _check_proven(world: World, trajectory: Trajectory) -> None:
    """Refuses a clairvoyant that costs less than it proves, or proves nothing."""
    if trajectory.proven is None:
        raise CertificateError("the clairvoyant proves no bound", hint=HINT)
    costs = {trajectory.name: trajectory.objective(world.end_value_per_mwh)}
    check_bound(costs, trajectory.proven, case_cost_scale(world.microgrid.case), world.index)


def _facts(world: World) -> list[object]:
    """What a part depends on apart from its method."""
    believed = world.believed
    settings = [
        world.end_value_per_mwh,
        world.known_centre,
        world.reset_daily,
        world.recourse,
        world.index,
        believed,
        believed.probability if isinstance(believed, Scenarios) else None,
    ]
    return [world.microgrid.case, world.microgrid.physics, world.scenarios, world.outlook, settings]


def _maker(name: str, make: Factory | None) -> bytes | None:
    """What identifies a dispatcher that is none of the package's own."""
    if make is None or DISPATCHERS.get(name) is make:
        return None
    import cloudpickle

    return cloudpickle.dumps(make)
