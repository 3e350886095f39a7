"""A training on disk: whatever interrupts it, it ends the same; what does not fit is refused."""

from __future__ import annotations

import json
import random
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import resilience as rs
from resilience.dispatch.registry import POLICY_FILE
from resilience.files import locked
from resilience.progress import NOTICE

torch = pytest.importorskip("torch", reason="torch is not installed here: resilience[learn]")
pytest.importorskip("safetensors", reason="safetensors is not installed here: resilience[learn]")

from resilience.rl.algorithms.apg import Apg  # noqa: E402
from resilience.rl.checkpoint import load, save  # noqa: E402
from resilience.rl.training.curves import CURVE_FILE, LAST_FILE, RESULT_FILE  # noqa: E402
from resilience.rl.training.run import LOG_FILE, Run  # noqa: E402
from resilience.rl.training.train import train  # noqa: E402
from resilience.rl.training.trainer import TrainingOptions  # noqa: E402
from tests.unit.rl.small import SETTINGS, few_storms, small_storm_case  # noqa: E402

ROOT = Path(__file__).parents[3]
OPTIONS = TrainingOptions(iterations=3, validations=3, seed=2, settings=SETTINGS)
OPERATIONS = 154
"""File operations of a small training, and one more: those at which it is killed."""


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    few_storms(monkeypatch)


@pytest.fixture(scope="module")
def case() -> rs.Case:
    return small_storm_case()


