"""Networks at work in NumPy: a small network is decided on in a hundredth of a millisecond, where
torch takes longer to begin than to compute. Nothing here needs torch.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from resilience.arrays import Floats
from resilience.files import reading
from resilience.inputs import checked_path

MAX_WEIGHT = 1e9
"""Beyond, products of a few layers are no numbers any more."""
Outputs = Callable[[Floats], Floats]
"""From observations (batch, numbers) to outputs (batch, units) in [-1, 1]."""


def outputs(weights: Mapping[str, np.ndarray], observations: Floats) -> Floats:
    """What a network of linear layers with ReLU between them and tanh at the end gives.

    Args:
        weights: `w0`, `b0`, `w1`, ... as `resilience export` writes them: (inputs, outputs) and
            (outputs,) of every layer.
        observations: (batch, numbers).

    Returns:
        (batch, units) in [-1, 1].
    """
    last = sum(name.startswith("w") for name in weights) - 1
    values = observations
    for k in range(last):
        values = np.maximum(values @ weights[f"w{k}"] + weights[f"b{k}"], 0.0)
    return np.tanh(values @ weights[f"w{last}"] + weights[f"b{last}"])


def load_outputs(path: str | Path) -> tuple[Outputs, dict[str, Any]]:
    """The network in a file of `resilience export`, and what the file says of it.

    Args:
        path: an `.npz` file.

    Raises:
        UsageError: it cannot be read.
    """
    path = Path(path)
    with (
        reading(path, "exported policy"),
        checked_path(path).open("rb") as opened,
        np.load(opened, allow_pickle=False) as file,
    ):
        weights = {name: file[name] for name in file.files if name != "about"}
        about: dict[str, Any] = json.loads(file["about"].tobytes())
        _check(weights, about)
    return lambda observations: outputs(weights, observations), about


def _check(weights: Mapping[str, np.ndarray], about: Mapping[str, Any]) -> None:
    """Refuses what is no network from as many numbers to as many units as the file says.

    Raises:
        ValueError, TypeError, KeyError: it is none.
    """
    names = [f"{kind}{k}" for k in range(len(weights) // 2) for kind in "wb"]
    if sorted(names) != sorted(weights):
        raise ValueError(f"weights are called {', '.join(weights)}")
    for name, array in weights.items():
        if array.ndim != 1 + name.startswith("w") or array.dtype.kind != "f":
            raise ValueError(f"{name} has {array.ndim} axes of the kind {array.dtype}")
        if not (np.abs(array) <= MAX_WEIGHT).all():
            raise ValueError(f"{name} holds what is no weight, up to {MAX_WEIGHT:g}")
    units = outputs(weights, np.zeros((1, int(about["inputs"])))).shape[1]
    if units != len(about["units"]):
        raise ValueError(f"{units} outputs for {len(about['units'])} units")


def layers(state: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The weights of linear layers that stand one after another, as `outputs` takes them.

    Args:
        state: weights by name, in order, as `body.0.weight`, `body.0.bias`, `body.2.weight`, ...
    """
    matrices = [value.T for name, value in state.items() if name.endswith("weight")]
    offsets = [value for name, value in state.items() if name.endswith("bias")]
    named = {f"w{k}": np.ascontiguousarray(value) for k, value in enumerate(matrices)}
    return named | {f"b{k}": value for k, value in enumerate(offsets)}
