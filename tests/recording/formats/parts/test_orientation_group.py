"""The ways an image can lie are a group: 8 of images, 48 of volumes; turning follows its table."""

from itertools import permutations, product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonocal.recording import ArrayFrames
from sonocal.recording.formats.parts.orientation import Orientation, image_from_file, oriented

PAIRS = ("MU", "FN", "AD")
VOLUMES = ["".join(letters) for order in permutations(PAIRS) for letters in product(*order)]
IMAGES = [code for code in VOLUMES if code[2] in "AD"]
codes = st.sampled_from(VOLUMES)


def linear(code, dimension=3):
    """The signed permutation of a code, without the shift that depends on the size."""
    return image_from_file(Orientation.parse(code, dimension, "x"), (1,) * dimension)[:3, :3]


def code_of(matrix):
    """The code of a signed permutation: where each stored axis points."""
    axes = [int(np.argmax(np.abs(column))) for column in matrix.T]
    return "".join(PAIRS[axis][0 if matrix[axis, k] > 0 else 1] for k, axis in enumerate(axes))


def volume(size, seed=0):
    return ArrayFrames(
        np.random.default_rng(seed).permutation(int(np.prod(size)) * 2).reshape(2, *size[::-1])
    )


def test_there_are_as_many_as_a_cube_has():
    assert len({linear(code).tobytes() for code in VOLUMES}) == len(VOLUMES) == 48
    planar = {linear(code, 2)[:2, :2].tobytes() for code in IMAGES}
    assert len(planar) == 8


@pytest.mark.parametrize("code", VOLUMES)
def test_a_code_is_a_signed_permutation_and_comes_back_from_it(code):
    matrix = linear(code)
    np.testing.assert_array_equal(matrix @ matrix.T, np.eye(3))
    assert set(np.abs(matrix).ravel()) == {0.0, 1.0}
    assert code_of(matrix) == code


@given(codes, codes)
def test_one_after_the_other_is_one_of_them(first, second):
    assert code_of(linear(second) @ linear(first)) in VOLUMES


@given(codes)
def test_each_is_undone_by_one_of_them(code):
    inverse = code_of(linear(code).T)
    np.testing.assert_array_equal(linear(inverse) @ linear(code), np.eye(3))


@given(codes, codes, st.permutations([2, 3, 4]))
def test_turning_twice_is_turning_by_the_product(first, second, size):
    frames = volume(size)
    one, other = (Orientation.parse(code, 3, "x") for code in (first, second))
    both = Orientation.parse(code_of(linear(second) @ linear(first)), 3, "x")
    twice, once = oriented(oriented(frames, one, 3), other, 3), oriented(frames, both, 3)
    assert twice.shape == once.shape
    np.testing.assert_array_equal(np.stack(list(twice)), np.stack(list(once)))


@given(codes, st.permutations([2, 3, 4]))
def test_turning_and_turning_back_is_nothing(code, size):
    frames = volume(size)
    there = oriented(frames, Orientation.parse(code, 3, "x"), 3)
    back = oriented(there, Orientation.parse(code_of(linear(code).T), 3, "x"), 3)
    np.testing.assert_array_equal(np.stack(list(back)), np.stack(list(frames)))


@given(codes, st.permutations([2, 3, 4]))
def test_the_map_takes_corners_to_corners_and_keeps_distances(code, size):
    orientation = Orientation.parse(code, 3, "x")
    turned = tuple(int(n) for n in orientation.reorder(size))
    matrix = image_from_file(orientation, turned)
    corners = np.array([[*corner, 1] for corner in product(*((0, n - 1) for n in size))])
    wanted = {tuple(corner) for corner in product(*((0, n - 1) for n in turned))}
    assert {tuple(corner) for corner in (corners @ matrix.T)[:, :3].astype(int)} == wanted
    assert abs(np.linalg.det(matrix)) == pytest.approx(1.0)


@given(codes, st.lists(st.floats(0.1, 5), min_size=3, max_size=3))
def test_sizes_and_spacings_go_with_their_axes(code, spacing):
    orientation = Orientation.parse(code, 3, "x")
    np.testing.assert_array_equal(np.abs(linear(code)) @ spacing, orientation.reorder(spacing))


@pytest.mark.parametrize("code", IMAGES)
def test_the_third_letter_moves_no_pixel_of_an_image(code):
    """An image has no extent out of its plane; two letters do as three."""
    frames = ArrayFrames(np.arange(24).reshape(2, 3, 4))
    three, two = (Orientation.parse(letters, 2, "x") for letters in (code, code[:2]))
    one, other = oriented(frames, three, 2), oriented(frames, two, 2)
    np.testing.assert_array_equal(np.stack(list(one)), np.stack(list(other)))
    np.testing.assert_array_equal(image_from_file(three, (4, 3))[:2], image_from_file(two, (4, 3))[:2])
    assert three.changes(2) == (linear(code, 2)[:2, :2] != np.eye(2)).any()


@given(codes, st.sampled_from([str.lower, str.upper, lambda code: f" {code} "]))
def test_case_and_blanks_mean_nothing(code, spelt):
    one, other = Orientation.parse(code, 3, "x"), Orientation.parse(spelt(code), 3, "x")
    assert (one.axes, one.signs) == (other.axes, other.signs)


@pytest.mark.parametrize("channels", [1, 3])
@given(code=codes)
def test_colours_stay_with_their_pixels(channels, code):
    grey = np.arange(48).reshape(2, 2, 3, 4)
    coloured = np.stack([grey * (k + 1) for k in range(channels)], axis=-1)
    orientation = Orientation.parse(code, 3, "x")
    of_grey = np.stack(list(oriented(ArrayFrames(grey), orientation, 3)))
    of_colour = np.stack(list(oriented(ArrayFrames(coloured), orientation, 3)))
    for k in range(channels):
        np.testing.assert_array_equal(of_colour[..., k], of_grey * (k + 1))
