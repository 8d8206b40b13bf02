"""Whatever is wrong in a table, wherever it is: the sentence names the file, the line and the column."""

import csv
import io

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonocal import InputError, Observations, SonocalError
from sonocal.observations import observations_csv, parse_observations
from tests.builders.observations import random_table

COUNT = 8
GIVEN = ("u_px", "v_px", "w_px", "x0_mm", "y0_mm", "z0_mm", "x1_mm", "y1_mm", "z1_mm", "sigma_px", "sigma_mm")
numbers = st.sampled_from(GIVEN)
rows = st.integers(0, COUNT - 1)
seeds = st.integers(0, 1000)


def cells_of(seed=0):
    content = observations_csv(random_table(seed, dimension=3, splits=["x", "y"]))
    return list(csv.reader(io.StringIO(content.decode())))


def refusal(cells, name="needle.csv"):
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(cells)
    with pytest.raises(InputError) as caught:
        parse_observations(text.getvalue().encode(), name)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def with_cell(row, column, value, seed=0):
    cells = cells_of(seed)
    cells[row + 1][cells[0].index(column)] = value
    return cells


@given(seeds, rows, numbers, st.sampled_from(["left", "1,5", "0x10", "1.2.3", "--1", "½", "12 mm"]))
def test_text_where_a_number_is_due(seed, row, column, text):
    assert refusal(with_cell(row, column, text, seed)) == (
        f"needle.csv, line {row + 2}, column {column}: {text!r} is not a number; "
        "write a decimal number such as 12.5"
    )


@given(seeds, rows, numbers, st.sampled_from(["", " ", "\t"]))
def test_an_empty_cell_where_a_number_is_due(seed, row, column, blank):
    assert refusal(with_cell(row, column, blank, seed)).startswith(
        f"needle.csv, line {row + 2}, column {column}: the cell is empty; "
    )


@given(seeds, rows, numbers, st.sampled_from(["nan", "inf", "-inf", "1e999"]))
def test_numbers_that_are_none(seed, row, column, text):
    sentence = refusal(with_cell(row, column, text, seed))
    kind = "positive" if column.startswith("sigma") else "finite"
    assert sentence.startswith(f"needle.csv, line {row + 2}, column {column}: {float(text)} is not a {kind} ")


@given(seeds, rows, st.sampled_from(["sigma_px", "sigma_mm"]), st.sampled_from(["0", "-1", "-0.0"]))
def test_noise_that_is_not_positive(seed, row, column, text):
    assert refusal(with_cell(row, column, text, seed)).startswith(
        f"needle.csv, line {row + 2}, column {column}: {float(text)} is not a positive number; "
    )


FRAMES = [
    "0.5",
    "1e3",
    "",
    "one",
    "9223372036854775808",
    "-9223372036854775809",
    "9" * 5000,
    "²",
    "+-5",
    "--5",
    "½",
]


@pytest.mark.parametrize("text", FRAMES, ids=lambda text: text[:24])
@given(row=rows, seed=seeds)
def test_a_frame_that_is_no_whole_number(text, row, seed):
    """Beside others of as many digits as one can have."""
    cells = with_cell(row, "frame", text, seed)
    cells[1 + (row + 1) % COUNT][cells[0].index("frame")] = "9223372036854775807"
    sentence = refusal(cells)
    assert sentence.startswith(f"needle.csv, line {row + 2}, column frame: ")
    assert "is not a whole number; number the images" in sentence
    assert len(sentence) < 250


@given(seeds, rows)
def test_a_segment_without_length(seed, row):
    cells = cells_of(seed)
    at = [cells[0].index(f"{axis}{end}_mm") for end in (0, 1) for axis in "xyz"]
    for first, second in zip(at[:3], at[3:], strict=True):
        cells[row + 1][second] = cells[row + 1][first]
    assert refusal(cells).startswith(f"needle.csv, line {row + 2}: the segment has zero length, ")


@given(seeds, rows, st.booleans())
def test_a_row_with_a_cell_too_few_or_too_many(seed, row, more):
    cells = cells_of(seed)
    width = len(cells[0])
    cells[row + 1] = [*cells[row + 1], "7"] if more else cells[row + 1][:-1]
    assert refusal(cells) == (
        f"needle.csv, line {row + 2}: has {width + (1 if more else -1)} cells where the header has {width}; "
        "quote cells that hold a comma"
    )


