"""Steps per CPU-second of the training ground: observation, band and step, and draws."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

from bench.row import Row, skipped
from resilience.case import load_case

if TYPE_CHECKING:
    from resilience.rl.ground.env import BatchEnv
    from resilience.rl.ground.tape import Tape
    from resilience.simulation.slots import Slot

TURNS = 5
TARGETS = {("affine", 1024): (1.5e6, 0.5e6), ("affine", 1): (3e3, None)}  # without draws, with


def ground() -> Iterator[Row]:
    try:
        import torch
    except ImportError:
        yield skipped("training ground", "needs torch")
        return
    from resilience.rl.ground.env import BatchEnv
    from resilience.rl.ground.episodes import EpisodeSampler

    torch.set_num_threads(1)
    sampler = EpisodeSampler(load_case("ieee33-tou"))
    for name, batch in (("affine", 1024), ("anchors", 1024), ("affine", 1), ("anchors", 1)):
        yield from _of_band(BatchEnv(sampler, name), batch)


def _of_band(env: BatchEnv, batch: int) -> Iterator[Row]:
    tape, steps = env.draw(batch, 0), batch * 96
    playing = least_cpu(lambda: _played(env, tape))
    drawing = least_cpu(lambda: env.draw(batch, 1))
    slots = [tape.episodes.slot(t) for t in range(tape.slots)]
    alone = least_cpu(lambda: _stepped(env, slots))
    note = f"{playing / alone:.1f} times what the steps alone take in NumPy"
    least, with_draws = TARGETS.get((env.band_name, batch), (None, None))
    name = f"training ground, {env.band_name}, batch {batch}"
    yield _rate(name, steps / playing, least, note)
    yield _rate(f"{name}, with draws", steps / (playing + drawing), with_draws)


def _played(env: BatchEnv, tape: Tape) -> None:
    """A batch of episodes, observed, with outputs at random."""
    import torch

    energy, output = env.start(tape.n), torch.rand((tape.n, env.units)) * 2.0 - 1.0
    with torch.no_grad():
        for t in range(tape.slots):
            env.observe(tape, t, energy)
            energy = env.step(tape, t, energy, output).energy


def least_cpu(call: Callable[[], object], turns: int = TURNS) -> float:
    """CPU-seconds of the fastest of some turns."""
    seconds = []
    for _ in range(turns):
        began = time.process_time()
        call()
        seconds.append(time.process_time() - began)
    return min(seconds)


def _stepped(env: BatchEnv, slots: list[Slot]) -> None:
    """The slots of a batch, stepped in NumPy with no action at all."""
    energy = env.setting.start()[:, :1].repeat(slots[0].island.shape[1], axis=1)
    for slot in slots:
        energy = env.simulator.step(energy, 0.0 * energy, slot.stacked, slot.island).energy


def _rate(name: str, per_second: float, least: float | None, note: str = "") -> Row:
    target = "" if least is None else f">= {least:,.0f} steps/s"
    met = None if least is None else per_second >= least
    return Row(name, f"{per_second:,.0f} steps/s", target, met, note)
