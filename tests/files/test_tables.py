"""Tables, however they are quoted, marked and ended: the standard library's writer is the oracle."""

import csv
import io
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonocal import FormatError, InputError
from sonocal.files.separators import separator_of
from sonocal.files.tables import csv_text, parse_table

CELLS = st.text(st.characters(codec="utf-8", exclude_characters="\0\r"), max_size=10)
NAMES = st.lists(
    st.text(
        st.characters(codec="utf-8", exclude_categories=["C", "Z"], exclude_characters=";"),
        min_size=1,
        max_size=8,
    ),
    min_size=1,
    max_size=5,
    unique=True,
)


@st.composite
def written(draw):
    """A table as rows, and the same as the bytes that some program might write."""
    header = draw(NAMES)
    rows = draw(st.lists(st.lists(CELLS, min_size=len(header), max_size=len(header)), min_size=1, max_size=6))
    rows = [row for row in rows if any(cell.strip() for cell in row)]
    text = io.StringIO(newline="")
    quoting = draw(st.sampled_from([csv.QUOTE_MINIMAL, csv.QUOTE_ALL, csv.QUOTE_NONNUMERIC]))
    end = draw(st.sampled_from(["\n", "\r\n"]))
    csv.writer(text, quoting=quoting, lineterminator=end).writerows([header, *rows])
    mark = draw(st.sampled_from([b"", b"\xef\xbb\xbf"]))
    return header, rows, mark + text.getvalue().encode() + draw(st.sampled_from([b"", end.encode()]))


@given(written())
def test_cells_come_back_whatever_the_quoting_mark_and_line_end(table):
    header, rows, content = table
    read = parse_table("a.csv", csv_text("a.csv", content, "this is"))
    assert list(read.header) == header
    assert len(read) == len(rows)
    for i, column in enumerate(header):
        assert list(read.columns[column]) == [row[i] for row in rows]


@given(written())
def test_every_row_knows_the_line_it_ends_on(table):
    _, _, content = table
    text = csv_text("a.csv", content, "this is")
    read = parse_table("a.csv", text)
    reader = csv.reader(io.StringIO(text, newline=""))
    ends = [(row, reader.line_num) for row in reader]
    assert list(read.lines) == [line for row, line in ends if any(cell.strip() for cell in row)][1:]


@given(
    numbers=st.lists(st.floats(), min_size=1, max_size=20),
    blanks=st.lists(st.booleans(), min_size=20, max_size=20),
)
def test_numbers_come_back_to_the_last_bit(numbers, blanks):
    cells = ["  " if blank else f" {x!r} " for x, blank in zip(numbers, blanks, strict=False)]
    read = parse_table("a.csv", "x,y\n" + "".join(f"{cell},1\n" for cell in cells))
    wanted = np.where(blanks[: len(numbers)], -7.5, numbers)
    assert read.numbers("x", blank=-7.5).tobytes() == wanted.tobytes()


@given(table=written(), separator=st.sampled_from(";\t"))
def test_semicolons_and_tabs_separate_as_commas_do(table, separator):
    header, rows, content = table
    plain = parse_table("a.csv", csv_text("a.csv", content, "this is"))
    text = io.StringIO(newline="")
    # A lone column has no separator, so that nothing tells one from a part of its name.
    csv.writer(text, delimiter=separator, lineterminator="\n").writerows(
        [[*row, "last"] for row in (header, *rows)]
    )
    read = parse_table("a.csv", text.getvalue())
    assert read.separator == separator
    assert {name: read.columns[name] for name in plain.header} == plain.columns


@pytest.mark.parametrize("separator", [";", "\t"])
@given(numbers=st.lists(st.floats(allow_nan=False), min_size=1, max_size=20))
def test_decimal_commas_are_points(separator, numbers):
    cells = [repr(x).replace(".", ",") for x in numbers]
    text = f"x{separator}y\n" + "".join(f"{cell}{separator}1\n" for cell in cells)
    assert parse_table("a.csv", text).numbers("x").tolist() == numbers


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "a;b;c\n1,2,3\n",
            "separates cells by commas where the header does by semicolons; write one of the two all over",
        ),
        (
            "a,b\n1\t2\n",
            "separates cells by tabs where the header does by commas; write one of the two all over",
        ),
        (
            "a,b\n0,5,1,25\n",
            "has 4 cells where the header has 2; if its commas are decimal ones, separate cells by semicolons",
        ),
        ("a;b\n1;2;3\n", "has 3 cells where the header has 2; quote cells that hold a semicolon"),
    ],
)
def test_what_separates_a_row_that_does_not_fit_is_named(text, words):
    with pytest.raises(FormatError) as caught:
        parse_table("a.csv", text)
    assert str(caught.value) == f"a.csv, line 2: {words}"


def test_commas_beside_decimal_points_may_part_thousands(tmp_path):
    table = parse_table("a.csv", "x;y\n1,234;0.5\n")
    with pytest.raises(InputError) as caught:
        table.numbers("x")
    assert str(caught.value) == (
        "a.csv, line 2, column y: '0.5' has a decimal point where numbers of the column x have commas; write one of "
        "the two all over"
    )
    with pytest.raises(InputError, match="line 2, column x: '1,234,567' is not a number"):
        parse_table("a.csv", "x;y\n1,234,567;1\n").numbers("x")


@pytest.mark.parametrize(
    ("line", "separator"),
    [
        ("a", ","),
        ("", ","),
        ("a,b", ","),
        ("a;b", ";"),
        ("a\tb", "\t"),
        ("\n \na;b\n1,2", ";"),
        ('"a;b;c",d', ","),
        ('"a;b', ","),
        ("0,05;1,5;-2,25", ";"),
        ("0,1,2,3", ","),
        ("a;b,c,d", ","),
        ("\ta\t,\tb", ","),
    ],
)
def test_the_first_line_says_what_separates_cells(line, separator):
    assert separator_of(line) == separator


@given(row=st.integers(0, 9), word=st.sampled_from(["one", "1,5", "0x10", "", " ", "1e", "--1", "1 2"]))
def test_a_cell_that_is_no_number_is_named_with_its_line(row, word):
    cells = ["1.5"] * 10
    cells[row] = word
    table = parse_table("a.csv", "x,y\n" + "".join(f'"{cell}",1\n' for cell in cells))
    with pytest.raises(
        InputError, match=rf"^a\.csv, line {row + 2}, column x: .*write a decimal number such as 12\.5$"
    ):
        table.numbers("x")


@given(header=NAMES, data=st.data())
def test_a_row_of_another_length_is_refused_with_its_line(header, data):
    rows = [["1"] * len(header) for _ in range(data.draw(st.integers(1, 5)))]
    wrong = data.draw(st.integers(0, len(rows) - 1))
    rows[wrong] += ["2"]
    text = io.StringIO(newline="")
    csv.writer(text, lineterminator="\n").writerows([header, *rows])
    sentence = f"a.csv, line {wrong + 2}: has {len(header) + 1} cells where the header has {len(header)}"
    with pytest.raises(FormatError, match=re.escape(sentence)):
        parse_table("a.csv", text.getvalue())


@given(st.binary(max_size=200))
def test_any_bytes_are_a_table_or_a_sentence(content):
    try:
        table = parse_table("a.csv", csv_text("a.csv", content, "this is"))
    except InputError as error:
        assert str(error).startswith("a.csv")
        assert "\n" not in str(error)
    else:
        assert set(table.columns) == set(table.header)
