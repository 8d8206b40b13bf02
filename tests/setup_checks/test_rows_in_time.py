"""Rows with their targets as they were at another moment."""

import numpy as np

import sonocal as sc
from sonocal.calibration.mixed import table_of
from sonocal.setup_checks.rows_in_time import RowsInTime

CORNERS = np.array([[0.0, 0.0, 0.0], [100.0, 0.0, 0.0], [0.0, 100.0, 0.0]])


def planes_in_time(*spanning):
    """A plane that three points span, image after image."""
    count = len(spanning)
    return sc.Observations.of_targets(
        np.tile([10.0, 20.0], (count, 1)),
        np.array(spanning),
        frame=np.arange(count),
        target=np.array(["wall"] * count),
    )


def test_a_plane_that_is_turned_inside_out_on_its_way_is_none_in_between():
    """Two of its three points change places: half way they are one."""
    rows = planes_in_time(*[CORNERS] * 4, *[CORNERS[[0, 2, 1]]] * 4)
    shifted = RowsInTime.of(rows, table_of(rows)).shifted(0.5)
    np.testing.assert_array_equal(shifted.rows, [0, 1, 2, 4, 5, 6])
    assert shifted.table.constraints.planes.shape == (6, 4)


def test_a_plane_that_moves_along_is_where_it_was_in_between():
    rows = planes_in_time(*(CORNERS + np.array([0.0, 0.0, 4.0 * z]) for z in range(6)))
    shifted = RowsInTime.of(rows, table_of(rows)).shifted(0.5)
    np.testing.assert_array_equal(shifted.rows, range(5))
    np.testing.assert_allclose(shifted.table.spanning_mm[2, :, 2], 10.0, atol=1e-9)
