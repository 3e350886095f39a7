"""The installed command, run as a user runs it."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import resilience as rs

PROGRESS = re.compile(r" *\d+\.\d s  ")

COMMAND = Path(sys.executable).parent / "resilience"
ISOLATED = """
mpc.version = '2';
mpc.baseMVA = 10;
mpc.bus = [
    1 3 0 0 0 0 1 1 0 12.66 1 1.1 0.9;
    2 1 0.8 0.2 0 0.6 1 1 0 12.66 1 1.1 0.9;
    3 4 0.5 0 0 0 1 1 0 12.66 1 1.1 0.9;
];
mpc.gen = [ 1 0 0 10 -10 1 100 1 10 0; ];
mpc.branch = [ 1 2 0.01 0.02 0 0 0 0 0.95 0 1 -360 360; ];
mpc.if_lims = [ 1 10 20; ];
"""
HEAVY = {"pandas", "pandapower", "pyomo", "casadi", "cvxpy", "torch", "matplotlib"}

TINY = """
name = "tiny"
[network]
bus = [{ name = "1", vn_kv = 12.66 }]
[time]
start = 2016-07-12T00:00:00
slots = 4
step_min = 60.0
[[load]]
name = "town"
bus = "1"
p_max_mw = 2.0
shed_cost_per_mwh = 10.0
[[generator]]
name = "diesel"
bus = "1"
p_max_mw = 1.5
cost_per_mwh = 1.0
"""


def run(*arguments: str | Path, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"NO_COLOR": "1", "COLUMNS": "100"}
    words = [str(COMMAND), *map(str, arguments)]
    return subprocess.run(
        words, check=False, capture_output=True, text=True, cwd=cwd, env=environment
    )


@pytest.fixture
def tiny(tmp_path: Path) -> Path:
    path = tmp_path / "tiny.toml"
    path.write_text(TINY, encoding="utf-8")
    return path


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import sys\nfrom resilience.cli import main\n"
        "try:\n    main(['--help'])\nexcept SystemExit:\n    pass\n"
        "print('MODULES', *sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    modules = set(done.stdout.rpartition("MODULES")[2].split())
    assert "typer" in modules
    assert not modules & HEAVY


def test_solve_prints_the_verdict_and_what_it_assumed(tiny: Path) -> None:
    done = run("solve", tiny, "--method", "lp")
    assert done.returncode == 0, done.stderr
    # 1.5 MW of diesel at 1 $/MWh and 0.5 MW shed at 10 $/MWh for 4 h: 6 + 20 = 26 $
    assert "objective 26.0000 $" in done.stdout
    assert "assumes no outage" in done.stdout
    assert "Shed: 2.000 MWh" in done.stdout
    assert "sources of its island are at their limits" in done.stdout
    assert "\x1b" not in done.stdout
    # A slow machine says how far it is; nothing else is to be said.
    assert not [line for line in done.stderr.splitlines() if not PROGRESS.match(line)]


def test_assumed_outages_are_printed_with_their_warning() -> None:
    done = run("solve", "ieee33", "--method", "lp", "--outages", "6-26@14:00-17:30")
    assert done.returncode == 0, done.stderr
    assert "assumes 6-26@14:00-17:30" in done.stdout
    assert "knows it in advance" in done.stdout


def test_json_is_one_object_with_the_promised_keys() -> None:
    done = run("solve", "ieee33", "--method", "lp", "--json")
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    promised = ["status", "objective", "bound", "gap", "relaxed"]
    promised += ["audit", "costs", "shed_mwh", "seconds"]
    assert set(promised) <= set(answer)
    assert answer["status"] == "optimal"
    assert answer["relaxed"] == []
    assert 0.0 <= max(answer["audit"].values()) < 1e-9
    assert answer["bound"] <= answer["objective"] + 1e-9
    total = sum(answer["costs"].values()) - answer["terminal_credit"]
    assert total == pytest.approx(answer["objective"])


def test_out_writes_tables_that_plot_and_solve_read_again(tiny: Path, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    done = run("solve", tiny, "--method", "lp", "--out", folder)
    assert done.returncode == 0, done.stderr
    names = {path.name for path in folder.iterdir()}
    assert {"summary.json", "case.toml", "power.csv", "power.parquet", "shed.csv"} <= names
    assert run("plot", folder).returncode == 0
    assert (folder / "plan.png").stat().st_size > 10_000
    again = run("solve", folder / "case.toml", "--method", "lp", "--json", cwd=tmp_path)
    assert json.loads(again.stdout)["objective"] == pytest.approx(26.0)


def test_a_comparison_is_saved_drawn_and_drawn_again(tiny: Path, tmp_path: Path) -> None:
    wires = 'bus = [{ name = "1", vn_kv = 9.9 }, { name = "2", vn_kv = 9.9 }]\n'
    wires += 'line = [{ from = "1", to = "2", r_ohm = 0.5, x_ohm = 0.3 }]\n'
    wires += '[[line]]\nname = "1-2"\nbreakpoint = true\n'
    text = TINY.replace('bus = [{ name = "1", vn_kv = 12.66 }]\n', wires)
    text += '[[ess]]\nname = "battery"\nbus = "1"\np_max_mw = 1.0\ne_mwh = 2.0\n'
    tiny.write_text(text.replace("slots = 4", "slots = 24"), encoding="utf-8")
    folder, picture = tmp_path / "run", tmp_path / "report.png"
    compare: list[str | Path] = [
        "compare",
        tiny,
        "--days",
        "1",
        "--draws",
        "2",
        "--methods",
        "idle",
    ]
    done = run(*compare, "--out", folder, "--plot", picture)
    assert done.returncode == 0, done.stderr
    assert "Best is " in done.stdout
    assert "\x1b" not in done.stdout
    assert picture.stat().st_size > 10_000
    done = run("plot", folder)
    assert done.stdout == f"{folder / 'report.png'}\n"
    assert f"resilience plot {folder} --method" in done.stderr
    done = run("plot", folder, "--method", "idle", "--episode", "2", "--day", "1")
    assert done.stdout == f"{folder / 'storm-idle.png'}\n"
    done = run("plot", folder, "--method", "idle", "--episode", "3")
    assert done.returncode == 1
    assert "episode 3; allowed: 1 to 2\nhint: episodes count from 1" in done.stderr


def test_an_earlier_result_is_replaced_and_nothing_else(tiny: Path, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    assert run("solve", tiny, "--method", "lp", "--out", folder).returncode == 0
    (folder / "stale.txt").write_text("old", encoding="utf-8")
    assert run("solve", tiny, "--method", "lp", "--out", folder).returncode == 0
    assert not (folder / "stale.txt").exists()
    (folder / "summary.json").unlink()
    refused = run("solve", tiny, "--method", "lp", "--out", folder)
    assert refused.returncode == 1
    assert "is not empty and holds no earlier result" in refused.stderr
    assert sorted(p.name for p in tmp_path.iterdir()) == ["run", "tiny.toml"]


def test_a_bad_case_gets_one_list_and_writes_nothing(tiny: Path, tmp_path: Path) -> None:
    tiny.write_text(TINY.replace("p_max_mw = 2.0", 'p_max_mw = -2.0\nbuss = "7"'), encoding="utf-8")
    folder = tmp_path / "run"
    done = run("solve", tiny, "--out", folder)
    assert done.returncode == 1
    assert done.stdout == ""
    assert "2 mistakes in the case" in done.stderr
    assert done.stderr.count("hint:") == 2
    assert "did you mean" in done.stderr
    assert not folder.exists()


def test_an_infeasible_case_names_rows_and_slots(tiny: Path, tmp_path: Path) -> None:
    must_take = '\n[[pv]]\nname = "sun"\nbus = "1"\np_max_mw = 5.0\ncurtailable = false\n'
    tiny.write_text(TINY + must_take, encoding="utf-8")
    done = run("solve", tiny, "--method", "lp", "--out", tmp_path / "run")
    assert done.returncode == 1
    assert "no plan satisfies the lindistflow model" in done.stderr
    assert "balance.p[1, 0" in done.stderr
    assert "hint:" in done.stderr
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("suffix", ["lp", "mps", "nl"])
def test_the_model_is_exported(tiny: Path, tmp_path: Path, suffix: str) -> None:
    target = tmp_path / f"model.{suffix}"
    done = run("solve", tiny, "--method", "lp", "--export", target)
    assert done.returncode == 0, done.stderr
    assert target.stat().st_size > 200


@pytest.mark.parametrize("method", ["stochastic", "rule"])
def test_a_model_over_scenarios_is_refused_before_the_case_is_read(
    tmp_path: Path, method: str
) -> None:
    target = tmp_path / "model.lp"
    done = run("solve", tmp_path / "none.toml", "--method", method, "--export", target)
    assert done.returncode == 1
    assert f"error: the model of a plan over scenarios, as by method {method}" in done.stderr
    assert "hint: export that of a single storm" in done.stderr


def test_unknown_words_are_refused_with_a_hint() -> None:
    for words in (["--method", "magic"], ["--physics", "dc"], ["--plot", "plan.xls"]):
        done = run("solve", "ieee33", *words)
        assert done.returncode == 1
        assert "hint:" in done.stderr
    assert run("solve").returncode == 2


def test_new_check_show_and_solve(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    assert run("case", "new", "case33bw", "--out", path).returncode == 0
    assert run("case", "new", "case33bw", "--out", path).returncode == 1
    assert "is a valid case" in run("case", "check", path).stdout
    assert "33 buses" in run("case", "show", path).stdout
    done = run("solve", path, "--method", "lp", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["shed_mwh"] == 0.0


def test_cases_are_known_by_name_from_anywhere(tmp_path: Path) -> None:
    assert "ieee33" in run("case", "list", cwd=tmp_path).stdout.split()
    assert "is a valid case" in run("case", "check", "ieee33", cwd=tmp_path).stdout


def test_verbose_prints_phases_to_stderr(tiny: Path) -> None:
    done = run("solve", tiny, "--method", "socp", "--physics", "copperplate", "-v")
    assert done.returncode == 0
    assert "conic relaxation" in done.stderr
    assert "conic relaxation" not in done.stdout.partition("time:")[0]


def test_what_of_a_network_is_not_modelled_is_said_by_every_command(tmp_path: Path) -> None:
    (tmp_path / "isolated.m").write_text(ISOLATED, encoding="utf-8")
    case, said = (
        tmp_path / "isolated.toml",
        "not modelled: 1 isolated bus of 0.5 MW (3); 1 table (mpc.if_lims)",
    )
    new = run("case", "new", tmp_path / "isolated.m", "--out", case)
    assert new.stderr.splitlines() == [said]
    assert f"warning: {said}\n" in run("case", "check", case).stdout
    solved = run("solve", case, "--method", "lp")
    assert f"assumes no outage\n{said}\n" in solved.stdout
    parts = ["1 isolated bus of 0.5 MW (3)", "1 table (mpc.if_lims)"]
    known, blind = tmp_path / "known", tmp_path / "blind"
    answer = json.loads(run("solve", case, "--method", "lp", "--json", "--out", known).stdout)
    assert answer["not_modelled"] == rs.load_plan(known).not_modelled == parts
    (tmp_path / "calm.csv").write_text("scenario,line,first,stop,weight\n0,,,,1\n")
    words = ("--method", "rule", "--outages", tmp_path / "calm.csv", "--json", "--out", blind)
    answer = json.loads(run("solve", case, *words).stdout)
    assert answer["not_modelled"] == rs.load_scenario_plan(blind).not_modelled == parts


def test_prices_are_printed_and_written(tiny: Path, tmp_path: Path) -> None:
    """The diesel gives all it has at 1 $/MWh, and a MWh more of demand would be shed at 10 $."""
    done = run("solve", tiny, "--method", "lp", "--prices", "--out", tmp_path / "run")
    assert done.returncode == 0, done.stderr
    assert "Prices at buses: means" in done.stdout
    row = next(line.split() for line in done.stdout.splitlines() if "02:00-03:00" in line)
    assert row == ["02:00-03:00", "10", "all", "10", "10", "all"]
    saved = rs.load_plan(tmp_path / "run")
    assert set(saved.tables["bus_price"]["1"].round(6)) == {10.0}
    as_json = json.loads(run("solve", tiny, "--method", "lp", "--prices", "--json").stdout)
    assert [round(hour["mean"], 6) for hour in as_json["prices"]] == [10.0] * 4
    assert [hour["ends"][11:] for hour in as_json["prices"]][-2:] == ["03:00:00", "04:00:00"]
    without = run("solve", tiny, "--method", "lp", "--json").stdout
    assert "prices" not in json.loads(without)


def test_a_plan_over_scenarios_has_no_prices(tiny: Path) -> None:
    done = run("solve", tiny, "--method", "stochastic", "--prices")
    assert (done.returncode, done.stdout) == (1, "")
    assert "has no prices" in done.stderr
    assert "hint: ask for those of a single storm" in done.stderr
