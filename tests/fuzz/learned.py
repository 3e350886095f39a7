"""Kinds of files that trainings leave, and settings that they are started with."""

from __future__ import annotations

import json
from contextlib import suppress
from dataclasses import asdict
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from hypothesis import strategies as st

from resilience.rl import checkpoint
from resilience.rl.algorithms.registry import ALGORITHMS, algorithm
from resilience.rl.ground.episodes import EpisodeSampler
from resilience.rl.networks.acting import load_outputs
from resilience.rl.policy import Policy, load_policy
from resilience.rl.training.run import Run
from resilience.rl.training.trainer import TrainingOptions
from tests.fuzz.changes import array_changed, bytes_changed, data_changed
from tests.fuzz.kinds import Files, Kind, saved
from tests.fuzz.results import npz_changed
from tests.unit.rl.small import SETTINGS, keyword_defaults, small_storm_case

POLICY, LAST, EXPORTED = "policy.safetensors", "last.safetensors", "policy.npz"
OPTIONS = TrainingOptions(iterations=1, validations=1, settings=SETTINGS)


@cache
def sampler() -> EpisodeSampler:
    """Where policies act."""
    return EpisodeSampler(small_storm_case(), days=1, seed=0, storms=3)


def write_run(folder: Path) -> None:
    from resilience.rl.export import export_policy

    Run(small_storm_case(), OPTIONS, folder / "run").train()
    export_policy(folder / "run", folder / EXPORTED)


trained = saved(write_run)


@cache
def contents(name: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Tensors and header of a file of a run."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_bytes(trained()[f"run/{name}"])
        tensors, header = checkpoint.load(path)
    return tensors, asdict(header)


@st.composite
def checkpoint_changed(draw: st.DrawFn, name: str) -> bytes:
    """A checkpoint whose sums of bytes are right, with another header or tensor; or other bytes."""
    import torch
    from safetensors.torch import save

    if draw(st.integers(0, 2)) == 0:
        return draw(bytes_changed(trained()[f"run/{name}"]))
    tensors, header = contents(name)
    tensors = dict(tensors)
    if draw(st.booleans()):
        header = draw(data_changed(header))
    else:
        chosen = draw(st.sampled_from(sorted(tensors)))
        array = draw(array_changed(tensors[chosen].numpy()))
        with suppress(TypeError):  # what no tensor holds, and, of these, what no such file does
            tensor = torch.from_numpy(np.ascontiguousarray(array))
            tensors = tensors if tensor.is_complex() else {**tensors, chosen: tensor}
    text = json.dumps(header, default=str)
    facts = {"header": text, "sha256": checkpoint._digest(text, tensors)}
    return save(tensors, {"resilience": json.dumps(facts)})


def checkpoint_kind(name: str, read: Any, sound: Any) -> Kind:
    return Kind(
        lambda: {f"run/{name}": trained()[f"run/{name}"]},
        lambda _: checkpoint_changed(name).map(lambda data: {f"run/{name}": data}),
        read,
        sound,
        "run",
        slow=True,
    )


def sound_policy(policy: Policy) -> None:
    numbers = np.zeros((2, policy.observer.size))
    outputs = policy.outputs(numbers)
    assert outputs.shape == (2, 2)
    assert np.isfinite(outputs).all()


def read_policy(folder: Path) -> Policy:
    return load_policy(sampler().setting, "apg", folder / "run")


def resume(folder: Path) -> Run:
    keyword_defaults()["storms"] = 3  # what is drawn to learn on takes long, and is not read
    return Run(small_storm_case(), OPTIONS, folder / "run", resume=True)


def sound_run(run: Run) -> None:
    assert 0 <= run.training.iteration <= run.training.iterations
    assert all(np.isfinite(row.cost_per_day) for row in run.rows)


def sound_outputs(value: Any) -> None:
    act, about = value
    assert np.isfinite(act(np.zeros((2, about["inputs"])))).all()


@st.composite
def settings_changed(draw: st.DrawFn) -> Files:
    """Settings of an algorithm, as `--set` gives them."""
    name = draw(st.sampled_from(sorted(ALGORITHMS)))
    plain = json.loads(json.dumps(asdict(algorithm(name).settings_of({}))))
    return {"settings.json": json.dumps([name, draw(data_changed(plain))], default=str).encode()}


def read_settings(folder: Path) -> Any:
    name, values = json.loads((folder / "settings.json").read_bytes())
    return algorithm(name).settings_of(values if isinstance(values, dict) else {})


LEARNED = {
    "policy": checkpoint_kind(POLICY, read_policy, sound_policy),
    "run to resume": checkpoint_kind(LAST, resume, sound_run),
    "exported policy": Kind(
        lambda: {EXPORTED: trained()[EXPORTED]},
        lambda files: npz_changed(files[EXPORTED]).map(lambda data: {EXPORTED: data}),
        lambda folder: load_outputs(folder / EXPORTED),
        sound_outputs,
        EXPORTED,
    ),
    "settings": Kind(
        lambda: {"settings.json": b'["apg", {}]'},
        lambda _: settings_changed(),
        read_settings,
    ),
}
