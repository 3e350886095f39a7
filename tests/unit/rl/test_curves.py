"""Learning curves: what several seeds say together, and pictures of what runs have logged."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import resilience as rs
from resilience.plots.saved import draw_run
from resilience.rl.training.curves import LearningCurve, interval, load_curves, run_folders


def write_run(folder: Path, seed: int, gaps: list[float], case: str = "island") -> Path:
    folder.mkdir(parents=True)
    lines = ["iteration,cpu_s,loss,cost_per_day,gap"]
    lines += [f"{k + 3},{2.5 * k + 0.1 * seed + 1.0},7.5,30.25,{g}" for k, g in enumerate(gaps)]
    (folder / "curve.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    config = {"case": case, "method": "apg", "seed": seed}
    (folder / "config.json").write_text(json.dumps(config), encoding="utf-8")
    return folder


@pytest.fixture
def seeds(tmp_path: Path) -> Path:
    for seed in (0, 2, 10):
        write_run(tmp_path / "runs" / f"seed-{seed}", seed, [0.9 + 0.01 * seed, 0.2, 0.05])
    return tmp_path / "runs"


def test_seeds_are_read_in_order_and_one_run_alone(seeds: Path) -> None:
    assert [curve.seed for curve in load_curves(seeds)] == [0, 2, 10]
    [curve] = load_curves(seeds / "seed-2")
    np.testing.assert_allclose(curve.cpu_s, [1.2, 3.7, 6.2])
    np.testing.assert_allclose(curve.gap, [0.92, 0.2, 0.05])


def test_the_mean_of_seeds_is_taken_at_equal_times_that_all_have() -> None:
    """0.8 - 0.1 t and 0.5 - 0.05 t, given at other times, over [1.5, 4.5]."""
    curves = [
        LearningCurve(k, when, start - slope * when, {})
        for k, (when, start, slope) in enumerate(
            [(np.array([0.5, 3.0, 4.5]), 0.8, 0.1), (np.array([1.5, 2.0, 6.5]), 0.5, 0.05)]
        )
    ]
    when, mean, low, high = interval(curves)
    assert (when[0], when[-1]) == (1.5, 4.5)
    np.testing.assert_allclose(mean, 0.65 - 0.075 * when, atol=1e-12)
    # Of two seeds a quarter of the resamples holds one of them only: those are the ends.
    np.testing.assert_allclose(low, np.minimum(0.8 - 0.1 * when, 0.5 - 0.05 * when), atol=1e-12)
    np.testing.assert_allclose(high, np.maximum(0.8 - 0.1 * when, 0.5 - 0.05 * when), atol=1e-12)


def test_the_interval_covers_the_mean_as_often_as_it_says() -> None:
    """Twenty normal seeds, 300 times: 95 % intervals hold the true mean in 90 to 97 %."""
    rng = np.random.default_rng(3)
    when = np.array([0.7, 2.3])
    held = 0
    for trial in range(300):
        gaps = 0.4 + 0.1 * rng.standard_normal((20, 2))
        low, high = interval(
            [LearningCurve(k, when, g, {}) for k, g in enumerate(gaps)], seed=trial
        )[2:]
        held += low[0] <= 0.4 <= high[0]
    assert 0.90 <= held / 300 <= 0.97


def test_a_run_is_drawn_into_its_folder(seeds: Path) -> None:
    target, hint = draw_run(seeds)
    assert target == seeds / "learning.png"
    assert target.read_bytes().startswith(b"\x89PNG")
    assert hint == ""


def test_the_picture_has_a_line_per_seed_the_mean_and_what_was_best(seeds: Path) -> None:
    [axis] = rs.plot_learning(seeds).axes
    lines = [line for line in axis.lines if len(np.asarray(line.get_xdata())) > 1]
    assert len(lines) == 4
    assert axis.get_yscale() == "log"
    title = rs.plot_learning(seeds).get_suptitle()
    assert "island, apg" in title
    assert "median 5.00 %, worst 5.00 %" in title
    [axis] = rs.plot_learning(seeds / "seed-2").axes
    assert axis.get_legend() is None


def test_a_gap_that_is_not_positive_is_drawn(tmp_path: Path) -> None:
    folder = write_run(tmp_path / "run", 1, [0.3, -0.01])
    [axis] = rs.plot_learning(folder).axes
    assert axis.get_yscale() == "linear"
    assert axis.get_ylim()[0] == pytest.approx(-1.0)


def test_what_cannot_be_drawn_is_refused(seeds: Path, tmp_path: Path) -> None:
    assert run_folders(tmp_path / "nowhere") == []
    with pytest.raises(rs.UsageError, match="holds no learning curve"):
        load_curves(tmp_path)
    with pytest.raises(rs.UsageError, match="holds a training, no comparison"):
        draw_run(seeds, method="rule")
    write_run(seeds / "seed-11", 11, [0.5, 0.25], case="another")
    with pytest.raises(rs.UsageError, match="runs of different cases: another, island"):
        load_curves(seeds)
    (seeds / "seed-11" / "curve.csv").write_text("iteration,cpu_s\n1,x\n", encoding="utf-8")
    with pytest.raises(rs.UsageError, match="holds no learning curve: "):
        load_curves(seeds)
