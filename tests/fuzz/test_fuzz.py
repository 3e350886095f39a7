"""No file of any kind ends in a traceback, a hang, a warning or nonsense that is taken for sound.

A fair share of changed files is tried in every run, the same every time. `RESILIENCE_FUZZ=2000`
tries so many of each kind, others every time or those of `--hypothesis-seed N`; `python -m
tests.fuzz.run` goes on after a fault and counts.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings

from tests.fuzz.every import KINDS
from tests.fuzz.full_case import ELSEWHERE, allowed, dark_case, stated, stormy_case
from tests.fuzz.kinds import Files, Ground

EXAMPLES = int(os.environ.get("RESILIENCE_FUZZ", "0"))
NAMES = [
    pytest.param(name, marks=pytest.mark.slow if kind.slow else ()) for name, kind in KINDS.items()
]


@pytest.mark.parametrize("name", NAMES)
def test_sound_files_are_read(name: str, tmp_path: Path) -> None:
    assert Ground(KINDS[name], tmp_path).judge({}) == KINDS[name].unchanged


@pytest.mark.parametrize("name", NAMES)
def test_changed_files_are_read_or_refused_in_words(name: str, tmp_path: Path) -> None:
    kind = KINDS[name]
    ground = Ground(kind, tmp_path)
    verdicts = set[str]()

    @settings(
        max_examples=EXAMPLES or (40 if kind.slow else 60),
        derandomize=not EXAMPLES,
        database=None,
        deadline=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(ground.changes)
    def judged(changed: Files) -> None:
        verdicts.add(ground.judge(changed))

    judged()
    assert "refused" in verdicts


def test_the_cases_that_are_changed_state_every_key() -> None:
    """A new key that no sound case states would never be changed."""
    changed = {*stated(stormy_case()), *stated(dark_case())}
    assert set(allowed()) - changed == set(ELSEWHERE)
