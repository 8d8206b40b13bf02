"""Tables whose rows lie on points, lines and planes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sonocal.errors import InputError
from sonocal.observations import Observations, observations_csv, parse_observations
from tests.builders.mixed_tables import mixed_table


@given(seed=st.integers(0, 1000), flat=st.booleans())
@settings(max_examples=20)
def test_a_mixed_table_is_read_back_to_the_last_bit(seed, flat):
    _, table = mixed_table(seed, 3, flat=flat, image_size_px=(640, 480) if flat else (640, 480, 500))
    again = parse_observations(observations_csv(table), "a.csv")
    assert np.array_equal(again.spanning_mm, table.spanning_mm, equal_nan=True)
    assert np.array_equal(again.points_px, table.points_px)
    assert again.image_size_px == table.image_size_px
    assert np.array_equal(again.spans, table.spans)
    assert set(again.spans.tolist()) == {1, 2, 3}
    assert observations_csv(again) == observations_csv(table)


def test_so_is_its_data_frame():
    pytest.importorskip("pandas")
    _, table = mixed_table(3, 3)
    again = Observations.from_dataframe(table.to_dataframe())
    assert np.array_equal(again.spanning_mm, table.spanning_mm, equal_nan=True)


def test_lines_alone_are_a_table_as_ever():
    _, table = mixed_table(1)
    lines = table.select(table.spans == 2)
    made = Observations.of_targets(lines.points_px, lines.spanning_mm)
    assert made.lines_only
    assert np.array_equal(made.segments_mm, lines.spanning_mm[:, :2])
    assert made.spans.tolist() == [2] * len(lines)
    header = observations_csv(made).split(b"\n")[0]
    assert b"x2_mm" not in header


def test_rows_that_are_chosen_keep_their_kind():
    _, table = mixed_table(1)
    assert set(table.spans.tolist()) == {1, 2, 3}
    planes = table.select(table.spans == 3)
    assert planes.spans.tolist() == [3] * len(planes)
    assert "spans" not in planes.with_sound(source="b").__dict__


HEADER = "frame,target,u_px,v_px,x0_mm,y0_mm,z0_mm,x1_mm,y1_mm,z1_mm,x2_mm,y2_mm,z2_mm\n"


@pytest.mark.parametrize(
    ("row", "says"),
    [
        ("1,a,1,2,1,2,3,,5,6,,,", "line 2, column x1_mm: the cell is empty"),
        ("1,a,1,2,1,2,3,,,,7,8,9", "line 2: gives a point in part, or a later one without the one before it"),
        ("1,a,1,2,1,2,3,1,2,3,7,8,9", "line 2: has the same point twice"),
        ("1,a,1,2,1,2,3,2,3,4,3,4,5", "line 2: has three points on one line"),
        ("1,a,1,2,1,2,3,2,3,4,1e12,4,5", "line 2: its third point is further than"),
        ("1,a,1,2,,,,,,,,,", "line 2, column x0_mm: the cell is empty"),
        ("1,a,1,2,1,2,3,2,3,4,x,4,5", "line 2, column x2_mm: 'x' is not a number"),
    ],
)
def test_what_spans_nothing_is_refused_where_it_stands(row, says):
    with pytest.raises(InputError, match=rf"a\.csv, {says}"):
        parse_observations((HEADER + row + "\n").encode(), "a.csv")


@pytest.mark.parametrize("shape", [(4, 2, 3), (3, 3), (4, 3, 2)])
def test_spanning_points_of_another_shape_are_refused(shape):
    with pytest.raises(InputError, match="spanning_mm must have shape"):
        Observations.of_targets(np.zeros((4, 2)), np.zeros(shape))


def test_a_row_that_stands_twice_is_refused_and_another_plane_through_a_line_is_not():
    _, table = mixed_table(1, 2)
    rows = np.flatnonzero(table.spans == 3)[[0, 0]]
    with pytest.raises(InputError, match="repeats"):
        Observations.of_targets(table.points_px[rows], table.spanning_mm[rows], frame=[1, 1])
    other = table.spanning_mm[rows].copy()
    other[1, 2] += [5.0, 0, 0]
    assert len(Observations.of_targets(table.points_px[rows], other, frame=[1, 1])) == 2
