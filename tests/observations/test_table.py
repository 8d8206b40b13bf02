import errno
import os

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import sonocal as sc
from sonocal import FormatError, InputError, Observations, SonocalError, read_observations, write_observations
from sonocal.observations import group_codes, observations_csv, parse_observations
from sonocal.simulation.scene import simulate_observations

HEADER = "frame,target,u_px,v_px,x0_mm,y0_mm,z0_mm,x1_mm,y1_mm,z1_mm"
ROWS = [
    "0,needle,10,20,0,0,0,1,0,0",
    "1,needle,30.5,40,0,0,0,0,1,0",
    "2,needle,50,60,0,0,0,0,0,1",
]


def table(*rows, header=HEADER):
    return "\n".join([header, *rows]) + "\n"


def refusal(content):
    with pytest.raises(InputError) as caught:
        parse_observations(content if isinstance(content, bytes) else content.encode(), "needle.csv")
    return caught


@given(st.integers(0, 1000), st.sampled_from([2, 3]))
def test_writing_and_reading_gives_the_same_numbers_to_the_last_bit(seed, dimension):
    rows = simulate_observations(dimension, 6, seed=seed).observations
    again = parse_observations(observations_csv(rows), "again.csv")
    for name in ("points_px", "segments_mm", "frame", "target", "split"):
        np.testing.assert_array_equal(getattr(again, name), getattr(rows, name))


def test_every_column_survives_a_round_trip(tmp_path):
    header = HEADER + ",split,sigma_px,sigma_mm,operator"
    text = table(*(row + f",fit,0.5,0.25,Ann {i}" for i, row in enumerate(ROWS)), header=header)
    (tmp_path / "a.csv").write_text(text)
    rows = read_observations(tmp_path / "a.csv")
    assert rows.split.tolist() == ["fit"] * 3
    assert rows.sigma_px.tolist() == [0.5] * 3
    assert rows.extra["operator"].tolist() == ["Ann 0", "Ann 1", "Ann 2"]
    write_observations(rows, tmp_path / "b.csv")
    again = read_observations(tmp_path / "b.csv")
    assert again.extra["operator"].tolist() == rows.extra["operator"].tolist()
    np.testing.assert_array_equal(again.sigma_mm, rows.sigma_mm)


def test_spaces_blank_lines_byte_order_mark_and_windows_line_ends_do_not_matter():
    text = "\ufeff" + table(*ROWS).replace(",", " , ").replace("\n", "\r\n\r\n")
    rows = parse_observations(text.encode(), "a.csv")
    np.testing.assert_array_equal(rows.points_px, [[10, 20], [30.5, 40], [50, 60]])
    assert rows.target.tolist() == ["needle"] * 3
    assert rows.where(1) == "a.csv, line 5"


def test_a_w_column_makes_the_probe_three_dimensional():
    rows = parse_observations(
        table("0,a,1,2,0,0,0,1,0,0,3", "0,a,4,5,0,0,0,1,0,0,6", header=HEADER + ",w_px").encode(), "a.csv"
    )
    assert rows.dimension == 3
    np.testing.assert_array_equal(rows.points_px, [[1, 2, 3], [4, 5, 6]])


def test_rows_of_one_split_frame_and_target_are_one_sighting():
    rows = Observations(
        np.arange(10.0).reshape(5, 2),
        np.tile([[0, 0, 0], [1, 0, 0]], (5, 1, 1)),
        frame=[0, 0, 0, 1, 0],
        target=["a", "a", "b", "a", "a"],
        split=["x", "x", "x", "x", "y"],
    )
    same = rows.sightings[:, None] == rows.sightings
    expected = np.eye(5, dtype=bool)
    expected[0, 1] = expected[1, 0] = True
    np.testing.assert_array_equal(same, expected)


@given(st.lists(st.tuples(st.integers(0, 3), st.sampled_from("abc")), min_size=1, max_size=30))
def test_group_codes_number_distinct_rows_in_order(rows):
    numbers, letters = (np.array(column) for column in zip(*rows, strict=True))
    order = sorted(set(rows))
    assert group_codes(numbers, letters).tolist() == [order.index(row) for row in rows]


