"""The page and the words of a comparison."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import resilience as rs
from resilience.evaluation.comparison import Comparison
from resilience.evaluation.paired import daily_cost
from resilience.evaluation.verdict import verdict
from resilience.plots.report_data import records
from resilience.plots.style import colours
from tests.unit.plots.stormy import by_hand, chain, compared, cut

# Machado, Oliveira, Fernandes (2009), severity 1, on linear RGB.
BLIND = {
    "protan": [[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]],
    "deutan": [[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]],
    "nobody": np.eye(3).tolist(),
}


@pytest.fixture(scope="module")
def days() -> Comparison:
    case = chain(slots=48)
    return compared(case, cut(case), ["idle", "greedy", "rule", "rule-0.9"])


def test_days_add_up_to_the_objective(days: Comparison) -> None:
    for name, cost in days.objective.items():
        daily = daily_cost(days, name)
        assert daily.shape == (2, 2)
        start = days.trajectories[name].energy[:, 0].sum(0)
        np.testing.assert_allclose(daily.sum(0), cost + 0.5 * start)


def test_records_are_sorted_and_measured_from_the_bound() -> None:
    hand = by_hand({"idle": [6.0, 8.0], "rule-0.9": [4.0, 6.0], "clairvoyant": [3, 5]}, [3.0, 5.0])
    found = records(hand)
    assert [row.name for row in found] == ["rule-0.9", "idle"]
    np.testing.assert_allclose(found[1].over, [3.0, 3.0])
    assert (found[1].mean.low, found[1].mean.mean, found[1].mean.high) == (3.0, 3.0, 3.0)
    assert found[1].shed == pytest.approx(4.0)


def test_a_comparison_is_drawn(days: Comparison, tmp_path: Path) -> None:
    for suffix in ("png", "svg"):
        rs.plot_report(days, tmp_path / f"report.{suffix}")
        assert (tmp_path / f"report.{suffix}").stat().st_size > 5_000


@pytest.mark.parametrize(
    "costs",
    [
        {"rule-0.9": [5.0]},
        {"rule-0.9": [5.0] * 12, "idle": [900.0] * 6 + [1000.0] * 6, "mpc": [4.1] * 12},
        {"rule-0.9": [-5.0, -6.0], "idle": [-4.0, -4.5]},
        {f"m{k}": [4.0 + k, 5.0 + k] for k in range(11)} | {"rule-0.9": [4.0, 4.0]},
    ],
    ids=["one", "wide", "earning", "many"],
)
def test_any_costs_can_be_drawn(costs: dict[str, list[float]], tmp_path: Path) -> None:
    n = len(costs["rule-0.9"])
    bound = np.min(list(costs.values()), axis=0) - 0.1
    rs.plot_report(by_hand(costs, bound[:n].tolist()), tmp_path / "report.png")


def test_the_verdict_names_the_best_and_its_saving() -> None:
    words = verdict(by_hand({"rule-0.9": [10, 12], "mpc": [8, 10]}, [7.0, 9.0]))
    assert words == (
        "Best is mpc at 9.00 $/day, shedding 3.000 MWh/day. That saves 2.00 $/day (18.2 %) against "
        "rule-0.9, a battery kept full, and sheds 5.000 MWh/day less.",
        "That is not luck: the 95 % interval of the saving over 2 episodes is 2.00 to 2.00 $/day.",
        "The case can tell methods apart: a battery kept full costs 37.50 % more than perfect "
        "foresight.",
    )


def test_the_verdict_doubts_what_may_be_luck() -> None:
    hand = by_hand({"rule-0.9": [10, 10, 10], "mpc": [2, 12, 13], "idle": [9, 9, 12]}, [1.0] * 3)
    words = " ".join(verdict(hand))
    assert "That may be luck" in words
    assert "includes zero" in words
    assert "These storms cannot tell mpc from idle." in words


def test_the_verdict_says_when_a_full_battery_is_best_or_all_are_alike() -> None:
    words = " ".join(verdict(by_hand({"rule-0.9": [10.0, 10.0], "mpc": [12, 13]}, [9.99, 9.99])))
    assert "Best is rule-0.9" in words
    assert "nothing that was asked for is cheaper" in words
    assert "But this case cannot tell methods apart: a battery kept full costs 0.10 %" in words


def test_one_episode_says_nothing_about_luck() -> None:
    words = verdict(by_hand({"rule-0.9": [10.0], "mpc": [8.0]}, [7.0]))
    assert words[1] == "One episode says nothing about luck; ask for more with --draws."


def test_the_colour_blind_can_tell_sources_apart() -> None:
    """CIELAB distances of 15 are plain to see; just noticeable is about 2."""
    names = [name for name in colours() if name != "demand"]
    for matrix in BLIND.values():
        seen = np.array([lab(colours()[name], matrix) for name in names])
        apart = np.linalg.norm(seen[:, None] - seen[None], axis=2)
        assert apart[~np.eye(len(names), dtype=bool)].min() > 15


def lab(colour: str, matrix: list[list[float]]) -> np.ndarray:
    """CIELAB (D65) of a colour as seen through a matrix on linear RGB."""
    rgb = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    linear = np.clip(np.array(matrix) @ linear, 0.0, 1.0)
    to_xyz = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    x, y, z = np.cbrt(np.array(to_xyz) @ linear / [0.9505, 1.0, 1.089])
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])
