"""The programs of the guides on learning: the algorithm in one file, acting from a file."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.docs.pages import ROOT, blocks
from tests.unit.rl.small import few_storms, small_storm_case

pytest.importorskip("torch", reason="torch is not installed here: resilience[learn]")
pytest.importorskip("safetensors", reason="safetensors is not installed here: resilience[learn]")

from resilience.rl.algorithms.registry import ALGORITHMS
from resilience.rl.export import export_policy
from resilience.rl.training.run import Run
from resilience.rl.training.trainer import TrainingOptions


def program(page: str, title: str, folder: Path) -> Path:
    text = (ROOT / "docs" / "guide" / f"{page}.md").read_text(encoding="utf-8")
    [block] = [block for block in blocks(text) if block.title == title]
    path = folder / title
    path.write_text(block.body, encoding="utf-8")
    return path


def test_the_algorithm_of_the_guide_learns_resumes_and_acts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    few_storms(monkeypatch)
    monkeypatch.syspath_prepend(str(tmp_path))
    program("algorithm", "search.py", tmp_path)
    try:
        __import__("search")
        case, settings = small_storm_case(), {"batch": 4, "step": 0.3}
        options = TrainingOptions("search", iterations=4, validations=2, settings=settings)
        run = Run(case, options, tmp_path / "run").train()
        assert run.ended == "all 4 iterations done"
        again = Run(case, options, tmp_path / "run", resume=True)
        state = run.training.learner.state()
        for name, value in again.training.learner.state().items():
            np.testing.assert_array_equal(value.numpy(), state[name].numpy())
    finally:
        ALGORITHMS.pop("search", None)
        sys.modules.pop("search", None)
    export_policy(tmp_path / "run", tmp_path / "policy.npz")
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(program("train", "act.py", tmp_path)))
    assert capsys.readouterr().out.strip() == "(1, 2) ['ess1', 'ess2']"


def test_the_environments_of_the_guide_are_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pettingzoo", reason="pettingzoo is not installed here: resilience[gym]")
    few_storms(monkeypatch)
    names = runpy.run_path(str(program("train", "other.py", tmp_path)))
    assert names["env"].action_space.shape == (5,)
    assert names["many"].num_envs == 64
    assert len(names["agents"].possible_agents) == 5
