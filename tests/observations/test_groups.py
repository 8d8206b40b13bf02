"""Rows chosen, stacked and grouped: laws of the table, against plain Python."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonocal import InputError, Observations
from sonocal.observations import group_codes, stacked
from tests.builders.observations import assert_same_table, random_table

seeds = st.integers(0, 10_000)
COUNT = 8
indices = st.lists(st.integers(0, COUNT - 1), unique=True, max_size=COUNT)
rows_of_columns = st.lists(
    st.tuples(st.integers(-2, 2), st.sampled_from(["", "a", "b"]), st.sampled_from([0.5, -1.0, 2.0])),
    min_size=1,
    max_size=40,
)


def columns_of(rows):
    return [np.array(column) for column in zip(*rows, strict=True)]


def sightings(seed, count=20):
    """A table in which frames, targets and splits repeat."""
    rng, table = np.random.default_rng(seed), random_table(seed, count=count, names="ab", splits=["", "x"])
    return dataclasses.replace(table, frame=rng.integers(0, 3, count))


@given(rows_of_columns)
def test_groups_are_numbered_as_a_dictionary_of_sorted_rows_numbers_them(rows):
    number = {row: i for i, row in enumerate(sorted(set(rows)))}
    assert group_codes(*columns_of(rows)).tolist() == [number[row] for row in rows]


@given(rows_of_columns, st.randoms(use_true_random=False))
def test_shuffled_rows_have_shuffled_groups(rows, random):
    order = list(range(len(rows)))
    random.shuffle(order)
    columns = columns_of(rows)
    np.testing.assert_array_equal(group_codes(*(c[order] for c in columns)), group_codes(*columns)[order])


@given(rows_of_columns)
def test_a_column_that_says_nothing_new_changes_no_group(rows):
    columns = columns_of(rows)
    codes = group_codes(*columns)
    np.testing.assert_array_equal(group_codes(codes), codes)
    np.testing.assert_array_equal(group_codes(*columns, np.zeros(len(rows))), codes)
    np.testing.assert_array_equal(group_codes(np.zeros(len(rows)), *columns), codes)
    np.testing.assert_array_equal(group_codes(*columns, columns[0]), codes)
    np.testing.assert_array_equal(group_codes(columns[0], columns[0]), group_codes(columns[0]))


@given(rows_of_columns)
def test_more_columns_only_divide_groups(rows):
    columns = columns_of(rows)
    fewer, more = group_codes(*columns[:2]), group_codes(*columns)
    for group in range(more.max() + 1):
        assert len(np.unique(fewer[more == group])) == 1


def test_no_rows_have_no_groups():
    assert group_codes(np.empty(0), np.empty(0, dtype=str)).shape == (0,)


@given(seeds)
def test_two_rows_are_one_sighting_if_split_frame_and_target_agree_and_not_otherwise(seed):
    table = sightings(seed)
    keys = list(zip(table.split, table.frame, table.target, strict=True))
    codes = table.sightings
    assert set(codes.tolist()) == set(range(len(set(keys))))
    for i, key in enumerate(keys):
        assert [codes[i] == code for code in codes] == [key == other for other in keys]


@given(seeds)
def test_new_names_for_frames_targets_and_splits_keep_the_sightings_apart_as_before(seed):
    table = sightings(seed)
    renamed = dataclasses.replace(
        table,
        frame=1000 - 7 * table.frame,
        target=np.char.add("wire ", table.target),
        split=np.char.add(table.split, "!"),
    )
    same, still = (x.sightings[:, None] == x.sightings for x in (table, renamed))
    np.testing.assert_array_equal(still, same)


@given(seeds, indices, st.data())
def test_choosing_twice_is_choosing_once(seed, first, data):
    table = random_table(seed, splits=["x", "y"], extra={"note": ["1", "2"]})
    second = data.draw(st.lists(st.integers(0, max(len(first) - 1, 0)), unique=True, max_size=len(first)))
    at_once = table.select([first[i] for i in second])
    step_by_step = table.select(first).select(second)
    assert_same_table(step_by_step, at_once)
    np.testing.assert_array_equal(step_by_step.lines, at_once.lines)


@given(seeds, indices)
def test_a_mask_chooses_what_its_indices_do_and_the_table_stays(seed, chosen):
    table, mask = random_table(seed), np.isin(np.arange(COUNT), chosen)
    assert_same_table(table.select(mask), table.select(np.flatnonzero(mask)))
    assert_same_table(table, random_table(seed))


@given(seeds, st.permutations(range(COUNT)))
def test_a_shuffle_is_undone_by_its_inverse(seed, order):
    table = random_table(seed, extra={"note": ["1", "2", "3"]})
    assert_same_table(table.select(order).select(np.argsort(order)), table)


@given(seeds, indices)
def test_a_chosen_row_is_named_by_its_line_in_the_file(seed, chosen):
    part = random_table(seed).select(chosen)
    for row, index in enumerate(chosen):
        assert part.where(row) == f"random.csv, line {index + 2}"


@given(seeds)
def test_splits_part_the_table(seed):
    table = sightings(seed)
    parts = [table.select_split(name) for name in np.unique(table.split)]
    assert sum(map(len, parts)) == len(table)
    for part in parts:
        assert len(set(part.split.tolist())) == 1
    lines = np.concatenate([part.lines for part in parts])
    assert sorted(lines) == table.lines.tolist()


@given(seeds, st.integers(1, 19))
def test_a_table_cut_and_stacked_again_is_in_the_order_of_frames(seed, cut):
    table = sightings(seed)
    parts = [table.select(np.arange(cut)), table.select(np.arange(cut, 20))]
    assert_same_table(stacked(parts), table.select(np.argsort(table.frame, kind="stable")))


@given(seeds)
def test_stacking_is_associative_and_one_table_alone_is_only_sorted(seed):
    a, b, c = (sightings([seed, k], count=5) for k in range(3))
    assert_same_table(stacked([stacked([a, b]), c]), stacked([a, stacked([b, c])]))
    assert_same_table(stacked([a]), a.select(np.argsort(a.frame, kind="stable")))


@given(seeds, st.integers(0, COUNT - 1), st.integers(0, COUNT))
def test_a_copy_of_a_row_is_refused_wherever_it_stands(seed, row, place):
    table = random_table(seed, sigmas=False)
    order = np.insert(np.arange(COUNT), place, row)
    first, second = np.flatnonzero(order == row)
    with pytest.raises(InputError) as caught:
        Observations(
            table.points_px[order],
            table.segments_mm[order],
            frame=table.frame[order],
            source="a.csv",
            lines=np.arange(COUNT + 1) + 2,
        )
    assert str(caught.value).startswith(f"a.csv, line {second + 2}: repeats line {first + 2} (frame ")


def test_zero_below_zero_is_the_same_place():
    points, segments = np.array([[0.0, 1.0], [-0.0, 1.0]]), np.tile([[0.0, 0, 0], [1, 0, 0]], (2, 1, 1))
    with pytest.raises(InputError, match="row 1: repeats row 0 "):
        Observations(points, segments, frame=[3, 3])


@given(seeds, st.integers(0, COUNT - 1), st.sampled_from(["points_px", "segments_mm", "frame", "target"]))
def test_what_differs_in_the_least_digit_is_no_copy(seed, row, column):
    table = random_table(seed, sigmas=False)
    order = np.append(np.arange(COUNT), row)
    columns = {n: getattr(table, n)[order] for n in ("points_px", "segments_mm", "frame", "target", "split")}
    changed = columns[column].copy()
    if changed.dtype.kind == "f":
        changed[-1].flat[-1] = np.nextafter(changed[-1].flat[-1], np.inf)
    else:
        changed[-1] = "other" if column == "target" else changed[-1] + 1
    assert len(Observations(**columns | {column: changed})) == COUNT + 1


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_table_without_rows_is_a_table(dimension):
    empty = Observations(np.empty((0, dimension)), np.empty((0, 2, 3)))
    assert len(empty) == 0
    assert empty.dimension == dimension
    assert empty.sightings.shape == (0,)
    assert len(random_table(0).select(np.zeros(COUNT, dtype=bool))) == 0
