"""Files that are read: as spreadsheets write them, wherever they may lie, and never quoted."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from resilience.case import load_case, parse_outages
from resilience.errors import CaseError, ResilienceError, UsageError
from resilience.fragility.outages.files import load_scenarios
from resilience.fragility.tracks import read_track
from resilience.inputs import (
    ROOT_VARIABLE,
    InputFileError,
    MissingFileError,
    read_table,
    read_text,
    to_number,
)
from tests.unit.case.valid import VALID

CaseFile = Callable[..., Path]
TEXT = "time,homes,sun,price\n" + "".join(
    f"2016-07-12 00:{15 * k:02d},0.{4 + k}5,0.{k}3,{1 + k}.5\n" for k in range(4)
)
INLINE = VALID[VALID.index("[profiles.columns]") : VALID.index("[defaults.load]")]


def with_profiles(case_file: CaseFile, data: bytes, name: str = "p.csv") -> Path:
    path = case_file((INLINE, f'[profiles]\nfile = "{name}"\n\n'))
    (path.parent / name).write_bytes(data)
    return path


@pytest.mark.parametrize(
    "written",
    [
        TEXT.replace(",", ";").replace(".", ","),  # as Excel does where the comma is decimal
        TEXT.replace(",", ";"),
        TEXT.replace(",", "\t"),
        TEXT.replace("\n", "\r"),
        TEXT.replace("\n", "\r\n"),
        "\ufeff" + TEXT,
        "# of a meter\n\n" + TEXT.replace("\n", "\n\n"),
        TEXT.replace("\n", ",\n"),
    ],
    ids=["Excel", "semicolons", "tabulators", "CR", "CR LF", "mark", "gaps", "empty column"],
)
def test_a_table_reads_alike_however_it_is_written(case_file: CaseFile, written: str) -> None:
    plain = load_case(with_profiles(case_file, TEXT.encode()))
    same = load_case(with_profiles(case_file, written.encode(), "q.csv"))
    np.testing.assert_array_equal(plain.profile("homes"), [0.45, 0.55, 0.65, 0.75])
    for name in plain.profiles:
        np.testing.assert_array_equal(same.profile(name), plain.profile(name))


@pytest.mark.parametrize(
    ("data", "value", "place"),
    [
        (TEXT.replace("0.55", "0.5\0").encode(), "a NUL character", "row 3"),
        (TEXT.replace("homes", "hömes").encode("latin-1"), "0xf6", "row 1"),
        (TEXT.encode("utf-16"), "0xff", "row 1"),
        (TEXT.replace("0.65", "9" * 200_000).encode(), "field larger", "row 4"),
        (TEXT.replace("0.65", '"0.65').encode(), "unexpected end", "row 5"),
        (TEXT.replace("sun", "homes").encode(), "'homes' twice", "heading"),
        (TEXT.replace("0.65,", "").encode(), "3 cells", "row 4"),
        (TEXT.replace("0.65,", "0,65,").encode(), "5 cells", "row 4"),
        (TEXT.replace("0.65", "0_65").encode(), "'0_65'", "row 4"),
        (TEXT.replace("0.65", "٠.٦٥").encode(), "'٠.٦٥'", "row 4"),
        (TEXT.replace(",", ";").replace("0.65", "1.000,5").encode(), "'1.000,5'", "row 4"),
        (TEXT.replace("00:30", "00:30+08:00").encode(), "00:30+08:00'", "row 4"),
    ],
)
def test_a_profile_file_is_refused_with_file_and_row(
    case_file: CaseFile, data: bytes, value: str, place: str
) -> None:
    for name, content in (("p.csv", data), ("p.csv.gz", gzip.compress(data))):
        with pytest.raises(CaseError) as caught:
            load_case(with_profiles(case_file, content, name))
        [mistake] = caught.value.mistakes
        assert mistake.file.endswith(name)
        assert value in mistake.value
        assert place in mistake.value


def test_decimal_commas_and_points_are_not_mixed(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("time;a;b\nx;0,25;1.5\ny;2;3\n")
    table = read_table(path)
    assert [table.number(cell) for cell in ("0,25", "1.5", "2")] == [0.25, None, 2.0]
    assert [to_number(text) for text in ("1e-3", "nan", "+.5", "1_0", "", "0x1", "--1")] == [
        0.001, pytest.approx(np.nan, nan_ok=True), 0.5, None, None, None, None,
    ]  # fmt: skip


def test_outages_and_scenarios_of_a_spreadsheet_are_read(case_file: CaseFile) -> None:
    case = load_case(case_file())
    path = case.path.parent / "o.csv" if case.path else Path()
    path.write_text("start;line;stop\r\n00:15;2-3;00:45\r\n", encoding="utf-8-sig")
    [outage] = parse_outages(path, case)
    assert (outage.line, outage.first, outage.stop) == ("2-3", 1, 3)
    path.write_text("scenario;line;first;stop;weight\n0;2-3;1;3;0,75\n1;;;;0,25\n")
    np.testing.assert_allclose(load_scenarios(path, case).probability, [0.75, 0.25])


@pytest.mark.parametrize(
    ("text", "found", "place"),
    [
        ("line,start,stop\n1-2,00:00,00:15\n2-3,2016-07-12T00:15:00+08:00,00:45\n", "+08:00", 3),
        ("line,start,stop\n2-3,d9999999999 00:00,00:45\n", "d9999999999", 2),
        ("line,start,stop\n2-3,d999999999 00:00,00:45\n", "d999999999", 2),
        ("line,start,stop\n2-3,٠٠:١٥,00:45\n", "٠٠:١٥", 2),
    ],
)
def test_outages_are_refused_with_file_and_row(
    case_file: CaseFile, text: str, found: str, place: int
) -> None:
    case = load_case(case_file())
    path = case_file().parent / "outages.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(CaseError) as caught:
        parse_outages(path, case)
    [mistake] = caught.value.mistakes
    assert mistake.file.endswith("outages.csv")
    assert mistake.table == f"row {place}"
    assert found in mistake.value


def test_many_blanks_are_refused_at_once(case_file: CaseFile) -> None:
    with pytest.raises(CaseError, match="LINE@START-STOP"):
        parse_outages(" " * 60_000 + "x", load_case(case_file()))


def test_outages_may_be_a_list_as_in_a_case_file(case_file: CaseFile) -> None:
    case = load_case(case_file())
    assert parse_outages(["2-3@00:15-00:45"], case) == parse_outages("2-3@00:15-00:45", case)
    assert case.replace(outages=["2-3@00:15-00:45"]).outages == parse_outages(
        "2-3@00:15-00:45", case
    )


AUTUMN = ["01:00", "01:15", "01:30", "01:45"] + 2 * ["02:00", "02:15", "02:30", "02:45"] + ["03:00"]


@pytest.mark.parametrize(("hour", "slots", "sound"), [
    ("01:00", 4, True), ("02:00", 3, False), ("02:15", 3, False), ("02:45", 1, False),
    ("01:30", 4, False), ("03:00", 1, True),
])  # fmt: skip
def test_a_horizon_in_the_hour_that_clocks_repeat_is_refused(
    case_file: CaseFile, hour: str, slots: int, sound: bool
) -> None:
    """The night of 27 October 2024 in Berlin has a quarter past two twice."""
    rows = [f"2024-10-27 {clock},0.{k + 10},0.2,1.5\n" for k, clock in enumerate(AUTUMN)]
    path = case_file(
        (INLINE, '[profiles]\nfile = "autumn.csv"\n\n'),
        ("2016-07-12T00:00:00", f"2024-10-27T{hour}:00"),
        ("slots = 4", f"slots = {slots}"),
        ('outages = ["1-2@00:15-00:45"]', ""),
    )
    (path.parent / "autumn.csv").write_text("time,homes,sun,price\n" + "".join(rows))
    if sound:
        assert load_case(path).profile("homes")[0] == float(f"0.{AUTUMN.index(hour) + 10}")
        return
    with pytest.raises(CaseError) as caught:
        load_case(path)
    assert "every time of the horizon once" in str(caught.value)
    first = max(hour, "02:00")
    assert f"2024-10-27 {first}:00 in row {AUTUMN.index(first) + 2} and row" in str(caught.value)


def outside(tmp_path: Path) -> tuple[Path, Path]:
    """A folder that may be read, and one beside it."""
    inside, other = tmp_path / "cases", tmp_path / "elsewhere"
    inside.mkdir()
    other.mkdir()
    return inside, other


READERS: dict[str, Callable[[Path], object]] = {
    "case": load_case,
    "outages": lambda path: parse_outages(path, load_case("ieee33")),
    "scenarios.csv": lambda path: load_scenarios(path, load_case("ieee33")),
    "scenarios.npz": lambda path: load_scenarios(path, load_case("ieee33")),
    "track": read_track,
}


@pytest.mark.parametrize("kind", READERS)
@pytest.mark.parametrize("is_there", [True, False])
def test_nothing_is_read_outside_the_root(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, is_there: bool
) -> None:
    """Not even whether there is a file is told."""
    inside, other = outside(tmp_path)
    path = other / (kind if "." in kind else f"{kind}.csv")
    if is_there:
        path.write_text("secret")
    monkeypatch.setenv(ROOT_VARIABLE, str(inside))
    with pytest.raises(UsageError, match="lies elsewhere") as caught:
        READERS[kind](path)
    assert "secret" not in str(caught.value)
    link = inside / path.name
    link.symlink_to(path)
    with pytest.raises(UsageError, match="lies elsewhere"):
        READERS[kind](link)


@pytest.mark.parametrize("key", ["extends", "profiles", "network"])
def test_a_case_names_no_file_outside_the_root(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, key: str
) -> None:
    inside, other = outside(tmp_path)
    (other / "p.csv").write_text(TEXT)
    (other / "net.m").write_text("mpc.baseMVA = 10;")
    (other / "base.toml").write_text(VALID)
    network = VALID[VALID.index("[network]") : VALID.index("[[line]]")]
    text = {
        "extends": 'extends = "../elsewhere/base.toml"',
        "profiles": VALID.replace(INLINE, '[profiles]\nfile = "../elsewhere/p.csv"\n\n'),
        "network": VALID.replace(network, '[network]\nfile = "../elsewhere/net.m"\n'),
    }[key]
    path = inside / "case.toml"
    path.write_text(text)
    if key != "network":
        load_case(path)
    monkeypatch.setenv(ROOT_VARIABLE, str(inside))
    with pytest.raises(CaseError, match=ROOT_VARIABLE):
        load_case(path)
    path.write_text('extends = "ieee33"')  # what comes with the package may be named
    assert load_case(path).name == "case"


def test_several_folders_may_be_roots(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    inside, other = outside(tmp_path)
    (other / "a.txt").write_text("text")
    monkeypatch.setenv(ROOT_VARIABLE, f"{inside}:{other}")
    assert read_text(other / "a.txt") == "text"
    with pytest.raises(InputFileError, match="lies elsewhere"):
        read_text(tmp_path / "a.txt")


SECRET = "alice:$6$abcdef:19000:0:99999:7:::"


@pytest.mark.parametrize("name", ["shadow", "shadow.toml", "shadow.json"])
@pytest.mark.parametrize("text", [SECRET, f'token = "{SECRET}"\n', f'[aws]\nkey = "{SECRET}"\n'])
def test_what_is_no_case_is_not_quoted(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text)
    (tmp_path / "case.toml").write_text(f'extends = "{name}"\n')
    for path in (tmp_path / name, tmp_path / "case.toml"):
        with pytest.raises(CaseError) as caught:
            load_case(path)
        for word in ("alice", "$6$", "token", "aws", "key ="):
            assert word not in str(caught.value)


@pytest.mark.parametrize(
    "name", ["a\0b", "x" * 300, "../" * 400 + "x", "loop", ".", "case.toml/x"]
)  # fmt: skip
@pytest.mark.parametrize(
    "key", ['extends = "{}"', '[network]\nfile = "{}"', '[profiles]\nfile = "{}"']
)
def test_names_that_no_file_has_are_refused(tmp_path: Path, name: str, key: str) -> None:
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    escaped = name.replace("\0", "\\u0000")
    (tmp_path / "case.toml").write_text('name = "x"\n' + key.format(escaped) + "\n[time]\n")
    with pytest.raises(CaseError):
        load_case(tmp_path / "case.toml")


@pytest.mark.parametrize("text", [
    "x = " + "[" * 5000, "x = " + "9" * 5000, ".".join("a" * 50_000) + " = 1", "[" + "a." * 9_999,
    "x = 0x" + "f" * 9_999, "x = {" + "a = {" * 3000,
])  # fmt: skip
def test_what_no_reader_of_toml_stands_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "case.toml"
    path.write_text("[time]\n" + text)
    with pytest.raises(CaseError) as caught:
        load_case(path)
    assert len(str(caught.value)) < 3000


def test_a_long_chain_of_cases_is_refused(tmp_path: Path) -> None:
    (tmp_path / "c0.toml").write_text(VALID)
    for k in range(1, 80):
        (tmp_path / f"c{k}.toml").write_text(f'extends = "c{k - 1}"')
    assert load_case(tmp_path / "c40.toml").slots == 4
    with pytest.raises(CaseError, match="50 at most"):
        load_case(tmp_path / "c79.toml")


def test_a_file_that_is_missing_is_told_from_one_that_is_none(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="does not exist"):
        read_text(tmp_path / "x")
    with pytest.raises(InputFileError, match="is no plain file"):
        read_text(tmp_path)
    assert issubclass(InputFileError, ResilienceError)
