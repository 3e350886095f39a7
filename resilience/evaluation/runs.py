"""Every method through every scenario: split over processes or a cluster, kept part by part.

A part is a method and some scenarios, and what it gives depends on nothing but these: the parts are
the same whoever works on them and however many do. A dispatcher that decides for all scenarios at
once, by arithmetic alone, takes `STEPPED_AT_ONCE` of them. One that keeps a solver's basis takes
one: among decisions of equal cost the basis chooses, and it must not come from another scenario.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.dispatch.registry import Factory, is_batched
from resilience.errors import SolverError
from resilience.evaluation.clairvoyant import Replay, clairvoyant
from resilience.evaluation.comparison import BOUND
from resilience.evaluation.engines import Engine, spread
from resilience.evaluation.store import Store
from resilience.models.simulator import Simulator
from resilience.progress import Meter, interruptible, meter, notice
from resilience.simulation.simulate import simulate
from resilience.simulation.trajectory import Trajectory, joined
from resilience.simulation.world import World

STEPPED_AT_ONCE = 64  # scenarios of a part whose dispatcher decides for all of them together
EPISODES_PER_BOUND_PART = 8  # which share the calm solve


@dataclass(frozen=True)
class Part:
    """Some scenarios of a world, and who acts in them.

    Attributes:
        name: the method's.
        world: the world with these scenarios alone.
        make: makes the dispatcher; None: the bound, which has none.
    """

    name: str
    world: World
    make: Factory | None

    def run(self, on_slot: Callable[[], None] | None = None) -> Trajectory:
        """What happens."""
        if self.make is None:
            return self._bound(on_slot)
        began = time.perf_counter(), time.process_time()
        dispatcher = self.make(self.world.setting)
        wall, cpu = time.perf_counter() - began[0], time.process_time() - began[1]
        trajectory = simulate(self.world, dispatcher, on_slot)
        return replace(trajectory, name=self.name, build_seconds=wall, build_cpu_seconds=cpu)

    def _bound(self, on_slot: Callable[[], None] | None) -> Trajectory:
        """The clairvoyant's: its solves are its building, since it decides everything at once."""
        began = time.perf_counter(), time.process_time()
        bound = clairvoyant(self.world)
        wall, cpu = time.perf_counter() - began[0], time.process_time() - began[1]
        trajectory = simulate(self.world, Replay(BOUND, bound.decision), on_slot)
        return replace(
            trajectory, proven=bound.objective, build_seconds=wall, build_cpu_seconds=cpu
        )


def run_all(
    world: World,
    methods: Mapping[str, Factory],
    *,
    workers: int = 1,
    engine: Engine = "local",
    store: Store | None = None,
) -> dict[str, Trajectory]:
    """The trajectory of every method and of the clairvoyant, which carries the proven bound.

    Args:
        world: the storms.
        methods: how to make every dispatcher.
        workers: processes.
        engine: who runs them.
        store: where finished parts are kept, and taken from.
    """
    parts = [
        Part(name, world.with_scenarios(index), make)
        for name, make in {BOUND: None, **methods}.items()
        for index in _split(world.scenarios.n, _size(world, make))
    ]
    done: dict[int, Trajectory] = {}
    total = world.microgrid.case.slots * world.scenarios.n * (len(methods) + 1)
    with (
        interruptible(lambda: what_is_there(f"{len(done)} of {len(parts)}", store)),
        meter("dispatch", total) as progress,
    ):
        for k, piece in enumerate(parts):
            stored = store.get(piece.name, piece.world, piece.make) if store else None
            if stored is not None:
                done[k] = stored
                progress.advance(stored.cost.size)
        _say_what_was_found(len(done), len(parts), store)
        todo = [k for k in range(len(parts)) if k not in done]
        for k, trajectory in _run([parts[k] for k in todo], workers, engine, progress):
            piece = parts[todo[k]]
            if store:
                store.put(trajectory, piece.world, piece.make)
            done[todo[k]] = trajectory
    by_name: dict[str, list[Trajectory]] = {}
    for k, piece in enumerate(parts):
        by_name.setdefault(piece.name, []).append(done[k])
    return {name: joined(trajectories) for name, trajectories in by_name.items()}


def what_is_there(finished: str, store: Store | None) -> str:
    """What an interrupted comparison leaves, and how to go on.

    Args:
        finished: how many parts, in words.
        store: where they are; None: nowhere.
    """
    if store is None:
        return "nothing was written; with --out FOLDER, finished parts stay and are not done again"
    return f"{finished} parts are in {store.report_folder}; the same command goes on"


def _say_what_was_found(done: int, total: int, store: Store | None) -> None:
    if store is None:
        return
    if done:
        notice(f"{done} of {total} parts found in {store.report_folder}")
    if store.damaged == 1:
        notice("1 part there is damaged or was changed, and is made anew")
    elif store.damaged:
        notice(f"{store.damaged} parts there are damaged or were changed, and are made anew")


def proven_bound(trajectory: Trajectory) -> Floats:
    """(scenarios,) $ that no method can stay below, from the clairvoyant's trajectory.

    Raises:
        SolverError: it carries none.
    """
    if trajectory.proven is None:
        raise SolverError(
            f"the trajectory of {trajectory.name!r} carries no bound; allowed: the clairvoyant's",
            hint="delete the folder's `parts` and compare again",
        )
    return trajectory.proven


def _size(world: World, make: Factory | None) -> int:
    """Scenarios of one part."""
    if make is None:
        return EPISODES_PER_BOUND_PART
    alone = not isinstance(world.simulator, Simulator)  # it keeps a basis, too
    return STEPPED_AT_ONCE if is_batched(make) and not alone else 1


def _split(n: int, size: int) -> list[Ints]:
    return [np.arange(first, min(first + size, n)) for first in range(0, n, size)]


def _run(
    parts: Sequence[Part], workers: int, engine: Engine, progress: Meter
) -> Iterator[tuple[int, Trajectory]]:
    """Number and outcome of every part, as they are finished."""
    if workers == 1 and engine == "local":
        for k, piece in enumerate(parts):
            progress.on(piece.name)
            n = piece.world.scenarios.n
            yield k, piece.run(partial(progress.advance, n))
        return
    for k, trajectory in spread([piece.run for piece in parts], workers, engine):
        progress.on(parts[k].name)
        progress.advance(trajectory.cost.size)
        yield k, trajectory
