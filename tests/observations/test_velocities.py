"""Columns of velocities: read as they were written, blank where they are not known, refused where they are none."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sonocal.errors import InputError
from sonocal.observations import observations_csv, parse_observations
from sonocal.observations.velocities import VELOCITY_COLUMNS, velocities_of, with_velocities
from tests.builders.observations import random_table


@settings(max_examples=30)
@given(st.integers(0, 10**6), st.sampled_from([2, 3]))
def test_velocities_come_back_from_the_file_to_the_last_bit(seed, dimension):
    rng = np.random.default_rng(seed)
    velocities = rng.normal(size=(8, 2, 3)) * 10.0 ** rng.integers(-6, 6, (8, 2, 3))
    velocities[rng.random(8) < 0.2] = np.nan
    table = with_velocities(random_table(seed, dimension=dimension), velocities)
    again = velocities_of(parse_observations(observations_csv(table), "again.csv"))
    assert again.tobytes() == velocities.tobytes() or np.array_equal(again, velocities, equal_nan=True)


def test_a_table_without_them_has_none():
    assert velocities_of(random_table(0)) is None


def test_some_of_the_columns_are_too_few():
    table = with_velocities(random_table(0), np.ones((8, 2, 3)))
    fewer = table.with_sound(extra={name: one for name, one in table.extra.items() if name != "vz1_mm_s"})
    with pytest.raises(InputError, match=r"but for the columns vz1_mm_s; give all six or none"):
        velocities_of(fewer)


@pytest.mark.parametrize("cell", ["fast", "inf", "nan", "1e400", "1,5"])
def test_a_cell_that_is_no_velocity_is_named(cell):
    table = with_velocities(random_table(0), np.ones((8, 2, 3)))
    column = table.extra[VELOCITY_COLUMNS[1]].astype("<U8")
    column[3] = cell
    wrong = table.with_sound(extra={**table.extra, VELOCITY_COLUMNS[1]: column})
    with pytest.raises(InputError, match=r"random.csv, line 5, column vy0_mm_s: '.*' is no velocity in mm/s"):
        velocities_of(wrong)
