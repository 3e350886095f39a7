"""A saved comparison is drawn as the one that was just run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import resilience as rs
from resilience.plots.saved import draw_run
from resilience.plots.storm_choice import storm
from resilience.simulation.trajectory_file import load_trajectory, save_trajectory
from tests.unit.plots.stormy import chain, cut


@pytest.fixture(scope="module")
def report() -> rs.Report:
    case = chain()
    return rs.compare(case, ["idle", "rule"], days=1, scenarios=cut(case))


@pytest.fixture
def folder(report: rs.Report, tmp_path: Path) -> Path:
    return report.save(tmp_path / "run")


def test_what_is_drawn_survives_a_save(report: rs.Report, folder: Path) -> None:
    found = rs.load_comparison(folder)
    assert found.case.equals(report.case)
    assert found.trajectories.keys() == report.trajectories.keys()
    assert list(found.objective) == list(report.objective)
    np.testing.assert_array_equal(found.bound, report.bound)
    assert found.end_value_per_mwh == report.end_value_per_mwh
    for name in found.trajectories:
        one, other = (storm(c, name, 1, 1).methods[name] for c in (found, report))
        np.testing.assert_array_equal(one.demand, other.demand)
        np.testing.assert_array_equal(one.shed, other.shed)


def test_a_trajectory_survives_a_save(report: rs.Report, tmp_path: Path) -> None:
    run = report.trajectories["rule"]
    save_trajectory(run, tmp_path / "deep" / "rule.npz")
    found = load_trajectory(tmp_path / "deep" / "rule.npz")
    assert found.columns == run.columns
    assert (found.name, found.step_h, found.seconds) == (run.name, run.step_h, run.seconds)
    for name in ("cost", "energy", "storage", "flows"):
        np.testing.assert_array_equal(getattr(found, name), getattr(run, name))


def test_other_files_hold_no_trajectory(tmp_path: Path, report: rs.Report) -> None:
    with pytest.raises(rs.UsageError, match="does not exist"):
        load_trajectory(tmp_path / "none.npz")
    np.savez(tmp_path / "other.npz", a=np.zeros(2))
    (tmp_path / "text.npz").write_text("text", encoding="utf-8")
    for name in ("other.npz", "text.npz"):
        with pytest.raises(rs.UsageError, match="holds no trajectory"):
            load_trajectory(tmp_path / name)
    with pytest.raises(rs.UsageError, match=r"allowed suffix: \.npz"):
        save_trajectory(report.trajectories["rule"], tmp_path / "rule.csv")


def test_a_folder_is_drawn_after_what_it_holds(folder: Path) -> None:
    target, hint = draw_run(folder)
    assert target == folder / "report.png"
    assert target.stat().st_size > 20_000
    assert hint == f"resilience plot {folder} --method rule-0.9,idle"
    target, hint = draw_run(folder, method="rule, idle", day="all")
    assert target == folder / "storm-rule-idle.png"
    assert target.stat().st_size > 20_000
    assert not hint


def test_a_plan_has_no_storms(tmp_path: Path) -> None:
    folder = rs.solve(chain(), "lp").save(tmp_path / "plan")
    assert draw_run(folder)[0] == folder / "plan.png"
    with pytest.raises(rs.UsageError, match=r"--method, --day: .* holds a plan"):
        draw_run(folder, method="rule", day="1")


def test_what_cannot_be_drawn_is_refused(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(rs.UsageError, match="without a method"):
        draw_run(folder, episode=1)
    with pytest.raises(rs.UsageError, match="day x; allowed: 1 to 1, or all"):
        draw_run(folder, method="rule", day="x")
    with pytest.raises(rs.UsageError, match="holds no result"):
        draw_run(tmp_path)
    with pytest.raises(rs.UsageError, match="holds no comparison"):
        rs.load_comparison(tmp_path)
    (folder / "case.toml").unlink()
    with pytest.raises(rs.UsageError, match="without its case"):
        draw_run(folder)