@given(
    st.sampled_from(["frame", "target", "u_px", "v_px", "x0_mm", "y0_mm", "z0_mm", "x1_mm", "y1_mm", "z1_mm"])
)
def test_a_column_that_is_not_there(column):
    cells = cells_of()
    at = cells[0].index(column)
    sentence = refusal([row[:at] + row[at + 1 :] for row in cells])
    assert sentence.startswith(f"needle.csv, line 1: lacks the column {column}; the header has ")


@given(numbers)
def test_a_column_that_stands_twice(column):
    cells = cells_of()
    doubled = [[*row, row[cells[0].index(column)]] for row in cells]
    assert refusal(doubled) == f"needle.csv, line 1: has the column {column} twice; rename or delete one"


@given(seeds, rows, rows, numbers)
def test_of_two_faults_in_a_column_the_first_is_named(seed, one, other, column):
    cells = with_cell(one, column, "left", seed)
    cells[other + 1][cells[0].index(column)] = "right"
    assert refusal(cells).startswith(f"needle.csv, line {min(one, other) + 2}, column {column}: ")


@given(seeds, rows, numbers)
def test_a_cell_of_several_lines_counts_its_lines(seed, row, column):
    """The line that is named is the one an editor shows."""
    cells = with_cell(row, column, "left", seed)
    cells[row + 1][cells[0].index("split")] = "two\nlines"
    for other in range(row):
        cells[other + 1][cells[0].index("split")] = "one\ntwo\nthree"
    assert refusal(cells).startswith(f"needle.csv, line {1 + 3 * row + 2}, column {column}: ")


@given(st.binary(min_size=1, max_size=60), rows)
def test_bytes_thrown_into_a_table_are_read_or_refused_in_one_sentence(junk, row):
    lines = observations_csv(random_table(0)).split(b"\n")
    lines[row + 1] += junk
    try:
        parse_observations(b"\n".join(lines), "needle.csv")
    except SonocalError as error:
        assert str(error).startswith("needle.csv")
        assert "\n" not in str(error)


ARRAYS = {
    "one axis": {"points_px": np.zeros(6)},
    "one coordinate": {"points_px": np.zeros((3, 1))},
    "four coordinates": {"points_px": np.zeros((3, 4))},
    "segments of other rows": {"segments_mm": np.ones((2, 2, 3))},
    "segments of one end": {"segments_mm": np.ones((3, 1, 3))},
    "frames that are no numbers": {"frame": ["a", "b", "c"]},
    "frames between numbers": {"frame": [0.5, 1.5, 2.5]},
    "frames too few": {"frame": [0, 1]},
    "targets too many": {"target": ["a"] * 4},
    "splits in two columns": {"split": [["a", "b"]] * 3},
    "noise too short": {"sigma_px": [1.0]},
    "noise that is text": {"sigma_mm": ["a", "b", "c"]},
    "noise below zero": {"sigma_mm": [1.0, -1.0, 1.0]},
    "a point nowhere": {"points_px": [[0, 0], [np.nan, 1], [2, 2]]},
    "an end at infinity": {"segments_mm": np.where(np.eye(3)[:, None] > 0, np.inf, np.ones((3, 2, 3)))},
}


@pytest.mark.parametrize("change", ARRAYS.values(), ids=ARRAYS)
def test_arrays_that_make_no_table_are_refused_by_the_name_of_what_is_wrong(change):
    sound = {
        "points_px": np.arange(6.0).reshape(3, 2),
        "segments_mm": np.tile([[0.0, 0, 0], [1, 0, 0]], (3, 1, 1)),
    }
    assert len(Observations(**sound)) == 3
    with pytest.raises(InputError) as caught:
        Observations(**sound | change, source="mine")
    assert str(caught.value).startswith("mine")
    (name,) = change
    words = {"points_px": ("points_px", "u_px"), "segments_mm": ("segments_mm", "x0_mm", "y0_mm", "z0_mm")}
    assert any(word in str(caught.value) for word in words.get(name, (name,)))
