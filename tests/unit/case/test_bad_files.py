"""Mistakes that make a whole file, or the chain of its bases, unreadable."""

import pickle

import pytest

from resilience.case import load_case
from resilience.errors import CaseError, UsageError


def error_of(path) -> CaseError:
    with pytest.raises(CaseError) as caught:
        load_case(path)
    return caught.value


def test_broken_toml_is_reported_with_its_line(case_file):
    [problem] = error_of(case_file(("slots = 4", "slots 4"))).mistakes
    assert problem.table == "line 54"
    assert problem.key == "column 7"
    assert problem.value == "slots 4"


def test_a_file_that_ends_too_early_is_reported(case_file):
    [problem] = error_of(case_file(text="[time\n")).mistakes
    assert problem.table == "line 1"
    [problem] = error_of(case_file(text="outages = [")).mistakes
    assert problem.key == "end of file"


def test_a_file_that_is_no_text_is_reported(tmp_path):
    path = tmp_path / "case.toml"
    path.write_bytes(b"name = '\xff'")
    [problem] = error_of(path).mistakes
    assert problem.allowed == "a text file in UTF-8"


def test_an_empty_file_lacks_what_every_case_needs(case_file):
    found = {(p.table, p.key) for p in error_of(case_file(text="")).mistakes}
    assert found == {("[network]", ""), ("[time]", ""), ("", "grid_forming")}


def test_every_block_ends_in_a_hint(case_file):
    error = error_of(case_file(("slots = 4", "slots = -4"), ('bus = "2"', 'bus = "7"')))
    head, *blocks = str(error).split("\n\n")
    assert head == "2 mistakes in the case:"
    assert len(blocks) == 2
    for block in blocks:
        where, found, allowed, hint = block.splitlines()
        assert "case.toml: [" in where
        assert found.startswith("  found:   ")
        assert allowed.startswith("  allowed: ")
        assert hint.startswith("  hint: ")


def test_a_mistake_in_a_base_names_the_base(case_file):
    case_file(("soc_min = 0.1", "soc_min = 0.95"), name="base.toml")
    path = case_file(text='extends = "base"\n[time]\nslots = -1\n', name="variant.toml")
    files = {p.key: p.file.rsplit("/", 1)[-1] for p in error_of(path).mistakes}
    assert files == {"soc_min": "base.toml", "slots": "variant.toml"}


def test_a_base_that_extends_its_own_variant_is_refused(case_file):
    case_file(text='extends = "b.toml"', name="a.toml")
    path = case_file(text='extends = "a.toml"', name="b.toml")
    [problem] = error_of(path).mistakes
    assert problem.key == "extends"
    assert problem.value == "b -> a -> b"


def test_a_missing_base_is_refused_with_the_names_there_are(case_file):
    [problem] = error_of(case_file(text='extends = "ieee3"')).mistakes
    assert problem.hint == "did you mean ieee33 or ieee14 or ieee33-tou?"


def test_a_missing_network_file_is_refused(case_file):
    path = case_file(text='[network]\nfile = "feeder.m"\n')
    [problem] = [p for p in error_of(path).mistakes if p.table == "[network]"]
    assert problem.key == "file"
    assert problem.allowed == "a file that exists"


def test_an_unknown_case_name_offers_the_nearest():
    with pytest.raises(UsageError, match="did you mean ieee33"):
        load_case("iee33")
    with pytest.raises(UsageError, match=r"known are .*ieee33"):
        load_case("xyz")
    with pytest.raises(UsageError, match="does not exist"):
        load_case("nowhere/case.toml")


def test_errors_survive_the_way_between_processes(case_file):
    error = error_of(case_file(("slots = 4", "slots = 0")))
    copy = pickle.loads(pickle.dumps(error))
    assert isinstance(copy, CaseError)
    assert copy.mistakes == error.mistakes
    assert str(copy) == str(error)
    usage = pickle.loads(pickle.dumps(UsageError("no such thing", "try another")))
    assert str(usage) == "no such thing\nhint: try another"