@pytest.fixture(scope="module")
def trained(case: rs.Case, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run") / "run"
    with pytest.MonkeyPatch.context() as patch:
        few_storms(patch)
        Run(case, OPTIONS, folder).train()
    return folder


def killed(folder: Path, moments: list[str]) -> list[dict[str, Any]]:
    """Reports of `tests.unit.rl.killed`."""
    done = subprocess.run(
        [sys.executable, "-m", "tests.unit.rl.killed", str(folder), "never", *moments],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


def assert_same(reports: list[dict[str, Any]]) -> None:
    """All were killed, resumed, and have come to what the one that lived came to, bit by bit."""
    whole, *others = reports
    assert not whole["killed"]
    for report in others:
        assert report["killed"], report
        assert report["resumed"], report
        assert report["facts"] == whole["facts"], report


def test_a_run_killed_in_a_file_operation_and_resumed_is_the_same(tmp_path: Path) -> None:
    chosen = random.Random(5).sample(range(8, OPERATIONS), 2)
    reports = killed(tmp_path, ["3", *map(str, chosen)])
    assert_same(reports)
    assert LAST_FILE not in reports[1]["left"]
    assert LAST_FILE in reports[2]["left"]


@pytest.mark.exhaustive
def test_a_run_killed_at_any_moment_and_resumed_is_the_same(tmp_path: Path) -> None:
    rng = random.Random(6)
    seconds = [f"{rng.uniform(0.05, 2.5):.3f}s" for _ in range(20)]
    whole, *others = killed(tmp_path, [*map(str, range(1, OPERATIONS)), *seconds])
    assert_same([whole, *(report for report in others if report["killed"])])
    assert sum(report["killed"] for report in others) > OPERATIONS
    for report in others:
        assert report["facts"] == whole["facts"]


def test_a_resumed_run_that_is_done_stays_as_it_is(case: rs.Case, trained: Path) -> None:
    before = {path: path.read_bytes() for path in trained.glob("*.*")}
    again = Run(case, OPTIONS, trained, resume=True).train()
    assert again.ended == "all 3 iterations done"
    assert {path: path.read_bytes() for path in trained.glob("*.*")} == before


def test_the_log_holds_what_the_run_says(case: rs.Case, trained: Path) -> None:
    rows = [json.loads(line) for line in (trained / LOG_FILE).read_text("utf-8").splitlines()]
    assert [row["iteration"] for row in rows] == [1, 2, 3]
    curve = (trained / CURVE_FILE).read_text("utf-8").splitlines()
    assert curve[0] == "iteration,cpu_s,loss,cost_per_day,gap"
    assert [float(line.split(",")[3]) for line in curve[1:]] == [r["cost_per_day"] for r in rows]
    result = json.loads((trained / RESULT_FILE).read_text("utf-8"))
    best = min(rows, key=lambda row: row["cost_per_day"])
    assert result == {"ended": "all 3 iterations done", "best": best}
    header = load(trained / POLICY_FILE)[1]
    assert header.iteration == best["iteration"]
    config = json.loads((trained / "config.json").read_text("utf-8"))
    assert config["settings"]["batch"] == SETTINGS["batch"]
    assert set(config["versions"]) == {"python", "resilience", "torch", "numpy", "safetensors"}
    assert config["case_digest"] == header.case


def test_nothing_in_a_run_is_pickled(trained: Path) -> None:
    for path in trained.glob("*.safetensors"):
        data = path.read_bytes()
        length = int.from_bytes(data[:8], "little")
        json.loads(data[8 : 8 + length])
    suffixes = {path.suffix for path in trained.glob("*.*")}
    assert suffixes == {".json", ".jsonl", ".csv", ".safetensors"}


def test_tensorboard_reads_the_events_once_each(trained: Path) -> None:
    module = "tensorboard.backend.event_processing.event_accumulator"
    accumulator = pytest.importorskip(module, reason="tensorboard is not installed here")
    events = accumulator.EventAccumulator(str(trained / "events"))
    events.Reload()
    scalars = {name: [e.step for e in events.Scalars(name)] for name in events.Tags()["scalars"]}
    assert scalars["cost_per_day"] == [1, 2, 3]
    assert {"loss", "gap", "gradient_norm"} <= set(scalars)


@pytest.mark.parametrize("name", [LAST_FILE, POLICY_FILE])
@pytest.mark.parametrize("share", [0.0, 0.03, 0.5, 0.999])
def test_a_torn_file_is_refused(trained: Path, tmp_path: Path, name: str, share: float) -> None:
    data = (trained / name).read_bytes()
    torn = tmp_path / name
    torn.write_bytes(data[: int(share * len(data))])
    with pytest.raises(rs.UsageError, match="cannot be read as a checkpoint"):
        load(torn)


def test_a_file_with_another_byte_anywhere_is_refused(trained: Path, tmp_path: Path) -> None:
    data = (trained / POLICY_FILE).read_bytes()
    rng, torn = random.Random(7), tmp_path / POLICY_FILE
    for _ in range(60):
        place = rng.randrange(len(data))
        torn.write_bytes(data[:place] + bytes([data[place] ^ 16]) + data[place + 1 :])
        with pytest.raises(rs.UsageError):
            load(torn)


def test_another_case_or_schema_or_method_is_refused(
    case: rs.Case, trained: Path, tmp_path: Path
) -> None:
    other = case.replace(terminal_value_per_mwh=0.36)
    with pytest.raises(rs.UsageError, match="was trained on a case with the digest"):
        Run(other, OPTIONS, trained, resume=True)
    tensors, header = load(trained / LAST_FILE)
    save(tmp_path / LAST_FILE, tensors, replace(header, schema="elsewhere"))
    with pytest.raises(rs.UsageError, match="trained on observations with the digest elsewhere"):
        Run(case, OPTIONS, tmp_path, resume=True)
    save(tmp_path / LAST_FILE, tensors, replace(header, iteration=4))
    with pytest.raises(rs.UsageError, match="iteration 4 of 3"):
        Run(case, OPTIONS, tmp_path, resume=True)
    save(tmp_path / LAST_FILE, tensors, replace(header, format=header.format + 1))
    with pytest.raises(rs.UsageError, match="has the format"):
        Run(case, OPTIONS, tmp_path, resume=True)


def test_what_differs_from_the_run_to_resume_is_named(case: rs.Case, trained: Path) -> None:
    with pytest.raises(rs.UsageError, match=r"with seed = 3; allowed: seed = 2"):
        Run(case, replace(OPTIONS, seed=3), trained, resume=True)


def test_a_folder_of_something_else_is_left_alone(
    case: rs.Case, trained: Path, tmp_path: Path
) -> None:
    stranger = tmp_path / "stranger"
    (stranger / "events").mkdir(parents=True)
    with pytest.raises(rs.UsageError, match="holds a run"):
        Run(case, OPTIONS, trained)
    with pytest.raises(rs.UsageError, match="holds no run to resume"):
        Run(case, OPTIONS, trained / "nowhere", resume=True)
    with pytest.raises(rs.UsageError, match=r"holds no run, but .*events"):
        Run(case, OPTIONS, stranger)


def test_training_stops_early_and_stays_stopped(case: rs.Case, tmp_path: Path) -> None:
    still = replace(
        OPTIONS, iterations=6, validations=6, patience=2, settings=SETTINGS | {"learning_rate": 0.0}
    )
    run = Run(case, still, tmp_path / "run").train()
    assert run.ended == "no better policy in 2 validations"
    assert run.training.iteration == 3
    again = Run(case, still, tmp_path / "run", resume=True).train()
    assert again.ended == run.ended
    assert again.training.iteration == 3


@pytest.mark.parametrize("harm", [float("nan"), 1e9])
def test_a_loss_that_is_none_or_explodes_stops_with_the_last_good_checkpoint(
    case: rs.Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, harm: float
) -> None:
    honest = Apg.iterate

    def harmed(self: Apg, progress: Any) -> dict[str, float]:
        logged = honest(self, progress)
        if progress.iteration < 2:
            return logged
        for value in self.actor.parameters():
            value.data.fill_(harm)
        return logged | {"loss": harm}

    monkeypatch.setattr(Apg, "iterate", harmed)
    run = Run(case, OPTIONS, tmp_path / "run").train()
    assert "stopped in iteration 3: its loss is" in run.ended
    assert json.loads((tmp_path / "run" / RESULT_FILE).read_text("utf-8"))["ended"] == run.ended
    tensors, header = load(tmp_path / "run" / LAST_FILE)
    assert header.iteration == 2
    assert all(bool(torch.isfinite(value).all()) for value in tensors.values())
    assert load(tmp_path / "run" / POLICY_FILE)[1].iteration <= 2
    monkeypatch.setattr(Apg, "iterate", honest)
    assert Run(case, OPTIONS, tmp_path / "run", resume=True).train().ended.startswith("all 3")


def test_a_gradient_of_nan_behind_a_sound_loss_is_never_kept(
    case: rs.Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    honest = Apg.iterate

    def harmed(self: Apg, progress: Any) -> dict[str, float]:
        logged = honest(self, progress)
        if progress.iteration == 1:
            next(self.actor.parameters()).data[0, 0] = float("nan")
        return logged

    monkeypatch.setattr(Apg, "iterate", harmed)
    run = Run(case, OPTIONS, tmp_path / "run").train()
    assert run.ended.endswith("stopped after iteration 2: actor.body.0.weight holds NaN")
    assert load(tmp_path / "run" / LAST_FILE)[1].iteration == 1


def test_a_breakdown_before_any_policy_is_an_error(
    case: rs.Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Apg, "iterate", lambda self, progress: {"loss": float("nan")})
    with pytest.raises(rs.SolverError, match="stopped in iteration 1: its loss is nan"):
        Run(case, OPTIONS, tmp_path / "run").train()
    assert load(tmp_path / "run" / LAST_FILE)[1].iteration == 0


def test_seeds_go_into_folders_of_their_own_and_differ(case: rs.Case, tmp_path: Path) -> None:
    runs = train(case, out=tmp_path / "runs", seeds=(0, 3), iterations=1, **SETTINGS)
    names = sorted(path.name for path in (tmp_path / "runs").iterdir())
    assert names == ["seed-0", "seed-3"]
    assert runs[0].best.loss != runs[1].best.loss
    again = train(
        case, out=tmp_path / "runs", seeds=(0, 3, 4), resume=True, iterations=1, **SETTINGS
    )
    assert [run.best.loss for run in again[:2]] == [run.best.loss for run in runs]
    assert (tmp_path / "runs" / "seed-4" / POLICY_FILE).is_file()


def test_a_budget_becomes_iterations_once(case: rs.Case, tmp_path: Path) -> None:
    options = replace(OPTIONS, iterations=None, budget_s=0.2)
    run = Run(case, options, tmp_path / "run")
    again = Run(case, replace(options, budget_s=9.0), tmp_path / "run", resume=True)
    assert again.training.iterations == run.training.iterations


def test_one_training_at_a_time_is_in_a_folder(case: rs.Case, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    run = Run(case, OPTIONS, folder)
    before = {path.name for path in folder.iterdir()}
    with locked(folder):  # as the other process does
        for resume in (False, True):
            with pytest.raises(rs.UsageError, match=r"another process trains in .*run; allowed"):
                Run(case, OPTIONS, folder, resume=resume)
        with pytest.raises(rs.UsageError, match="another process"):
            run.train()
    assert {path.name for path in folder.iterdir()} == before
    assert run.train().ended == "all 3 iterations done"


def test_ctrl_c_says_where_a_training_is_and_how_it_goes_on(
    case: rs.Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(NOTICE)

    def stop(run: Run, progress: object) -> None:
        if run.training.iteration == 2:
            raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(Run, "_on_iteration", stop)
        with pytest.raises(KeyboardInterrupt) as stopped:
            Run(case, OPTIONS, tmp_path / "run").train()
        with pytest.raises(KeyboardInterrupt, match="nothing was written; with --out FOLDER"):
            Run(case, OPTIONS, None).train()
    at = load(tmp_path / "run" / LAST_FILE)[1].iteration
    assert str(stopped.value) == (
        f"iteration {at} of 3 is in {tmp_path / 'run'}; the same command with --resume goes on"
    )
    Run(case, OPTIONS, tmp_path / "run", resume=True).train()
    assert f"{tmp_path / 'run'}: goes on at iteration {at} of 3" in caplog.text


def test_a_device_that_is_not_there_is_refused(case: rs.Case) -> None:
    with pytest.raises(rs.UsageError, match="device 'tpu'; allowed: cpu, cuda"):
        train(case, device="tpu", iterations=1)
    if not torch.cuda.is_available():
        with pytest.raises(rs.UsageError, match="without a GPU that torch can use"):
            train(case, device="cuda", iterations=1)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU that torch can use here")
def test_a_gpu_learns_the_same_within_rounding(case: rs.Case) -> None:
    runs = [train(case, device=d, iterations=3, **SETTINGS)[0] for d in ("cpu", "cuda")]
    costs = [run.best.cost_per_day for run in runs]
    assert costs[0] == pytest.approx(costs[1], rel=1e-3)
