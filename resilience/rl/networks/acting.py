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
    with reading(path, "exported policy"), np.load(path, allow_pickle=False) as file:
        weights = {name: file[name] for name in file.files if name != "about"}
        about: dict[str, Any] = json.loads(file["about"].tobytes())
    return lambda observations: outputs(weights, observations), about


def layers(state: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The weights of linear layers that stand one after another, as `outputs` takes them.

    Args:
        state: weights by name, in order, as `body.0.weight`, `body.0.bias`, `body.2.weight`, ...
    """
    matrices = [value.T for name, value in state.items() if name.endswith("weight")]
    offsets = [value for name, value in state.items() if name.endswith("bias")]
    named = {f"w{k}": np.ascontiguousarray(value) for k, value in enumerate(matrices)}
    return named | {f"b{k}": value for k, value in enumerate(offsets)}
