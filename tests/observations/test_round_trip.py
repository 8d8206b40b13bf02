"""What is written is read again, to the last bit, however a spreadsheet dressed it in between."""

import csv
import io
from hashlib import sha256

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from sonocal import read_observations, write_observations
from sonocal.observations import observations_csv, parse_observations
from tests.builders.observations import NAME_LISTS, assert_same_table, random_table

seeds = st.integers(0, 10_000)
dimensions = st.sampled_from([2, 3])


def again(table):
    return parse_observations(observations_csv(table), "again.csv")


def dressed(content, *, delimiter_blanks="", line_end="\n", mark=b"", quoting=csv.QUOTE_MINIMAL):
    """A file as other programs write the same cells."""
    rows = csv.reader(io.StringIO(content.decode(), newline=""))
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator=line_end, quoting=quoting)
    writer.writerows([[delimiter_blanks + cell for cell in row] for row in rows])
    return mark + text.getvalue().encode()


@given(seeds, dimensions, st.booleans())
def test_numbers_come_back_to_the_last_bit(seed, dimension, sigmas):
    table = random_table(seed, dimension=dimension, sigmas=sigmas)
    assert_same_table(again(table), table)


@given(seeds, NAME_LISTS, NAME_LISTS)
@example(0, ["a\rb", "a\nb", "a\r\nb"], ["x\r\ry"])
@example(0, ['"', '""', ",", "'"], ["\ufeff", "a\u2028b"])
def test_names_with_commas_quotes_line_ends_and_any_letters_come_back(seed, names, splits):
    table = random_table(seed, names=names, splits=splits)
    assert_same_table(again(table), table)


@given(seeds, NAME_LISTS, dimensions)
def test_columns_that_nobody_knows_come_back_as_they_were(seed, cells, dimension):
    table = random_table(seed, dimension=dimension, extra={"note": cells, "Ärztin": ["a, b", '"', "7"]})
    assert_same_table(again(table), table)


@given(seeds, NAME_LISTS)
def test_writing_twice_gives_the_same_file(seed, names):
    table = random_table(seed, names=names, extra={"note": names})
    content = observations_csv(table)
    assert observations_csv(parse_observations(content, "a.csv")) == content


@pytest.mark.parametrize(
    "dress",
    [
        {"mark": "\ufeff".encode()},
        {"line_end": "\r\n"},
        {"delimiter_blanks": " "},
        {"delimiter_blanks": "\t"},
        {"quoting": csv.QUOTE_ALL},
        {"mark": "\ufeff".encode(), "line_end": "\r\n", "quoting": csv.QUOTE_ALL},
    ],
    ids=str,
)
@given(seed=seeds, dimension=dimensions)
def test_how_a_spreadsheet_dresses_the_cells_does_not_matter(dress, seed, dimension):
    table = random_table(seed, dimension=dimension, names=["a", "b, c", 'd"e'], splits=["x", "y z"])
    assert_same_table(parse_observations(dressed(observations_csv(table), **dress), "a.csv"), table)


@given(seeds, st.randoms(use_true_random=False))
def test_the_order_of_columns_does_not_matter(seed, random):
    table = random_table(seed, dimension=3, splits=["x", "y"])
    rows = list(csv.reader(io.StringIO(observations_csv(table).decode())))
    order = list(range(len(rows[0])))
    random.shuffle(order)
    shuffled = "\n".join(",".join(row[i] for i in order) for row in rows)
    assert_same_table(parse_observations(shuffled.encode(), "a.csv"), table)


@given(seeds, st.lists(st.integers(0, 8), max_size=5))
def test_empty_lines_are_no_rows_and_lines_keep_their_numbers(seed, places):
    table = random_table(seed)
    lines = observations_csv(table).decode().splitlines()
    for place in sorted(places, reverse=True):
        lines.insert(place + 1, "  ")
    found = parse_observations("\n".join(lines).encode(), "a.csv")
    assert_same_table(found, table)
    for row, line in enumerate(found.lines):
        assert lines[line - 1].startswith(f"{table.frame[row]},")


@given(seed=seeds)
def test_a_file_says_the_same_as_its_bytes_and_knows_its_digest(tmp_path_factory, seed):
    table, path = random_table(seed), tmp_path_factory.mktemp("table") / "needle.csv"
    write_observations(table, path)
    found, content = read_observations(path), path.read_bytes()
    assert content == observations_csv(table)
    assert found.sha256 == sha256(content).hexdigest()
    assert found.source == "needle.csv"


@given(seeds, dimensions, st.data())
def test_rows_chosen_and_written_are_rows_written_and_chosen(seed, dimension, data):
    table = random_table(seed, dimension=dimension, splits=["x", "y"], extra={"note": ["1", "2"]})
    rows = np.array(data.draw(st.lists(st.integers(0, 7), min_size=1, unique=True)))
    assert_same_table(again(table.select(rows)), again(table).select(rows))


def test_numbers_are_read_as_python_reads_them_whatever_their_spelling():
    spellings = ["1e3", "+1000", "1000.", "1000.000", "1E+03", "0001000"]
    header = "frame,target,u_px,v_px,x0_mm,y0_mm,z0_mm,x1_mm,y1_mm,z1_mm"
    body = "\n".join(f"{i},a,{text},2,0,0,0,1,0,0" for i, text in enumerate(spellings))
    found = parse_observations(f"{header}\n{body}\n".encode(), "a.csv")
    np.testing.assert_array_equal(found.points_px[:, 0], 1000.0)
