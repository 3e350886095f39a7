"""What may stand where a result is written, and what the system may refuse."""

from __future__ import annotations

import io
import json
import os
import resource
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import pytest

import resilience as rs
from resilience.case import case_text
from resilience.cli import main
from resilience.errors import FileError, UsageError
from resilience.files import HIDDEN, locked, replacing_file, staging
from resilience.parts import load_part, save_part
from resilience.results import NEXT, PLACING, PLAN, replacing
from resilience.testing import small_world
from tests.faults.kills import contents
from tests.faults.test_injected import island, storms

ROOT = Path(__file__).parents[2]
Save = Callable[[Path], object]


@pytest.fixture(scope="module")
def plan() -> rs.Plan:
    return rs.solve(island(), "lp")


@pytest.fixture(scope="module")
def results(plan: rs.Plan) -> dict[str, Save]:
    """How every kind of result is saved."""
    over = rs.solve(island().replace(outages=(), generator=()), "mpc-blind", scenarios=storms())
    compared = rs.evaluate(replace(small_world(), outlook=None), ["greedy"])
    hazard = rs.hazard("ieee33_koinu", n=5, seed=3)
    return {
        "plan": plan.save,
        "plan over scenarios": over.save,
        "comparison": compared.save,
        "hazard": hazard.save,
    }


def test_a_result_is_replaced_by_its_own_kind_only(
    results: dict[str, Save], tmp_path: Path
) -> None:
    for name, save in results.items():
        folder = tmp_path / name
        save(folder)
        (folder / "parts").mkdir()
        (folder / "parts" / "greedy.npz").write_bytes(b"hours of work")
        before = contents(folder)
        for other, save_other in results.items():
            if other != name:
                with pytest.raises(UsageError, match=r"allowed: an earlier .* or an empty folder"):
                    save_other(folder)
        assert contents(folder) == before
        save(folder)
        assert (folder / "parts").exists() == (name == "comparison")


def test_a_summary_says_its_kind(results: dict[str, Save], tmp_path: Path) -> None:
    for name, save in results.items():
        save(tmp_path / name)
        mark = "hazard.json" if name == "hazard" else "summary.json"
        assert json.loads((tmp_path / name / mark).read_text("utf-8"))["kind"] == name


@pytest.mark.parametrize("text", ["", "{}", "[]", '{"kind": "novel"}', "\udcff"])
def test_a_result_of_no_known_kind_is_not_replaced(
    plan: rs.Plan, tmp_path: Path, text: str
) -> None:
    path = tmp_path / "summary.json"
    path.write_bytes(os.fsencode(text))
    with pytest.raises(UsageError, match="allowed: an earlier plan, or an empty folder"):
        plan.save(tmp_path)
    assert path.read_bytes() == os.fsencode(text)


@pytest.mark.parametrize("stage", [NEXT, PLACING])
def test_readers_and_writers_finish_what_was_finished(
    plan: rs.Plan, tmp_path: Path, stage: str
) -> None:
    """A process was killed when all was written, and nothing or some of it was in place."""
    other = rs.solve(island().replace(outages=()), "milp")
    for finish in (rs.load_plan, plan.save):
        folder, aside = tmp_path / "run", tmp_path / "aside"
        for saved in (folder, aside):
            shutil.rmtree(saved, ignore_errors=True)
        other.save(folder)
        plan.save(aside)
        aside.rename(folder / stage)
        (folder / "summary.json").unlink()
        if stage == PLACING:
            for path in folder.glob("*.*"):
                path.unlink(missing_ok=True) if path.is_file() else None
            (folder / PLACING / "case.toml").rename(folder / "case.toml")
        finish(folder)
        assert rs.load_plan(folder).summary() == plan.summary()
        assert not [path for path in folder.iterdir() if path.name.startswith(HIDDEN)]


def test_nobody_reads_while_a_result_is_put_in_place(plan: rs.Plan, tmp_path: Path) -> None:
    plan.save(tmp_path / "run")
    read: list[rs.Plan] = []
    reader = threading.Thread(target=lambda: read.append(rs.load_plan(tmp_path / "run")))
    with locked(tmp_path / "run"):
        reader.start()
        reader.join(0.3)
        assert not read
    reader.join(30.0)
    assert read[0].summary() == plan.summary()


