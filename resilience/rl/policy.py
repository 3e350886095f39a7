"""A trained network as a dispatcher: it sees what every dispatcher sees, and answers in MW."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import cast

import torch
from torch import nn

from resilience.arrays import Floats
from resilience.dispatch.registry import POLICY_FILE
from resilience.errors import UsageError
from resilience.files import reading
from resilience.rl.checkpoint import check_fits, load, load_weights
from resilience.rl.ground.bands import band
from resilience.rl.ground.observers import observer
from resilience.rl.networks.acting import Outputs, layers, outputs
from resilience.rl.networks.nets import Actor, network
from resilience.simulation.observation import Observation
from resilience.simulation.setting import Setting


class Policy:
    """Acts for a batch of scenarios in one setting.

    Args:
        name: in reports.
        setting: where it acts.
        actor: from observations (batch, numbers) to outputs (batch, units) in [-1, 1].
        band_name: how outputs become MW.
        observer_name: what it sees.
    """

    batched = True

    def __init__(
        self,
        name: str,
        setting: Setting,
        actor: nn.Module,
        band_name: str,
        observer_name: str = "full",
    ) -> None:
        self.name, self.outputs = name, _at_work(actor)
        self.observer = observer(observer_name, setting)
        self.band = band(band_name, setting.simulator)

    def act(self, observation: Observation) -> Floats:
        """(units, batch) MW."""
        output = self.outputs(self.observer.observed(observation))
        slot = self.band.slot(observation.data, observation.island)
        return cast("Floats", self.band.power(output.T, observation.energy, slot))


def _at_work(actor: nn.Module) -> Outputs:
    """The network as a function of arrays: in NumPy where its layers are plain, else in torch."""
    if isinstance(actor, Actor) and actor.is_plain:
        state = {k: v.detach().numpy().astype(float) for k, v in actor.state_dict().items()}
        return partial(outputs, layers(state))

    def by_torch(numbers: Floats) -> Floats:
        with torch.no_grad():
            return actor(torch.as_tensor(numbers, dtype=torch.float32)).numpy().astype(float)

    return by_torch


def load_policy(setting: Setting, method: str, run: Path) -> Policy:
    """The best policy of a run, in a setting.

    Args:
        setting: where it is to act.
        method: name of the algorithm, as it was trained.
        run: the folder that `resilience train --out` wrote.

    Raises:
        UsageError: no policy, a torn one, another algorithm's, or one of another case.
    """
    path = run / POLICY_FILE
    weights, header = load(path)
    if header.method != method:
        raise UsageError(
            f"{path} was trained by {header.method}, not {method}",
            hint=f"call it {header.method}:{run}",
        )
    with reading(path, "policy"):
        band_name, observer_name = header.config["band"], header.config["observer"]
        eyes = observer(observer_name, setting)
        check_fits(path, header, setting.case, eyes.schema)
        actor = network(header.network, eyes.size, len(setting.simulator.units))
        load_weights(actor, weights)
        return Policy(f"{method}:{run}", setting, actor, band_name, observer_name)