def test_select_keeps_all_columns_in_step():
    rows = parse_observations(
        table(*(r + f",{i}" for i, r in enumerate(ROWS)), header=HEADER + ",note").encode(), "a"
    )
    part = rows.select([2, 0])
    assert part.frame.tolist() == [2, 0]
    assert part.extra["note"].tolist() == ["2", "0"]
    assert part.where(0) == "a, line 4"
    assert len(rows) == 3


REFUSALS = {
    "empty": (b"", "needle.csv: is empty; it needs a header with the columns " + HEADER.replace(",", ", ")),
    "header alone": (table(), "needle.csv: has a header but no rows; write one row a sighting"),
    "missing columns": (
        table("0,a,1,2", header="frame,target,u_px,v_px"),
        "needle.csv, line 1: lacks the columns x0_mm, y0_mm, z0_mm, x1_mm, y1_mm, z1_mm; "
        "the header has frame, target, u_px, v_px",
    ),
    "missing column": (
        table("0,a,1,2,0,0,0,1,0", header=HEADER.removesuffix(",z1_mm")),
        "needle.csv, line 1: lacks the column z1_mm; the header has "
        + HEADER.removesuffix(",z1_mm").replace(",", ", "),
    ),
    "column twice": (
        table(ROWS[0] + ",7", header=HEADER + ",u_px"),
        "needle.csv, line 1: has the column u_px twice; rename or delete one",
    ),
    "text for a number": (
        table(ROWS[0], ROWS[1].replace("30.5", "left")),
        "needle.csv, line 3, column u_px: 'left' is not a number; write a decimal number such as 12.5",
    ),
    "empty cell": (
        table(ROWS[0], ROWS[1].replace("30.5", " ")),
        "needle.csv, line 3, column u_px: the cell is empty; write a decimal number such as 12.5",
    ),
    "frame": (
        table(ROWS[0].replace("0,needle", "0.5,needle")),
        "needle.csv, line 2, column frame: '0.5' is not a whole number; "
        "number the images, rows of one image share its number",
    ),
    "huge frame": (
        table(ROWS[0].replace("0,needle", "99999999999999999999,needle")),
        "needle.csv, line 2, column frame: '99999999999999999999' is not a whole number; "
        "number the images, rows of one image share its number",
    ),
    "nan": (
        table(ROWS[0], ROWS[1].replace("30.5", "nan")),
        "needle.csv, line 3, column u_px: nan is not a finite number; leave out rows that were not seen",
    ),
    "inf": (
        table(ROWS[0], ROWS[1], ROWS[2].replace("0,0,1", "0,-inf,1")),
        "needle.csv, line 4, column y1_mm: -inf is not a finite number; leave out rows that were not seen",
    ),
    "zero length": (
        table(ROWS[0], "1,needle,3,4,5,6,7.5,5,6,7.5"),
        "needle.csv, line 3: the segment has zero length, both ends are at (5, 6, 7.5) mm; "
        "give two different points of the needle",
    ),
    "duplicate": (
        table(*ROWS, ROWS[1]),
        "needle.csv, line 5: repeats line 3 (frame 1, target 'needle') value for value; "
        "delete one, a copy is not a second measurement",
    ),
    "sigma": (
        table(ROWS[0] + ",0", header=HEADER + ",sigma_px"),
        "needle.csv, line 2, column sigma_px: 0.0 is not a positive number; "
        "give a standard deviation, or drop the column",
    ),
}

NOT_CSV = {
    "binary": (
        b"\x89PNG\r\n\x1a\n\x00\x00",
        "needle.csv: is not a text file; observations are a CSV table in UTF-8",
    ),
    "prose": (
        b"It was a dark and stormy night\n",
        "needle.csv, line 1: is not the header of an observation table; it needs the columns "
        + HEADER.replace(",", ", ")
        + ", separated by commas",
    ),
    "ragged": (
        table(ROWS[0], "1,needle,1,2"),
        "needle.csv, line 3: has 4 cells where the header has 10; quote cells that hold a comma",
    ),
    "open quote": (table(ROWS[0], '1,"needle'), "needle.csv, line 3: is not CSV (unexpected end of data)"),
}


