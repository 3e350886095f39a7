"""Settings of algorithms say what they are, and refuse what they cannot be."""

from __future__ import annotations

from dataclasses import fields

import pytest

torch = pytest.importorskip("torch", reason="learners need torch")

from resilience.cli import main  # noqa: E402
from resilience.errors import UsageError  # noqa: E402
from resilience.rl.algorithms.described import described  # noqa: E402
from resilience.rl.algorithms.registry import ALGORITHMS, algorithm  # noqa: E402

KINDS: list[tuple[str, dict[str, str]]] = [
    *((name, {}) for name in ALGORITHMS),
    ("maddpg", {"variant": "paper"}),
]


@pytest.mark.parametrize(("method", "variant"), KINDS)
def test_every_setting_is_described(method: str, variant: dict[str, str]) -> None:
    kind = algorithm(method).settings_kind(**variant)
    settings = described(kind)
    assert [setting.name for setting in settings] == [field.name for field in fields(kind)]
    assert all(setting.about.endswith(".") or ";" in setting.about for setting in settings)


def test_the_words_are_those_of_the_docstring() -> None:
    (carried,) = [
        s for s in described(algorithm("apg").settings_kind()) if s.name == "carried_start"
    ]
    assert carried.default == 0.7
    assert carried.about == (
        "share of episodes that start with what an earlier one ended with; the others start with a "
        "random state of charge."
    )


def test_all_values_that_cannot_be_are_listed() -> None:
    with pytest.raises(UsageError) as error:
        algorithm("apg").settings_of({"batch": "many", "learning_rate": 0.1, "hidden": 7})
    assert "batch 'many'" in error.value.message
    assert "hidden 7" in error.value.message
    assert "learning_rate" not in error.value.message


def test_the_command_prints_them(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ["resilience", "train", "--method", "maddpg", "--settings", "--set", "variant=paper"]
    monkeypatch.setattr("sys.argv", words)
    with pytest.raises(SystemExit) as done:
        main()
    assert not done.value.code
    out = capsys.readouterr().out
    assert "update_every" in out
    assert "affine" in out
