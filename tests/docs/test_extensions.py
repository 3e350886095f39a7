"""CONTRIBUTING.md: every row of its table of extensions is done, with a throw-away extension."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.optimize import linprog

import resilience as rs
from resilience.arrays import Floats
from resilience.case.networks.feeder import Branch, Feeder, make_network
from resilience.case.networks.read import READERS
from resilience.dispatch.registry import DISPATCHERS
from resilience.fragility import CURVES, hardened
from resilience.fragility.tracks import Track, read_track, track_of
from resilience.fragility.tracks.columns import About
from resilience.fragility.tracks.read import FORMATS, TrackFormat
from resilience.fragility.wind.asymmetry import Share
from resilience.fragility.wind.eye import Eye
from resilience.fragility.wind.fields import MODELS, Model
from resilience.models.backends.base import INFEASIBLE, LeafCuts, Solution
from resilience.models.methods import METHODS
from resilience.models.methods.linear import lp
from resilience.models.program.standard import Standard, Vectors
from resilience.models.structures import Structure
from resilience.simulation.observation import Observation
from resilience.simulation.setting import Setting
from resilience.testing import check_backend, check_dispatcher
from tests.docs.pages import ROOT

TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
TABLE = TEXT.partition("## Extensions")[2]
ROWS = {
    cells[0]: cells[1:]
    for line in TABLE.splitlines()
    if line.startswith("| ") and (cells := [cell.strip() for cell in line.strip("|").split("|")])
}
ELSEWHERE = {
    "algorithm": "tests/unit/rl/test_guide.py",
    "component": "tests/golden/test_golden.py",
    "structure": "tests/conformance/test_conformance.py",
}


def test_every_extension_of_the_table_is_tried() -> None:
    tried = {
        name.removeprefix("test_a_new_").replace("_", " ")
        for name in globals()
        if name.startswith("test_a_new_")
    }
    assert set(ROWS) - {"extension"} == tried | set(ELSEWHERE)


@pytest.mark.parametrize("name", sorted(set(ROWS) - {"extension"}))
def test_every_file_of_the_table_exists_and_holds_its_table(name: str) -> None:
    paths = re.findall(r"`((?:resilience|tests|docs)/[\w./]*)`", " ".join(ROWS[name]))
    assert len(paths) >= 2
    for path in (*paths, ELSEWHERE.get(name, "tests/docs/test_extensions.py")):
        assert (ROOT / path).exists(), path
    for table, path in re.findall(r"`([A-Z]+)` in `([\w./]+)`", ROWS[name][1]):
        files = sorted((ROOT / path).glob("*.py")) if path.endswith("/") else [ROOT / path]
        texts = [file.read_text(encoding="utf-8") for file in files]
        assert any(re.search(rf"(?m)^{table}\b.* = ", text) for text in texts), (table, path)


def test_layers_are_those_of_the_import_contract() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contract = project["tool"]["importlinter"]["contracts"][0]["layers"]
    section = TEXT.partition("## Layers")[2].partition("## Names")[0]
    rows = [line.split("|")[1] for line in section.splitlines() if line.startswith("| `")]
    assert [set(re.findall(r"`(\w+)`", row)) for row in rows] == [
        {name.strip() for name in layer.split("|")} for layer in contract
    ]


def variant(folder: Path, base: str, text: str) -> rs.Case:
    """A case file that changes a few keys of an installed one."""
    path = folder / "case.toml"
    path.write_text(f'extends = "{base}"\n{text}', encoding="utf-8")
    return rs.load_case(path)


def chances(case: rs.Case) -> dict[str, float]:
    """Probability of failure of every line but 1-2, which has a curve of its own."""
    rows = rs.hazard(case).lines
    return {row["line"]: row["failure_probability"] for row in rows if row["line"] != "1-2"}


def test_a_new_wind_field(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def calm(r_m: Floats, eye: Eye, share: Share) -> Floats:
        return np.full(np.broadcast_shapes(r_m.shape, eye.vmax_mps.shape), 0.5)

    monkeypatch.setitem(MODELS, "calm", Model(calm, "climada", "made up", "nothing"))
    case = variant(tmp_path, "ieee33_koinu", '[storm]\nwind = "calm"\n')
    assert max(chances(case).values()) == pytest.approx(0.0, abs=1e-9)


def test_a_new_fragility_curve(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(CURVES, "granite", hardened(CURVES["pole"], 20.0))
    shipped = variant(tmp_path, "ieee33_koinu", '[storm]\npole = "granite"\n')
    stated = variant(
        tmp_path,
        "ieee33_koinu",
        '[storm]\npole = "straw"\n[storm.curves.straw]\nmedian_mps = 9.0\nbeta = 0.2\n'
        "averaging_s = 3.0\n",
    )
    assert max(chances(shipped).values()) < 1e-6
    assert min(chances(stated).values()) > 1.0 - 1e-6


def test_a_new_track_format(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def parse(text: str, about: About, storm: str | None, agency: str | None) -> Track:
        rows = np.array([line.split() for line in text.splitlines()[1:]], float)
        times = np.datetime64("2023-10-04T02:00:00") + (3600 * rows[:, 0]).astype("timedelta64[s]")
        columns: dict[str, Any] = {"time": times, "vmax_mps": rows[:, 3]}
        columns |= {"lat": rows[:, 1], "lon": rows[:, 2]}
        return track_of(columns, name="Toy", averaging_s=60.0)

    toy = TrackFormat(lambda line: line.startswith("TOY"), parse)
    monkeypatch.setitem(FORMATS, "toy", toy)
    path = tmp_path / "storm.txt"
    path.write_text("TOY\n3 21.5 122.0 45\n9 22.5 121.0 40\n15 23.5 119.5 35\n", encoding="utf-8")
    track = read_track(path)
    assert track.name == "Toy"
    assert track.lat.tolist() == [21.5, 22.5, 23.5]
    assert read_track(path, format="toy").vmax_mps.tolist() == [45.0, 40.0, 35.0]


def test_a_new_network_format(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def read(path: Path) -> Feeder:
        r_pu = float(path.read_text(encoding="utf-8"))
        network = make_network([("a", 10.0), ("b", 10.0)], [Branch("a", "b", r_pu, 2.0 * r_pu)])
        return Feeder(network)

    monkeypatch.setitem(cast(dict[str, Any], READERS), ".toy", read)
    (tmp_path / "net.toy").write_text("0.03", encoding="utf-8")
    (tmp_path / "case.toml").write_text(
        'name = "toy"\n[time]\nstart = 2016-07-12T05:00:00\nslots = 2\nstep_min = 30\n'
        '[network]\nfile = "net.toy"\n[[grid]]\nname = "utility"\nbus = "a"\nimport_max_mw = 3.0\n'
        'import_cost_per_mwh = 0.4\n[[load]]\nbus = "b"\nname = "town"\n'
        "p_max_mw = 1.5\nshed_cost_per_mwh = 9.0\n",
        encoding="utf-8",
    )
    case = rs.load_case(tmp_path / "case.toml")
    assert case.network.x_pu.tolist() == [0.06]
    assert rs.solve(case, "lp").objective == pytest.approx(1.5 * 0.4, rel=1e-6)


class Full:
    """Charges what it can."""

    def __init__(self, setting: Setting) -> None:
        self.name = "full"

    def act(self, observation: Observation) -> Floats:
        """More than any unit takes."""
        return np.full_like(observation.energy, 99.0)


def test_a_new_dispatcher(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(DISPATCHERS, "full", Full)
    check_dispatcher(Full)
    report = rs.compare("ieee33-tou", ["full"], days=1, draws=1, seed=3)
    assert (report.objective["full"] >= report.bound).all()
    case = rs.load_case("ieee33").replace(slots=8, outages=())
    plan = rs.solve(case, "full", seed=3)
    assert plan.method == "full"


def test_a_new_method(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(METHODS, "copper", (lp, "copperplate"))
    case = rs.load_case("ieee33").replace(slots=8, outages=())
    plan = rs.solve(case, "copper")
    assert (plan.method, plan.physics) == ("copper", "copperplate")
    assert plan.objective == pytest.approx(rs.solve(case, "lp", physics="copperplate").objective)


class SciPy:
    """HiGHS as SciPy has it: linear programs, and none of the structures."""

    exact: frozenset[type[Structure]] = frozenset()
    integers = False

    def __init__(self, standard: Standard) -> None:
        self.standard, self.cuts = standard, LeafCuts(standard)
        self.rows: list[tuple[Floats, float]] = []

    def update(self, vectors: Vectors) -> None:
        self.vectors = vectors

    def add_cuts(self, node: int, alpha: Floats, beta: Floats) -> None:
        columns, values = self.cuts.add(node, alpha, beta)
        for row, right in zip(values, -np.asarray(alpha), strict=True):
            dense = np.zeros(self.standard.n_columns)
            dense[columns] = row
            self.rows.append((dense, float(right)))

    def solve(self) -> Solution:
        v, a = self.cuts.with_futures_open(self.vectors), self.standard.a
        equal = v.row_lower == v.row_upper
        above, below = ~equal & np.isfinite(v.row_upper), ~equal & np.isfinite(v.row_lower)
        extra = np.array([row for row, _ in self.rows]).reshape(-1, self.standard.n_columns)
        answer = linprog(
            v.cost,
            A_ub=sp.vstack([a[above], -a[below], sp.csr_array(extra)]),
            b_ub=[*v.row_upper[above], *-v.row_lower[below], *(right for _, right in self.rows)],
            A_eq=a[equal],
            b_eq=v.row_lower[equal],
            bounds=np.column_stack([v.lower, v.upper]),
        )
        if answer.status == 2:
            return INFEASIBLE
        objective = float(answer.fun + v.offset)
        return Solution("optimal", np.asarray(answer.x), objective, objective - 1e-7)


def test_a_new_backend() -> None:
    names = check_backend(SciPy)
    assert names == ("affine", "equality", "data", "chain", "fan", "durations", "terminal",
                     "terminal_fan")  # fmt: skip
