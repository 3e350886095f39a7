"""`resilience scenarios` and plans for a drawn storm."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import resilience as rs
from resilience.case.outages import outage_texts
from resilience.cli import main
from resilience.fragility import Bell, draw, load_scenarios, sample_bell, sample_outages
from tests.unit.fragility.storms import feeder


def call(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as caught:
        main(list(words))
    printed = capsys.readouterr()
    return int(caught.value.code or 0), printed.out, printed.err


def test_what_is_printed_is_what_is_drawn(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = tmp_path / "storms.npz"
    words = ("scenarios", "ieee33", "-n", "20", "--seed", "5", "--sigma-slots", "8", "--refail")
    code, out, _ = call(capsys, *words, "--out", str(path))
    assert code == 0
    assert out.startswith("ieee33  20 scenarios of 1 day, seed 5\n")
    assert out.endswith(f"scenarios: {path}\n")
    case = rs.load_case("ieee33")
    drawn = sample_bell(case, Bell(sigma_slots=8.0, refail=True), 20, 5)
    assert load_scenarios(path, case).events() == drawn.events()

    found = json.loads(call(capsys, *words, "--json")[1])
    assert found["process"] == str(Bell(sigma_slots=8.0, refail=True))
    for k, row in enumerate(found["lines"].values()):
        assert row["outage_chance_per_day"] == pytest.approx(drawn.down[k].any(axis=0).mean())
        assert row["hours_out_per_day"] == pytest.approx(drawn.down[k].sum() * 0.25 / 20)
    assert found["all_out_chance_per_day"] == pytest.approx(
        drawn.down.all(axis=0).any(axis=0).mean()
    )


def test_options_replace_what_the_case_says(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["scenarios", "ieee33-long", "-n", "3", "--json"]
    kept = json.loads(call(capsys, *words)[1])["process"]
    assert "down for 6 to 12 h" in kept
    words += ["--duration-slots", "4", "6", "--centre", "30", "--centre", "40", "--rate"]
    changed = json.loads(call(capsys, *words)[1])["process"]
    assert changed == str(Bell(duration_slots=(4, 6), centres=(30, 40), rate=True, overnight=False))


def test_mistakes_are_said_before_anything_is_written(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = tmp_path / "storms.xlsx"
    code, out, err = call(capsys, "scenarios", "ieee33", "--out", str(path))
    assert (code, out) == (1, "")
    assert "allowed suffixes: .npz, .csv" in err
    code, _, err = call(capsys, "scenarios", "ieee33", "--probability", "1")
    assert code == 1
    assert "probability 1.0; allowed: 0 up to, but not, 1" in err
    assert not list(tmp_path.iterdir())


def test_days_beyond_the_profiles_are_refused_before_anything_is_drawn(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, err = call(capsys, "scenarios", "ieee33-tou", "--days", "62", "-n", "2", "--json")
    assert (code, json.loads(out)["days"], err) == (0, 62, "")
    monkeypatch.setattr(draw, "draw_day", None)
    code, _, err = call(capsys, "scenarios", "ieee33-tou", "--days", "63")
    assert code == 1
    assert "--days 63 of case 'ieee33-tou'; allowed: 1 to 62, the 62 of its profiles\nhint" in err
    with pytest.raises(rs.UsageError, match="allowed: 1 to 10416, 1,000,000 slots"):
        draw.draw(feeder(), 2, 0, days=10417)


def test_a_full_memory_is_an_error_with_a_remedy(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(draw, "draw_day", lambda *_: np.zeros((2**40, 2**10)))
    code, _, err = call(capsys, "scenarios", "ieee33-tou", "-n", "3")
    assert (code, err.splitlines()[0]) == (1, "error: the memory is full")
    assert "fewer scenarios" in err
    for command in ("scenarios", "hazard"):
        code, _, err = call(capsys, command, "ieee33_koinu", "-n", "99999999999999999999")
        assert (code, "-n" in err) == (2, True)


def test_a_plan_for_a_drawn_storm() -> None:
    case = rs.load_case("ieee33").replace(slots=96)
    drawn = case.replace(outages=sample_outages(case, Bell(), 3))
    plan = rs.solve(case, "lp", physics="copperplate", outages="bell", seed=3)
    assert plan.outages == outage_texts(drawn.outages, drawn.window)
    assert plan.outages != outage_texts(case.outages, case.window)
    with pytest.raises(rs.UsageError, match="seed 3 without a draw"):
        rs.solve(case, "lp", seed=3)
