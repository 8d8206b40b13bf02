"""Which of several formats a file is in: the rules, on formats made up for them."""

import csv
import io
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonocal import InputError, UnsupportedError
from sonocal.files.kinds import Format, Head, recognise, refuse_container, suffixes_of

CELLS = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=8)


def made_up(name, start, kind="recording", suffixes=()):
    return Format(name, kind, suffixes, lambda head: head.content.startswith(start), bytes, holds="")


def head_of(path, content):
    path.write_bytes(content)
    return Head.of(path)


def test_content_comes_before_the_name(tmp_path):
    formats = (made_up("a", b"A", suffixes=(".a",)), made_up("b", b"B", suffixes=(".b",)))
    assert recognise(head_of(tmp_path / "x.a", b"B..."), formats).name == "b"
    assert recognise(head_of(tmp_path / "x.a", b"..."), formats).name == "a"
    assert recognise(head_of(tmp_path / "x.A", b"..."), formats).name == "a"
    assert recognise(head_of(tmp_path / "x", b"..."), formats) is None


def test_the_first_of_those_that_claim_a_file_has_it(tmp_path):
    formats = (made_up("special", b"AB"), made_up("general", b"A"))
    assert recognise(head_of(tmp_path / "x", b"ABC"), formats).name == "special"
    assert recognise(head_of(tmp_path / "x", b"AC"), formats).name == "general"


def test_a_name_that_several_kinds_share_tells_nothing(tmp_path):
    one, same, other = (
        made_up("one", b"1", suffixes=(".csv",)),
        made_up("same", b"2", suffixes=(".csv",)),
        made_up("other", b"3", kind="points", suffixes=(".csv",)),
    )
    head = head_of(tmp_path / "x.csv", b"...")
    assert recognise(head, (one, same)) is one
    assert recognise(head, (one, same, other)) is None


def test_formats_may_be_any_iterable(tmp_path):
    head = head_of(tmp_path / "x.a", b"...")
    assert recognise(head, iter([made_up("a", b"A", suffixes=(".a",))])).name == "a"


@given(cells=st.lists(CELLS, min_size=1, max_size=6), mark=st.booleans(), end=st.sampled_from(["\n", "\r\n"]))
def test_columns_are_the_cells_of_the_first_line(tmp_path_factory, cells, mark, end):
    cells = ["".join(cell.split()) for cell in cells]
    text = io.StringIO(newline="")
    csv.writer(text, lineterminator=end).writerows([cells, ["1"] * len(cells)])
    path = tmp_path_factory.mktemp("head") / "a.csv"
    path.write_bytes(b"\xef\xbb\xbf" * mark + text.getvalue().encode())
    if any(cells):  # blank lines above a header are skipped
        assert Head.of(path).columns == tuple(cells)


@given(st.binary(max_size=200))
def test_a_head_of_any_bytes_can_be_asked_everything(tmp_path_factory, content):
    head = head_of(tmp_path_factory.mktemp("head") / "a.BIN", content)
    assert head.suffix == ".bin"
    assert head.content == content
    assert all(isinstance(cell, str) for cell in head.columns)
    assert not (head.columns and b"\0" in content)
    assert (head.looks_like == "an empty file") == (not content.strip())


def test_only_the_head_is_read(tmp_path):
    head = head_of(tmp_path / "long", b"x" * 100_000)
    assert head.content == b"x" * 4096


def test_what_is_not_there_is_said(tmp_path):
    with pytest.raises(InputError, match="there is no such file; check the name and the folder"):
        Head.of(tmp_path / "nowhere")
    assert Head.of(tmp_path).content == b""


def test_suffixes_are_named_once():
    assert suffixes_of(
        [made_up("a", b"", suffixes=(".a", ".b")), made_up("b", b"", suffixes=(".b", ".c"))]
    ) == (".a, .b, .c")


@pytest.mark.parametrize(
    ("name", "start", "words"),
    [
        ("poses.csv", b"\x1f\x8b\x08", "compressed (gzip); unpack it first"),
        ("a.igs.mha", b"\x1f\x8b\x08", "compressed (gzip); unpack it first"),
        ("poses.csv", b"PK\x03\x04", "an Excel workbook (.xlsx)"),
        ("poses.csv", b"\x89HDF\r\n\x1a\n", "an HDF5 file, whatever its name says; export it as text"),
    ],
)
def test_what_is_packed_in_another_programs_file_is_called_so_whatever_its_name(tmp_path, name, start, words):
    head = head_of(tmp_path / name, start + b"\0\1\2")
    assert head.container.startswith(words)
    with pytest.raises(UnsupportedError, match=re.escape(f"{name}: is {words}")):
        refuse_container(head)
    assert recognise(head, (made_up("a", b"A", suffixes=(".csv", ".mha")),)) is None
    assert recognise(head, (made_up("a", start),)).name == "a"


@pytest.mark.parametrize(
    ("text", "lacks"),
    [
        (b"0,1.5,-2e3\n", True),
        (b"# a, b\n0;1,5;2\n", True),
        (b"0 1 2\n", True),
        (b"1\n", False),
        (b"t,1\n", False),
        (b"time x\n", False),
    ],
)
def test_a_table_without_a_header_starts_with_numbers(tmp_path, text, lacks):
    assert head_of(tmp_path / "a.csv", text).lacks_header == lacks
