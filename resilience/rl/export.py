"""Policies for other programs: `.npz` for NumPy, `.pt2` for torch, `.onnx` for everybody else.

What is exported is the network, from an observation to a number in [-1, 1] per unit, and what the
numbers of the observation are; each file is read again and held against the policy before it takes
its place.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from torch import nn

from resilience.arrays import Floats
from resilience.dispatch.registry import POLICY_FILE
from resilience.errors import SolverError, UsageError
from resilience.extras import need
from resilience.files import check_file, reading, replacing_file
from resilience.rl.checkpoint import Header, load, load_weights
from resilience.rl.networks.acting import layers, load_outputs
from resilience.rl.networks.nets import Actor, network

CHECKED = 100  # observations on which a file is held against the policy
TOLERANCE = 1e-6  # of outputs in [-1, 1]


def export_policy(run: str | Path, to: str | Path) -> float:
    """Writes the best policy of a run for other programs.

    Args:
        run: folder that `resilience train --out` wrote.
        to: file; its suffix says what is written.

    Returns:
        The largest difference of its outputs from the policy's, on 100 observations.

    Raises:
        UsageError: no policy, an unknown suffix, a network that a format does not hold, or a
            package that is missing.
        SolverError: what was written does not do what the policy does.
    """
    to = Path(to)
    if to.suffix not in FORMATS:
        raise UsageError(
            f"cannot export to {to.name!r}; allowed suffixes: {', '.join(FORMATS)}",
            hint=f"{to.stem}.npz, say",
        )
    check_file(to)
    write, read = FORMATS[to.suffix]
    path = Path(run) / POLICY_FILE
    weights, header = load(path)
    with reading(path, "policy"):
        inputs, units = header.notes["inputs"], header.notes["units"]
        actor = network(header.network, inputs, len(units))
        load_weights(actor, weights)
    actor.eval()
    rng = np.random.default_rng(0)
    observations = rng.uniform(-1.0, 1.0, (CHECKED, inputs)).astype(np.float32)
    with torch.no_grad():
        expected = actor(torch.from_numpy(observations)).numpy()
    with replacing_file(to) as fresh:
        write(actor, header, fresh)
        difference = float(np.abs(read(fresh, observations) - expected).max())
        if not difference <= TOLERANCE:
            raise SolverError(
                f"{to.name} differs from the policy by {difference:.1e}; allowed: {TOLERANCE}",
                hint="nothing was written; export to another format",
            )
    return difference


def about(header: Header) -> dict[str, Any]:
    """What an exported file says of itself, as plain data."""
    facts = asdict(header)
    names = ("method", "case", "schema", "config", "network", "versions")
    return {name: facts[name] for name in names} | header.notes


def _write_npz(actor: nn.Module, header: Header, path: Path) -> None:
    if not (isinstance(actor, Actor) and actor.is_plain):
        raise UsageError(
            f"a network of the kind {header.network['kind']!r} has no .npz; allowed: mlp",
            hint="export it to .pt2 or .onnx",
        )
    state = {name: value.numpy() for name, value in actor.state_dict().items()}
    text = np.frombuffer(json.dumps(about(header)).encode(), np.uint8)
    np.savez(path, allow_pickle=False, about=text, **layers(state))


def _read_npz(path: Path, observations: np.ndarray) -> Floats:
    return load_outputs(path)[0](observations)


def _write_pt2(actor: nn.Module, header: Header, path: Path) -> None:
    example = (torch.zeros(2, header.notes["inputs"]),)
    batch = torch.export.Dim("batch", min=1)
    program = torch.export.export(actor, example, dynamic_shapes=({0: batch},))
    torch.export.save(program, path, extra_files={"about.json": json.dumps(about(header))})


def _read_pt2(path: Path, observations: np.ndarray) -> Floats:
    with torch.no_grad():
        outputs: Floats = torch.export.load(path).module()(torch.from_numpy(observations)).numpy()
    return outputs


def _write_onnx(actor: nn.Module, header: Header, path: Path) -> None:
    need("export", "ONNX", "onnx", "onnxscript")
    import onnx

    example = (torch.zeros(2, header.notes["inputs"]),)
    program = torch.onnx.export(
        actor,
        example,
        input_names=["observation"],
        output_names=["output"],
        dynamic_shapes=({0: torch.export.Dim("batch", min=1)},),
        dynamo=True,
        verbose=False,
    )
    assert program is not None
    model = program.model_proto
    model.metadata_props.add(key="about", value=json.dumps(about(header)))
    onnx.save(model, str(path))


def _read_onnx(path: Path, observations: np.ndarray) -> Floats:
    """By the reference implementation, which comes with the package."""
    from onnx.reference import ReferenceEvaluator

    return cast("Floats", ReferenceEvaluator(str(path)).run(None, {"observation": observations})[0])


FORMATS: dict[
    str,
    tuple[Callable[[nn.Module, Header, Path], None], Callable[[Path, np.ndarray], Floats]],
] = {
    ".npz": (_write_npz, _read_npz),
    ".pt2": (_write_pt2, _read_pt2),
    ".onnx": (_write_onnx, _read_onnx),
}
"""By suffix: what writes a file, and what acts from it."""
