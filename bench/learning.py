"""What learning and acting cost, in CPU-seconds of one thread."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bench.ground import least_cpu
from bench.row import Row, below, skipped
from resilience.case import load_case

HIDDEN = (128, 128)
DECISION_MS = {1: 0.15, 64: 0.02}  # per scenario, by scenarios decided for at once
PAPER_S = 60.0  # of the whole schedule
UPDATES = 30


def learning() -> Iterator[Row]:
    try:
        import torch
    except ImportError:
        yield skipped("learning", "needs torch")
        return
    torch.set_num_threads(1)
    for batch, limit_ms in DECISION_MS.items():
        for band_name in ("anchors", "affine"):
            name = f"decision of a learned policy, {band_name}, {batch} at once"
            yield below(name, deciding_ms(batch, band_name), limit_ms, "ms", "per scenario")
    yield Row("iteration of apg, 128 episodes of a day", f"{apg_s():.3g} s", "", None)
    seconds, note = paper_s()
    yield below("the paper's schedule, 400 episodes", seconds, PAPER_S, "s", note)


def deciding_ms(batch: int, band_name: str) -> float:
    """Milliseconds per decision and scenario, over a day."""
    import torch

    from resilience.rl.ground.episodes import EpisodeSampler
    from resilience.rl.ground.observe import Observer
    from resilience.rl.networks.nets import Actor
    from resilience.rl.policy import Policy

    episodes = EpisodeSampler(load_case("ieee33-tou"), storms=200).draw(batch, 0)
    setting, units = episodes.setting, len(episodes.setting.simulator.units)
    actor = Actor(Observer(setting).size, units, HIDDEN, torch.Generator().manual_seed(0))
    energy = np.repeat(setting.start()[:, :1], batch, axis=1)
    day = [episodes.observation(t, energy) for t in range(episodes.slots)]

    policy = Policy("bench", setting, actor, band_name)

    def decide() -> None:
        for seen in day:
            policy.act(seen)

    decide()
    return 1e3 * least_cpu(decide) / (len(day) * batch)


def apg_s() -> float:
    """Seconds of an iteration with its default settings, episodes drawn."""
    from resilience.rl.algorithms.apg import Apg, ApgSettings
    from resilience.rl.ground.env import BatchEnv
    from resilience.rl.ground.episodes import EpisodeSampler
    from resilience.rl.learning.learner import Progress

    env = BatchEnv(EpisodeSampler(load_case("ieee33-tou"), storms=500))
    learner = Apg(env, ApgSettings())
    learner.iterate(Progress(0, 10))
    return least_cpu(lambda: learner.iterate(Progress(1, 10)))


def paper_s() -> tuple[float, str]:
    """Seconds of the whole schedule, from a round without updates and some updates; and both."""
    from resilience.rl.algorithms.maddpg_paper import PaperMaddpg, PaperMaddpgSettings
    from resilience.rl.ground.env import BatchEnv
    from resilience.rl.ground.episodes import EpisodeSampler
    from resilience.rl.learning.learner import Progress

    settings = PaperMaddpgSettings()
    sampler = EpisodeSampler(load_case("ieee33"), storms=500)
    learner = PaperMaddpg(BatchEnv(sampler, "affine", observer_name="paper"), settings)
    rounds = settings.episodes // settings.environments
    learner.iterate(Progress(0, rounds))
    round_s = least_cpu(lambda: learner.iterate(Progress(0, rounds)), turns=2)
    rng = np.random.default_rng(0)

    def update() -> None:
        for _ in range(UPDATES):
            learner.update(learner.sample(rng), rng, Progress(0, rounds))

    update_s = least_cpu(update) / UPDATES
    steps = settings.episodes * 96
    updates = steps // settings.update_every - settings.warm_up // settings.update_every
    note = f"{rounds} rounds of {round_s:.2g} s, {updates} updates of {1e3 * update_s:.3g} ms"
    return rounds * round_s + updates * update_s, note
