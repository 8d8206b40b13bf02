"""Tables, however they are quoted, marked and ended: the standard library's writer is the oracle."""

import csv
import io
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonocal import FormatError, InputError
from sonocal.files.tables import csv_text, parse_table

CELLS = st.text(st.characters(codec="utf-8", exclude_characters="\0\r"), max_size=10)
NAMES = st.lists(
    st.text(st.characters(codec="utf-8", exclude_categories=["C", "Z"]), min_size=1, max_size=8),
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