@pytest.mark.parametrize(("content", "sentence"), REFUSALS.values(), ids=REFUSALS)
def test_bad_input_is_refused_in_one_sentence(content, sentence):
    assert str(refusal(content).value) == sentence


@pytest.mark.parametrize(("content", "sentence"), NOT_CSV.values(), ids=NOT_CSV)
def test_what_is_no_csv_table_is_a_format_error(content, sentence):
    caught = refusal(content)
    assert caught.type is FormatError
    assert str(caught.value) == sentence


@given(st.binary(max_size=300) | st.text(max_size=300).map(lambda s: (HEADER + "\n" + s).encode()))
def test_no_content_raises_anything_but_a_sonocal_error(content):
    try:
        parse_observations(content, "a.csv")
    except SonocalError as error:
        assert "\n" not in str(error).strip()


def test_a_missing_file_and_a_directory_are_said(tmp_path):
    with pytest.raises(InputError) as caught:
        read_observations(tmp_path / "no.csv")
    assert str(caught.value) == f"{tmp_path / 'no.csv'}: there is no such file; check the name and the folder"
    with pytest.raises(InputError) as caught:
        read_observations(tmp_path)
    assert str(caught.value) == f"{tmp_path}: is a directory; name the file in it"


def test_writing_into_a_missing_folder_is_said(tmp_path):
    rows = simulate_observations(2, 4).observations
    with pytest.raises(InputError) as caught:
        write_observations(rows, tmp_path / "no" / "a.csv")
    assert (
        str(caught.value)
        == f"{tmp_path / 'no' / 'a.csv'}: cannot be written ({os.strerror(errno.ENOENT)}); choose another place"
    )


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (
            {"points_px": np.zeros((3, 4)), "segments_mm": np.zeros((3, 2, 3))},
            "observations: points_px must have shape (N, 2) or (N, 3); got (3, 4)",
        ),
        (
            {"points_px": np.zeros((3, 2)), "segments_mm": np.zeros((2, 2, 3))},
            "observations: segments_mm must have shape (3, 2, 3), one a point; got (2, 2, 3)",
        ),
        (
            {"points_px": np.zeros((1, 2)), "segments_mm": np.ones((1, 2, 3)), "frame": [1, 2]},
            "observations: frame must have shape (1,); got (2,)",
        ),
    ],
)
def test_arrays_that_do_not_fit_are_refused(arguments, sentence):
    with pytest.raises(InputError) as caught:
        Observations(**arguments)
    assert str(caught.value) == sentence


def test_an_unknown_split_names_those_there_are():
    rows = parse_observations(
        table(*(r + ",calibration" for r in ROWS), header=HEADER + ",split").encode(), "a.csv"
    )
    with pytest.raises(InputError) as caught:
        rows.select_split("test")
    assert str(caught.value) == "a.csv: no row has split 'test'; the splits in it are 'calibration'"


def test_times_that_are_none_warn_of_nothing_and_are_no_times():
    rows = simulate_observations(2, 30, seed=1).observations
    for far in ("-1e300", "nan", "inf", "noon"):
        times = [f"{i}" for i in range(len(rows) - 1)] + [far]
        table = Observations(rows.points_px, rows.segments_mm, extra={"time_s": times})
        assert table.stamps_s() is None
        sc.calibrate(table)


def test_numbers_of_frames_do_not_wrap():
    rows = simulate_observations(2, 30, seed=1).observations
    frames = np.arange(len(rows), dtype=np.uint64) + np.uint64(2**63 - 3)
    with pytest.raises(sc.InputError, match=r"frame must be whole numbers below 2\^63"):
        Observations(rows.points_px, rows.segments_mm, frame=frames)


def test_a_table_without_splits_says_that_it_has_none():
    rows = simulate_observations(2, 30, seed=1).observations
    with pytest.raises(InputError, match="no row has split 'x'; it has no column split: add one that says"):
        rows.select_split("x")
