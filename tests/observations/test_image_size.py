"""The image's size travels with the table, and what is said of errors depends on whether it is known."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import sonocal as sc
from sonocal.observations import observations_csv, parse_observations
from sonocal.simulation.scene import simulate_observations
from sonocal.validation import give_verdict

ROWS = simulate_observations(2, 30, seed=1).observations
sides = st.integers(1, 10_000)


@given(sides, sides)
def test_a_size_is_read_as_it_was_written(width, height):
    rows = dataclasses.replace(ROWS, image_size_px=(width, height))
    content = observations_csv(rows)
    assert content.startswith(f"# image_size_px: {width} {height}\n".encode())
    again = parse_observations(content, "a.csv")
    assert again.image_size_px == (width, height)
    np.testing.assert_array_equal(again.points_px, rows.points_px)
    assert again.lines[0] == 3


def with_columns(*sizes):
    """The file of a table that says a size in every row."""
    head, *lines = observations_csv(dataclasses.replace(ROWS, image_size_px=None)).decode().splitlines()
    said = [f"{line},{','.join(map(str, sizes[i % len(sizes)]))}" for i, line in enumerate(lines)]
    return "\n".join([f"{head},image_width_px,image_height_px", *said]).encode()


def test_columns_say_the_same():
    assert parse_observations(with_columns((640, 480)), "a.csv").image_size_px == (640, 480)


@pytest.mark.parametrize(
    "content",
    [
        with_columns((640, 480), (640, 481)),
        b"# image_size_px: 1 2\n" + with_columns((640, 480)),
        b"# image_size_px: 640\n" + observations_csv(dataclasses.replace(ROWS, image_size_px=None)),
        b"# image_size_px: wide high\n" + observations_csv(dataclasses.replace(ROWS, image_size_px=None)),
        b"# image_size_px: 0 480\n" + observations_csv(dataclasses.replace(ROWS, image_size_px=None)),
        b"# image_size_px: 99999999999999999999 5\n"
        + observations_csv(dataclasses.replace(ROWS, image_size_px=None)),
    ],
)
def test_what_is_no_size_or_contradicts_itself_is_refused_in_a_sentence(content):
    with pytest.raises(sc.InputError, match=r"a\.csv, line \d+"):
        parse_observations(content, "a.csv")


def test_a_contradicting_option_is_refused():
    with pytest.raises(sc.InputError, match="500 x 500 px"):
        sc.calibrate(ROWS, image_size_px=(640, 480))


@given(st.integers(0, 50), st.integers(1, 5))
def test_gross_rows_do_not_widen_the_area(seed, gross):
    rows = dataclasses.replace(simulate_observations(2, 40, seed=seed).observations, image_size_px=None)
    points = rows.points_px.copy()
    points[:gross] = 5000.0 + np.arange(gross)[:, None]
    found = sc.calibrate(dataclasses.replace(rows, points_px=points))
    assert found.area_px.max() < 600


def test_without_a_size_nothing_is_said_of_the_images_corners():
    unknown = sc.calibrate(dataclasses.replace(ROWS, image_size_px=None))
    said = give_verdict(unknown).expectation
    assert "area seen" in said
    assert "mm a 100 px" in said
    assert "image's corners" not in said
    known = sc.calibrate(ROWS)
    assert "at the image's corners" in give_verdict(known).expectation
    np.testing.assert_array_equal(known.area_px, [[0, 0], [499, 499]])
    again = sc.calibrate(dataclasses.replace(ROWS, image_size_px=None), image_size_px=(500, 500))
    np.testing.assert_array_equal(again.covariance, known.covariance)
    assert give_verdict(again) == give_verdict(known)
