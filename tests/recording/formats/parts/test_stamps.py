"""Times of tables: a column's name, the size of its numbers, or a date says what they are."""

from datetime import UTC, datetime

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonocal import InputError
from sonocal.files.tables import parse_table
from sonocal.recording.formats.parts.stamps import PER_SECOND, UNIT_NAMES, WORDS, time_column, times_of

STEPS_MS = st.lists(st.integers(5, 100), min_size=2, max_size=20)


def table(column, cells):
    return parse_table("a.csv", f"{column};x\n" + "".join(f"{cell};1\n" for cell in cells))


@pytest.mark.parametrize(
    ("column", "unit"),
    [
        *((f"time_{word}", unit) for unit, words in WORDS.items() for word in words),
        ("Time (Seconds)", "s"),
        ("Timestamp [ms]", "ms"),
        ("timestamp (us)", "us"),
        ("stamp.ns", "ns"),
        ("t_ms", "ms"),
        ("tracker_time_ms", "ms"),
        ("UNIX_TIME_S", "s"),
        ("%time_ns", "ns"),
    ],
)
@given(steps=STEPS_MS)
def test_a_name_says_the_unit(column, unit, steps):
    seconds = np.cumsum(steps) / 1000
    times, notes = times_of(table(column, (seconds * PER_SECOND[unit]).tolist()))
    np.testing.assert_allclose(times, seconds, rtol=1e-12)
    assert len(notes) == (unit != "s")
    assert all(UNIT_NAMES[unit] in note.message and note.code == "time-unit" for note in notes)


@pytest.mark.parametrize("unit", PER_SECOND)
@given(steps=STEPS_MS)
def test_seconds_since_1970_are_known_by_their_size(unit, steps):
    seconds = 1.7e9 + np.cumsum(steps) / 1000
    whole = [round(s * PER_SECOND[unit]) if unit != "s" else s for s in seconds.tolist()]
    times, notes = times_of(table("Timestamp", whole))
    np.testing.assert_allclose(times, seconds, rtol=0, atol=1e-3)
    assert len(notes) == (unit != "s")


@pytest.mark.parametrize("unit", ["ms", "us", "ns"])
@given(steps=STEPS_MS)
def test_counts_from_the_start_are_known_by_their_steps(unit, steps):
    counts = [round(PER_SECOND[unit] / 1000) * n for n in np.cumsum(steps).tolist()]
    times, (note,) = times_of(table("t", counts))
    np.testing.assert_allclose(times, np.cumsum(steps) / 1000, rtol=1e-12)
    assert UNIT_NAMES[unit] in note.message


@pytest.mark.parametrize("rate", [0.5, 1, 20, 1000])
def test_seconds_are_seconds(rate):
    seconds = (np.arange(10) / rate).tolist()
    for column in ("time", "Timestamp", "t", "time_s"):
        times, notes = times_of(table(column, seconds))
        assert times.tolist() == seconds
        assert notes == ()


@given(
    stamps=st.lists(
        st.datetimes(datetime(1971, 1, 1), datetime(2100, 1, 1), timezones=st.sampled_from([None, UTC])),
        min_size=1,
        max_size=5,
    ),
    between=st.sampled_from("T "),
)
def test_dates_are_seconds_since_1970(stamps, between):
    times, (note,) = times_of(table("Timestamp", [stamp.isoformat(between) for stamp in stamps]))
    wanted = [stamp.replace(tzinfo=UTC).timestamp() for stamp in stamps]
    np.testing.assert_allclose(times, wanted, rtol=0, atol=1e-6)
    assert "ISO 8601" in note.message


@pytest.mark.parametrize(
    ("header", "column"),
    [
        (("t", "Timestamp"), "Timestamp"),
        (("time_ms", "time"), "time"),
        (("x", "time_ms"), "time_ms"),
        (("x", "time_of_day_in_prose"), None),
        (("tx", "ty", "type"), None),
        (("time_px",), None),
        (("_" * 5000,), None),
    ],
)
def test_the_column_of_times_is_found_by_name(header, column):
    assert time_column(header) == column


@pytest.mark.parametrize(
    ("column", "cells", "sentence"),
    [
        ("time_s", ["0", "inf"], "a.csv, line 3, column time_s: inf is not a time"),
        (
            "time",
            ["2024-05-01T10:00:00", "soon"],
            "a.csv, line 3, column time: 'soon' is not a date and time; write such as 2024-05-01T12:00:00.25",
        ),
    ],
)
def test_what_is_no_time_is_named(column, cells, sentence):
    with pytest.raises(InputError) as caught:
        times_of(table(column, cells))
    assert str(caught.value) == sentence
