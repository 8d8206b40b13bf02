"""Where needles cross images and volumes, against plain linear algebra and against sampling."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonocal import AxisScaled, Similarity
from sonocal.geometry import (
    area_places,
    image_crossings,
    needle_in_image,
    needle_in_volume,
    predicted_needles,
    predicted_points,
)
from tests.builders.similarities import random_axis_scaled, random_similarity

seeds = st.integers(0, 10_000)
VOLUME = np.array([[0.0, 10.0, -20.0], [200.0, 150.0, 90.0]])


def needles(seed, count=12, spread=300.0):
    return np.random.default_rng([seed, 7]).uniform(-spread, spread, (count, 2, 3))


def by_solving(transform, segment):
    """Where a line meets the image: start + k along = corner + u (a pixel right) + v (a pixel down)."""
    right, down = (transform.matrix[:3, k] for k in range(2))
    along = segment[1] - segment[0]
    u, v, _ = np.linalg.solve(np.column_stack([right, down, -along]), segment[0] - transform.translation)
    return u, v


def inside_by_sampling(transform, segment, steps=4001):
    """Least and greatest share of a segment that lies in the volume, by trying many; None where none does."""
    shares = np.linspace(0, 1, steps)
    places = segment[0] + shares[:, None] * (segment[1] - segment[0])
    local = np.linalg.solve(transform.matrix[:3, :3], (places - transform.translation).T).T
    held = shares[((local >= VOLUME[0]) & (local <= VOLUME[1])).all(axis=1)]
    return None if len(held) == 0 else (held[0], held[-1])


def shares_of(transform, segment, points_px):
    """Where on a segment places of the image lie, as shares of its length, and how far beside it, mm."""
    mapped, along = transform @ points_px, segment[1] - segment[0]
    shares = (mapped - segment[0]) @ along / (along @ along)
    beside = np.linalg.norm(mapped - segment[0] - shares[:, None] * along, axis=1)
    return shares, beside


def through_volume(seed, transform, count=12):
    """Segments that begin and end in and about the volume."""
    low, high = VOLUME[0] - 80, VOLUME[1] + 80
    return transform @ np.random.default_rng([seed, 3]).uniform(low, high, (count, 2, 3))


@pytest.mark.parametrize("dimension", [2, 3])
@given(seed=seeds)
def test_places_of_an_area_are_its_corners_once_each_and_its_centre(dimension, seed):
    low, high = np.sort(np.random.default_rng(seed).uniform(-500, 500, (2, dimension)), axis=0)
    *corners, centre = area_places(np.array([low, high]))
    assert len({tuple(corner) for corner in corners}) == 2**dimension
    for corner in corners:
        assert np.all((corner == low) | (corner == high))
    np.testing.assert_allclose(centre, (low + high) / 2)
    np.testing.assert_allclose(np.mean(corners, axis=0), centre, atol=1e-9)


@given(seeds)
def test_a_needle_crosses_the_image_where_three_equations_say(seed):
    transform, lines = random_axis_scaled(seed), needles(seed)
    expected = np.array([by_solving(transform, line) for line in lines])
    np.testing.assert_allclose(predicted_points(transform, lines), expected, rtol=1e-6, atol=1e-5)
    np.testing.assert_allclose(needle_in_image(transform, lines), expected, rtol=1e-6, atol=1e-5)


@given(seeds)
def test_a_crossing_lies_on_its_needle_and_in_the_image(seed):
    transform, lines = random_similarity(seed), needles(seed)
    places = transform @ needle_in_image(transform, lines)
    along = lines[:, 1] - lines[:, 0]
    away = np.cross(places - lines[:, 0], along / np.linalg.norm(along, axis=1)[:, None])
    distance = np.linalg.norm(places - lines[:, 0], axis=1)
    assert np.all(np.linalg.norm(away, axis=1) <= 1e-9 * (1000 + distance))


@given(seeds)
def test_reversing_a_needle_leaves_its_crossing(seed):
    transform, lines = random_similarity(seed), needles(seed)
    for cross in (needle_in_image, predicted_points):
        np.testing.assert_allclose(
            cross(transform, lines[:, ::-1]), cross(transform, lines), rtol=1e-6, atol=1e-6
        )


@given(seeds, st.floats(-3, 3), st.floats(0.2, 4))
def test_where_a_needle_begins_and_ends_leaves_its_crossing(seed, begin, length):
    transform, lines = random_similarity(seed), needles(seed)
    along = lines[:, 1] - lines[:, 0]
    slid = np.stack([lines[:, 0] + begin * along, lines[:, 0] + (begin + length) * along], axis=1)
    np.testing.assert_allclose(
        needle_in_image(transform, slid), needle_in_image(transform, lines), rtol=1e-6, atol=1e-6
    )


@given(seeds)
def test_moving_the_marker_with_the_needle_leaves_its_crossing(seed):
    transform, lines, marker = random_similarity(seed), needles(seed), random_similarity(seed + 1, scale=1.0)
    for cross in (needle_in_image, predicted_points):
        np.testing.assert_allclose(
            cross(marker @ transform, marker @ lines), cross(transform, lines), rtol=1e-6, atol=1e-5
        )


@given(seeds, st.floats(-200, 200), st.floats(-200, 200))
def test_shifting_the_image_in_its_plane_shifts_crossings_back(seed, right, down):
    transform, lines = random_similarity(seed), needles(seed)
    shifted = transform @ Similarity(np.eye(3), [right, down, 0], 1.0)
    expected = needle_in_image(transform, lines) - [right, down]
    np.testing.assert_allclose(needle_in_image(shifted, lines), expected, rtol=1e-6, atol=1e-5)


@given(seeds, st.floats(0.05, 20))
def test_larger_pixels_are_fewer(seed, factor):
    transform, lines = random_axis_scaled(seed), needles(seed)
    coarse = AxisScaled(transform.rotation, transform.translation, transform.scales * factor)
    np.testing.assert_allclose(
        needle_in_image(coarse, lines) * factor, needle_in_image(transform, lines), rtol=1e-6
    )


@given(seeds)
def test_needles_in_the_images_axes_are_the_inverse_of_mapping(seed):
    transform, lines = random_axis_scaled(seed), needles(seed)
    np.testing.assert_allclose(transform @ predicted_needles(transform, lines), lines, atol=1e-8)


def test_a_needle_beside_the_image_plane_crosses_it_nowhere_and_spoils_no_other():
    parallel = np.array([[0.0, 0, 5], [10, 3, 5]])
    within = np.array([[0.0, 0, 0], [10, 3, 0]])
    across = np.array([[4.0, 5, -1], [4, 5, 1]])
    lines = np.stack([parallel, across, within])
    for found in (image_crossings(lines), needle_in_image(Similarity.identity(), lines)):
        np.testing.assert_array_equal(np.isnan(found).all(axis=1), [True, False, True])
        np.testing.assert_allclose(found[1], [4, 5])


@given(seeds)
def test_a_needle_in_a_volume_is_cut_where_sampling_cuts_it(seed):
    transform = random_axis_scaled(seed)
    lines = through_volume(seed, transform)
    for line, ends in zip(lines, needle_in_volume(transform, VOLUME, lines), strict=True):
        sampled = inside_by_sampling(transform, line)
        if np.isnan(ends).any():
            assert np.isnan(ends).all()
            assert sampled is None
        else:
            shares, beside = shares_of(transform, line, ends)
            assert beside.max() < 1e-8
            # Too short a part for the samples to meet it is no part for them.
            found = shares if sampled is None else sampled
            np.testing.assert_allclose(shares, found, atol=1 / 4000 + 1e-9)
            assert sampled is not None or shares[1] - shares[0] < 1 / 2000


@given(seeds)
def test_what_is_cut_out_of_a_needle_is_in_the_volume_and_cut_again_the_same(seed):
    transform = random_axis_scaled(seed)
    parts = needle_in_volume(transform, VOLUME, through_volume(seed, transform))
    parts = parts[~np.isnan(parts).any(axis=(1, 2))]
    assert np.all((parts >= VOLUME[0] - 1e-7) & (parts <= VOLUME[1] + 1e-7))
    long = parts[np.linalg.norm(parts[:, 1] - parts[:, 0], axis=1) > 1e-3]
    np.testing.assert_allclose(needle_in_volume(transform, VOLUME, transform @ long), long, atol=1e-5)


@given(seeds)
def test_reversing_a_needle_reverses_its_part_in_the_volume(seed):
    transform = random_axis_scaled(seed)
    lines = through_volume(seed, transform)
    forwards, backwards = (needle_in_volume(transform, VOLUME, x) for x in (lines, lines[:, ::-1]))
    np.testing.assert_allclose(backwards, forwards[:, ::-1], atol=1e-6)


@given(seeds)
def test_moving_the_marker_with_the_needle_leaves_its_part_in_the_volume(seed):
    transform, marker = random_similarity(seed), random_similarity(seed + 1, scale=1.0)
    lines = through_volume(seed, transform)
    np.testing.assert_allclose(
        needle_in_volume(marker @ transform, VOLUME, marker @ lines),
        needle_in_volume(transform, VOLUME, lines),
        atol=1e-5,
    )


@given(seeds, st.integers(0, 2))
def test_a_needle_along_an_axis_passes_through_or_by(seed, axis):
    """Along one axis the other two never change: a division by zero that must decide rightly."""
    rng = np.random.default_rng(seed)
    place = rng.uniform(VOLUME[0] - 60, VOLUME[1] + 60)
    line = np.stack([place, place])
    line[:, axis] = [-1000, 1000]
    (part,) = needle_in_volume(Similarity.identity(), VOLUME, line[None])
    others = np.delete(np.arange(3), axis)
    meets = np.all((place[others] >= VOLUME[0, others]) & (place[others] <= VOLUME[1, others]))
    assert np.isnan(part).any() != meets
    if meets:
        np.testing.assert_allclose(part[:, axis], VOLUME[:, axis])
        np.testing.assert_allclose(part[:, others], line[:, others])


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("face", [0, 1])
def test_a_needle_in_a_face_of_the_volume_is_in_the_volume(axis, face):
    line = np.stack([VOLUME.mean(axis=0)] * 2)
    line[:, axis] = VOLUME[face, axis]
    along = (axis + 1) % 3
    line[:, along] = [-1000, 1000]
    (part,) = needle_in_volume(Similarity.identity(), VOLUME, line[None])
    np.testing.assert_allclose(part[:, along], VOLUME[:, along])
