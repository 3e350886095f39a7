"""Models written out: what a format cannot hold is refused in words."""

from __future__ import annotations

from pathlib import Path

import pytest

import resilience as rs
from resilience.planning.solve import export_model
from resilience.testing import small_case


def ring() -> rs.Case:
    return small_case(
        slots=1,
        buses=3,
        lines=[(1, 2, 0.01, 0.02), (2, 3, 0.01, 0.02), (3, 1, 0.01, 0.02)],
        load=[{"bus": "3", "p_max_mw": 0.5, "shed_cost_per_mwh": 100.0}],
        grid=[{"import_max_mw": 1.0, "q_max_mvar": 1.0, "import_cost_per_mwh": 10.0}],
    )


@pytest.mark.parametrize("suffix", ["lp", "mps"])
def test_sines_of_loops_are_refused_where_a_format_has_none(tmp_path: Path, suffix: str) -> None:
    plan, target = rs.solve(ring(), "nlp"), tmp_path / f"model.{suffix}"
    with pytest.raises(rs.UsageError, match=rf"sines, which no \.{suffix} file holds") as refused:
        export_model(plan, target)
    assert "--method lp" in refused.value.hint
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("method", "suffix"), [("nlp", "nl"), ("lp", "lp"), ("lp", "mps")])
def test_a_mesh_is_written_where_its_angles_can_be(
    tmp_path: Path, method: str, suffix: str
) -> None:
    target = tmp_path / f"model.{suffix}"
    export_model(rs.solve(ring(), method), target)
    assert target.stat().st_size > 200
