"""Scenarios as arrays and as files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from resilience.errors import CaseError, FileError, UsageError
from resilience.fragility import Bell, Scenarios, load_scenarios, sample_bell
from tests.unit.fragility.storms import LINES, feeder

CASE = feeder()
DRAWN = sample_bell(CASE, Bell(probability=0.4), 40, 1)
HEAD = "scenario,line,first,stop,weight\n"


def weighted() -> Scenarios:
    weight = np.arange(1.0, DRAWN.n + 1)
    return Scenarios(DRAWN.lines, DRAWN.down, weight / weight.sum(), DRAWN.centre, 1, "weighted")


def test_npz_keeps_everything(tmp_path: Path) -> None:
    kept = weighted()
    kept.save(tmp_path / "a.npz")
    found = load_scenarios(tmp_path / "a.npz", CASE)
    for name in ("down", "probability", "centre"):
        assert np.array_equal(getattr(found, name), getattr(kept, name))
    assert (found.lines, found.seed, found.process) == (kept.lines, 1, "weighted")


def test_csv_keeps_outages_and_weights(tmp_path: Path) -> None:
    kept = weighted()
    quiet = ~kept.down.any(axis=(0, 1))
    assert quiet.any()
    kept.save(tmp_path / "a.csv")
    found = load_scenarios(tmp_path / "a.csv", CASE)
    assert np.array_equal(found.line_up(LINES), kept.line_up(LINES))
    assert found.probability == pytest.approx(kept.probability)
    assert found.events() == kept.events()


def test_csv_from_elsewhere(tmp_path: Path) -> None:
    path = tmp_path / "mine.csv"
    path.write_text("\ufeffline,stop,first,scenario,weight\n2-3,8,4,0,3\n2-3,20,12,0,3\n,,,2,1\n")
    found = load_scenarios(path, CASE)
    assert found.events() == [(0, "2-3", 4, 8), (0, "2-3", 12, 20)]
    assert found.probability == pytest.approx([0.6, 0.2, 0.2])
    assert list(np.flatnonzero(~found.line_up(["1-2", "2-3"])[1, :, 0])) == [
        *range(4, 8),
        *range(12, 20),
    ]
    assert found.line_up(["1-2"]).all()


def test_every_bad_row_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(
        HEAD + "0,1-2,4,8,1\n-1,1-2,4,8,1\n1,2-1,4,8,1\n2,1-2,9,9,1\n3,1-2,90,97,1\n"
        "4,1-2,x,8,1\n0,1-2,20,24,2\n5,1-2,4,8,many\n6,1-2,4\n"
    )
    with pytest.raises(CaseError) as caught:
        load_scenarios(path, CASE)
    found = [(p.table, p.key, p.value, p.allowed) for p in caught.value.mistakes]
    assert found == [
        ("row 3", "scenario", "'-1'", "a whole number, 0 to 1000000"),
        ("row 4", "line", "'2-1'", "a line of the network, or a unit"),
        ("row 5", "stop", "'9'", "a whole number, 10 to 96"),
        ("row 6", "stop", "'97'", "a whole number, 91 to 96"),
        ("row 7", "first", "'x'", "a whole number, 0 to 95"),
        ("row 8", "weight", "'2'", "1, as in an earlier row of scenario 0"),
        ("row 9", "weight", "'many'", "a number, 0 or more"),
        ("row 10", "stop", "''", "a whole number, 5 to 96"),
    ]
    assert all(p.hint for p in caught.value.mistakes)
    assert "did you mean 1-2?" in str(caught.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [("scenario,line,first\n", "stop"), ("", "no columns"), (HEAD, "a row per outage")],
)
def test_a_file_without_columns_or_rows(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(CaseError, match=words):
        load_scenarios(path, CASE)


def test_files_that_do_not_fit(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="does not exist"):
        load_scenarios(tmp_path / "none.npz", CASE)
    with pytest.raises(UsageError, match=r"allowed suffixes: \.npz, \.csv"):
        DRAWN.save(tmp_path / "a.xlsx")
    (tmp_path / "b.npz").write_bytes(b"not a zip file")
    with pytest.raises(UsageError, match="holds no scenarios"):
        load_scenarios(tmp_path / "b.npz", CASE)
    DRAWN.save(tmp_path / "a.npz")
    with pytest.raises(UsageError, match="96 slots; allowed: 192"):
        load_scenarios(tmp_path / "a.npz", feeder(days=2))
    other = Scenarios(("9-9",), DRAWN.down[:1], DRAWN.probability)
    other.save(tmp_path / "c.npz")
    with pytest.raises(UsageError, match="line '9-9' is not in case"):
        load_scenarios(tmp_path / "c.npz", CASE)
    (tmp_path / "zero.csv").write_text(HEAD + "0,1-2,4,8,0\n")
    with pytest.raises(UsageError, match="all weights are 0"):
        load_scenarios(tmp_path / "zero.csv", CASE)


def test_a_failed_save_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.npz"
    DRAWN.save(path)
    before = path.read_bytes()

    def full(*_: object, **__: object) -> None:
        raise OSError("disk full")

    monkeypatch.setattr(np, "savez_compressed", full)
    with pytest.raises(FileError, match="disk full"):
        weighted().save(path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["a.npz"]


def test_chosen_scenarios_keep_their_odds() -> None:
    kept = weighted()
    some = kept.chosen([1, 3])
    assert some.probability == pytest.approx([2 / 6, 4 / 6])
    assert np.array_equal(some.down, kept.down[:, :, [1, 3]])
    assert some.centre is not None
    assert some.centre.shape == (1, 2)


@pytest.mark.parametrize("weights", [[0.5, 0.6], [1.5, -0.5], [np.nan, 1.0]])
def test_weights_are_probabilities(weights: list[float]) -> None:
    with pytest.raises(UsageError, match="probabilities add up to"):
        Scenarios(("1-2",), np.zeros((1, 4, 2), bool), np.array(weights))


def test_shapes_match() -> None:
    with pytest.raises(UsageError, match=r"allowed: \(1, 4, 2\)"):
        Scenarios(("1-2",), np.zeros((2, 4, 2), bool), np.array([0.5, 0.5]))
