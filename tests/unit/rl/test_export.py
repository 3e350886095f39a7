"""Policies for other programs do what the policy does, and say what they are."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import resilience as rs
from resilience.case.days import training

torch = pytest.importorskip("torch", reason="torch is not installed here: resilience[learn]")
pytest.importorskip("safetensors", reason="safetensors is not installed here: resilience[learn]")

from resilience.dispatch.registry import POLICY_FILE, factory_of  # noqa: E402
from resilience.rl import export  # noqa: E402
from resilience.rl.checkpoint import load, save  # noqa: E402
from resilience.rl.networks import acting  # noqa: E402
from resilience.rl.networks.nets import network  # noqa: E402
from resilience.rl.policy import Policy  # noqa: E402
from resilience.rl.training.run import Run  # noqa: E402
from resilience.rl.training.trainer import TrainingOptions  # noqa: E402
from resilience.simulation.simulate import simulate  # noqa: E402
from tests.unit.rl.small import SETTINGS, few_storms, small_storm_case  # noqa: E402

ONNX = all(find_spec(name) for name in ("onnx", "onnxscript"))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    folder = tmp_path_factory.mktemp("run") / "run"
    settings = SETTINGS | {"hidden": (7, 5), "learning_rate": 0.1}
    options = TrainingOptions(iterations=2, validations=1, settings=settings)
    with pytest.MonkeyPatch.context() as patch:
        few_storms(patch)
        return Run(small_storm_case(), options, folder).train()


def folder_of(run: Run) -> Path:
    assert run.folder is not None
    return run.folder


def observations(run: Run) -> np.ndarray:
    """(100, numbers) what the policy has really observed on the validation days, and then some."""
    env = run.training.env
    tape = env.draw(20, 3)
    energy = env.start(20)
    return np.concatenate([env.observe(tape, t, energy).numpy() for t in (0, 3, 5, 8, 11)])


def expected(run: Run, observed: np.ndarray) -> np.ndarray:
    weights, header = load(folder_of(run) / POLICY_FILE)
    actor = network(header.network, observed.shape[1], 2)
    actor.load_state_dict(weights)
    with torch.no_grad():
        return actor(torch.from_numpy(observed)).numpy()


def test_numpy_does_what_the_policy_does_and_says_what_it_sees(run: Run, tmp_path: Path) -> None:
    assert export.export_policy(folder_of(run), tmp_path / "policy.npz") < 1e-6
    outputs, about = acting.load_outputs(tmp_path / "policy.npz")
    observed = observations(run)
    assert np.ptp(expected(run, observed)) > 0.01
    np.testing.assert_allclose(outputs(observed), expected(run, observed), atol=1e-6)
    assert about["units"] == ["ess1", "ess2"]
    assert about["config"]["band"] == "anchors"
    assert sum(len(block["labels"]) for block in about["observation"]) == observed.shape[1]


def test_numpy_acts_without_torch(run: Run, tmp_path: Path) -> None:
    export.export_policy(folder_of(run), tmp_path / "policy.npz")
    program = (
        "import sys, numpy; from resilience.rl.networks.acting import load_outputs; "
        f"act, about = load_outputs({str(tmp_path / 'policy.npz')!r}); "
        "print(act(numpy.zeros((1, about['inputs']))).shape, 'torch' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "(1, 2) False"


@pytest.mark.slow
def test_torch_export_does_what_the_policy_does(run: Run, tmp_path: Path) -> None:
    assert export.export_policy(folder_of(run), tmp_path / "policy.pt2") < 1e-6
    observed = observations(run)
    done = torch.export.load(tmp_path / "policy.pt2").module()(torch.from_numpy(observed[:7]))
    np.testing.assert_allclose(done.detach().numpy(), expected(run, observed)[:7], atol=1e-6)


@pytest.mark.slow
@pytest.mark.skipif(not ONNX, reason="onnx and onnxscript are not installed: resilience[export]")
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning")
def test_onnx_does_what_the_policy_does(run: Run, tmp_path: Path) -> None:
    assert export.export_policy(folder_of(run), tmp_path / "policy.onnx") < 1e-6
    runtime = pytest.importorskip("onnxruntime", reason="onnxruntime is not installed here")
    session = runtime.InferenceSession(str(tmp_path / "policy.onnx"))
    observed = observations(run)
    done = session.run(None, {"observation": observed[:9]})[0]
    np.testing.assert_allclose(done, expected(run, observed)[:9], atol=1e-6)


@pytest.mark.skipif(ONNX, reason="onnx and onnxscript are installed here")
def test_without_onnx_the_extra_is_named(run: Run, tmp_path: Path) -> None:
    with pytest.raises(rs.UsageError, match="ONNX needs onnx") as error:
        export.export_policy(folder_of(run), tmp_path / "policy.onnx")
    assert error.value.hint == "pip install 'resilience[export]'"
    assert not (tmp_path / "policy.onnx").exists()


def test_a_file_that_acts_otherwise_is_not_written(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        export, "layers", lambda state: {k: v + 1e-3 for k, v in acting.layers(state).items()}
    )
    with pytest.raises(rs.SolverError, match=r"policy\.npz differs from the policy by"):
        export.export_policy(folder_of(run), tmp_path / "policy.npz")
    assert list(tmp_path.iterdir()) == []


def test_what_cannot_be_exported_is_named(run: Run, tmp_path: Path) -> None:
    with pytest.raises(rs.UsageError, match=r"allowed suffixes: \.npz, \.pt2, \.onnx"):
        export.export_policy(folder_of(run), tmp_path / "policy.pkl")
    with pytest.raises(rs.UsageError, match="does not exist"):
        export.export_policy(tmp_path, tmp_path / "policy.npz")
    (tmp_path / "torn.npz").write_bytes(b"PK")
    with pytest.raises(rs.UsageError, match="holds no exported policy"):
        acting.load_outputs(tmp_path / "torn.npz")


def test_a_policy_acts_alike_in_numpy_and_in_torch(run: Run) -> None:
    world = run.training.sampler.validation_world()
    fast = run.training.policy(world)
    slow = run.training.policy(world)
    actor = network(run.training.learner.network(), run.training.env.size, 2)
    actor.load_state_dict(run.training.learner.weights())

    def by_torch(observed: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            return actor(torch.as_tensor(observed, dtype=torch.float32)).numpy().astype(float)

    slow.outputs = by_torch
    energies = [simulate(world, policy).energy for policy in (fast, slow)]
    np.testing.assert_allclose(energies[0], energies[1], atol=1e-4)


def test_a_saved_policy_is_a_dispatcher_of_its_case(run: Run) -> None:
    world = run.training.sampler.validation_world()
    made = factory_of(run.name)(world.setting)
    assert isinstance(made, Policy)
    cost = simulate(world, made).objective(world.end_value_per_mwh)
    per_day = world.scenarios.probability @ cost / run.training.validation_days
    assert per_day == pytest.approx(run.best.cost_per_day, rel=1e-9)


def test_a_policy_of_another_method_or_case_is_refused(run: Run, tmp_path: Path) -> None:
    world = run.training.sampler.validation_world()
    weights, header = load(folder_of(run) / POLICY_FILE)
    save(tmp_path / POLICY_FILE, weights, header)
    with pytest.raises(rs.UsageError, match=r"was trained by apg, not maddpg"):
        factory_of(f"maddpg:{tmp_path}")(world.setting)
    for key in ("band", "observer"):
        config = header.config | {key: "strange"}
        save(tmp_path / POLICY_FILE, weights, replace(header, config=config))
        with pytest.raises(rs.UsageError, match=rf"{POLICY_FILE}.*'strange' is unknown"):
            factory_of(f"apg:{tmp_path}")(world.setting)
    other = Run(
        training(small_storm_case()).replace(terminal_value_per_mwh=0.5, slots=72),
        TrainingOptions(iterations=1, settings=SETTINGS),
        None,
    )
    with pytest.raises(rs.UsageError, match="was trained on a case with the digest"):
        factory_of(run.name)(other.training.sampler.validation_world().setting)
    with pytest.raises(rs.UsageError, match="holds no trained policy"):
        factory_of(f"apg:{tmp_path / 'nowhere'}")