def test_writers_and_readers_at_the_same_time_meet_whole_plans(
    plan: rs.Plan, tmp_path: Path
) -> None:
    other = rs.solve(island().replace(outages=()), "milp")
    plan.save(tmp_path / "run")
    known, faults = [plan.summary(), other.summary()], list[object]()

    def work(turn: Callable[[], object]) -> None:
        try:
            for _ in range(4):
                turn()
        except BaseException as error:
            faults.append(error)

    def read() -> None:
        if rs.load_plan(tmp_path / "run").summary() not in known:
            faults.append("another plan")

    turns = [partial(saved.save, tmp_path / "run") for saved in (plan, other, other)]
    threads = [threading.Thread(target=work, args=(turn,)) for turn in (*turns, read, read)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert faults == []
    assert not [path for path in (tmp_path / "run").iterdir() if path.name.startswith(HIDDEN)]


def test_what_is_at_work_is_not_taken_for_abandoned(tmp_path: Path) -> None:
    left = tmp_path / f"{HIDDEN}abandon1"
    left.mkdir()
    with staging(tmp_path) as first:
        assert not left.exists()
        with staging(tmp_path) as second:
            assert first.is_dir()
        assert not second.exists()
    assert not list(tmp_path.iterdir())


def test_a_link_stays_and_what_it_names_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir()
    link, target = tmp_path / "link.txt", tmp_path / "disk" / "there.txt"
    link.symlink_to(target)
    for text in ("first", "second"):
        with replacing_file(link) as fresh:
            fresh.write_text(text, encoding="utf-8")
        assert link.is_symlink()
        assert target.read_text(encoding="utf-8") == text


def test_permissions_are_what_the_user_asks_for(plan: rs.Plan, tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        plan.save(tmp_path / "run")
    finally:
        os.umask(before)
    assert (tmp_path / "run").stat().st_mode & 0o777 == 0o750
    assert {path.stat().st_mode & 0o777 for path in (tmp_path / "run").iterdir()} == {0o640}


def test_a_part_that_is_damaged_or_changed_is_missing(tmp_path: Path) -> None:
    path = tmp_path / "methods.json"
    values = {"mean": 12.5, "rows": [3, "rule"]}
    assert load_part(path) is None
    save_part(path, values)
    assert load_part(path) == values
    text = path.read_text(encoding="utf-8")
    for torn in ("", text[:-9], "[]", text.replace("12.5", "12.25"), text.replace('"sha', '"shb')):
        path.write_text(torn, encoding="utf-8")
        assert load_part(path) is None


@dataclass(frozen=True)
class Command:
    """A command that writes: its words, and the option that says where."""

    words: str
    option: str
    name: str


COMMANDS = [
    Command("solve CASE --method lp", "--out", "run"),
    Command("solve CASE --method lp", "--plot", "plan.png"),
    Command("solve CASE --method lp", "--export", "plan.lp"),
    Command("solve CASE --method mpc-blind --scenarios 3", "--out", "run"),
    Command("compare CASE --methods idle --draws 2 --days 1", "--out", "run"),
    Command("compare CASE --methods idle --draws 2 --days 1", "--plot", "report.png"),
    Command("hazard ieee33_koinu -n 5", "--out", "run"),
    Command("hazard ieee33_koinu -n 5", "--plot", "map.png"),
    Command("scenarios CASE -n 3", "--out", "storms.npz"),
    Command("case new case9", "--out", "mine.toml"),
    Command("train CASE --iterations 1", "--out", "run"),
    Command("reproduce CASE --quick", "--out", "run"),
    Command("plot RUN", "--out", "plan.png"),
]


def run(words: str, capsys: pytest.CaptureFixture[str], **paths: Path) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of a command."""
    code = 0
    try:
        main([str(paths.get(word, word)) for word in words.split()])
    except SystemExit as stop:
        code = int(stop.code or 0)
    said = capsys.readouterr()
    return code, said.out, said.err


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory, plan: rs.Plan) -> Path:
    """A folder with a case, a plan, and a file where folders are asked for."""
    folder = tmp_path_factory.mktemp("place")
    (folder / "case.toml").write_text(case_text(island()), encoding="utf-8")
    (folder / "file").write_text("mine", encoding="utf-8")
    plan.save(folder / "plan")
    return folder


WRONG = {
    "below a file": ("file/{name}", "not a directory", "a file stands where a folder is needed"),
    "a long name": ("{long}{name}", "name too long", "shorten the name"),
    "no place": ("/proc/nowhere/{name}", "cannot write", "name a place"),
}


@pytest.mark.parametrize("wrong", WRONG)
@pytest.mark.parametrize("command", COMMANDS, ids=lambda c: f"{c.words.split()[0]} {c.option}")
def test_what_cannot_be_written_is_refused_before_anything_is_solved(
    command: Command, wrong: str, place: Path, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(place)
    path, reason, hint = WRONG[wrong]
    target = path.format(name=command.name, long="x" * 300)
    before = contents(place)
    code, out, err = run(
        f"{command.words} {command.option} TARGET", capsys,
        CASE=place / "case.toml", RUN=place / "plan", TARGET=Path(target),
    )  # fmt: skip
    assert code == 1
    assert out == ""
    assert err.startswith("error: cannot write ")
    assert reason in err
    assert f"hint: {hint}" in err
    assert contents(place) == before
    assert not [path for path in place.rglob("*") if path.name.startswith(HIDDEN)]


LIMITED = """
import resource, sys
from resilience.cli import main
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]), resource.RLIM_INFINITY))
main(sys.argv[2:])
"""


@pytest.mark.parametrize("option", ["--out run", "--plot plan.png", "--export plan.lp"])
def test_the_answer_is_printed_before_a_disk_is_full(
    place: Path, plan: rs.Plan, tmp_path: Path, option: str
) -> None:
    assert resource.getrlimit(resource.RLIMIT_FSIZE)[1] == resource.RLIM_INFINITY
    plan.save(tmp_path / "run")
    before = contents(tmp_path)
    words = ["solve", str(place / "case.toml"), "--method", "lp", *option.split()]
    done = subprocess.run(
        [sys.executable, "-c", LIMITED, "900", *words],
        cwd=tmp_path, env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert "proven bound" in done.stdout
    name = option.split()[1]
    assert f"error: cannot write {name}: file too large\nhint: " in done.stderr
    assert "Traceback" not in done.stderr
    assert contents(tmp_path) == before
    assert not [path for path in tmp_path.rglob("*") if path.name.startswith(HIDDEN)]


def test_what_else_is_asked_for_is_written_all_the_same(
    place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise FileError("cannot write run: no space left on device", hint="free some space")

    monkeypatch.setattr(rs.Plan, "save", refuse)
    words = "solve CASE --method lp --out RUN --export MODEL"
    model = tmp_path / "m.lp"
    code, out, err = run(words, capsys, CASE=place / "case.toml", RUN=tmp_path / "run", MODEL=model)
    assert code == 1
    assert "proven bound" in out
    assert f"model: {model}\n" in out
    assert "tables:" not in out
    assert err.endswith("error: cannot write run: no space left on device\nhint: free some space\n")
    assert model.stat().st_size > 200


def test_ctrl_c_is_answered(
    place: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(text: str = "") -> Callable[..., None]:
        def stopped(*_: object, **__: object) -> None:
            raise KeyboardInterrupt(*([text] if text else []))

        return stopped

    words = "solve CASE --method lp --out RUN"
    paths = {"CASE": place / "case.toml", "RUN": place / "stopped"}
    with monkeypatch.context() as patched:
        patched.setattr(rs, "solve", stop())
        assert run(words, capsys, **paths) == (130, "", "interrupted: nothing was written\n")
        patched.setattr(rs, "solve", stop("5 of 24 parts are in run; the same command goes on"))
        code, out, err = run(words, capsys, **paths)
        assert (code, out) == (130, "")
        assert err == "interrupted: 5 of 24 parts are in run; the same command goes on\n"
    monkeypatch.setattr(rs.Plan, "save", stop())
    code, out, err = run(words, capsys, **paths)
    assert code == 130
    assert "proven bound" in out
    text = f"{paths['RUN']} is not written to the end; the same command writes it"
    assert err == f"interrupted: {text}\n"


GONE = """
import sys, time
from resilience.cli import main
sys.stdin.read()
main(sys.argv[1:])
"""


@pytest.mark.parametrize("json", [[], ["--json"]])
def test_what_nobody_reads_is_written_all_the_same(
    place: Path, plan: rs.Plan, tmp_path: Path, json: list[str]
) -> None:
    words = ["solve", str(place / "case.toml"), "--method", "lp", "--out", str(tmp_path / "run")]
    with subprocess.Popen(
        [sys.executable, "-c", GONE, *words, *json], env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        assert process.stdin
        assert process.stdout
        assert process.stderr
        process.stdout.close()
        process.stdin.close()
        errors = process.stderr.read()
    assert errors == ""
    assert rs.load_plan(tmp_path / "run").objective == pytest.approx(plan.objective)


def test_a_library_that_fails_names_the_result(tmp_path: Path) -> None:
    """What is written within is named by what the user asked for, not by where it is at first."""

    def fail() -> None:
        with replacing(tmp_path / "run", PLAN) as target, replacing_file(target / "t") as fresh:
            fresh.mkdir()
            fresh.write_text("", encoding="utf-8")

    with pytest.raises(FileError, match=r"cannot write \S*run: is a directory") as error:
        fail()
    assert error.value.hint == "name a file in that folder"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("encoding", ["cp1252", "ascii"])
@pytest.mark.parametrize("words", ["solve CASE --method lp", "case show CASE", "case check CASE"])
def test_a_pipe_that_knows_few_letters_gets_what_it_can_show(
    place: Path, monkeypatch: pytest.MonkeyPatch, encoding: str, words: str
) -> None:
    path = place / "named.toml"
    text = case_text(island()).replace('name = "small"', 'name = "Stürmische Bucht 台风"')
    path.write_text(text, encoding="utf-8")
    pipe = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(pipe, encoding=encoding))
    main_words = [str(path) if word == "CASE" else word for word in words.split()]
    with pytest.raises(SystemExit) as stop:
        main(main_words)
    assert not stop.value.code
    shown = "St?rmische Bucht ??" if encoding == "ascii" else "Stürmische Bucht ??"
    # The command framework takes ASCII for a mistake, and writes UTF-8 in its place.
    assert (
        shown.encode(encoding) in pipe.getvalue()
        or "Stürmische Bucht 台风".encode() in pipe.getvalue()
    )
