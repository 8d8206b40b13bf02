"""Lines in volumes, and slices out of them."""

import numpy as np
import pytest

from sonocal import InputError
from sonocal.detection import LineCandidate, detect_line_near, detect_lines, line_through_slices, slice_volume
from sonocal.detection.line_fit import bright_sections, fit_line

SIDE = 64


def tube(first, second, noise=3.0, seed=0):
    """A bright segment in dark noise, indexed [w, v, u]."""
    w, v, u = np.mgrid[:SIDE, :SIDE, :SIDE]
    points = np.stack([u, v, w], axis=-1) - np.asarray(first, dtype=float)
    along = np.subtract(second, first).astype(float)
    t = np.clip(points @ along / (along @ along), 0, 1)
    squares = ((points - t[..., None] * along) ** 2).sum(-1)
    volume = 60 + 150 * np.exp(-0.5 * squares / 1.5**2)
    volume += np.random.default_rng(seed).normal(scale=noise, size=volume.shape)
    return volume.clip(0, 255).astype(np.uint8)


def tailed(first, second, tail):
    """Log-compressed pulses along a segment, each followed by two weaker ones towards `tail`, indexed [w, v, u]."""
    w, v, u = np.mgrid[:SIDE, :SIDE, :SIDE]
    points = np.stack([u, v, w], axis=-1) - np.asarray(first, dtype=float)
    along = np.subtract(second, first).astype(float)
    amplitude = np.full(points.shape[:3], 10 ** (-40 / 20))
    for order in range(3):
        offset = points - order * 1.8 * np.asarray(tail)
        t = np.clip(offset @ along / (along @ along), 0, 1)
        squares = ((offset - t[..., None] * along) ** 2).sum(-1)
        amplitude += 10 ** (-7 * order / 20) * 0.8 * np.exp(-0.5 * squares / 0.7**2)
    return (255 * (1 + 20 * np.log10(amplitude) / 60)).clip(0, 255).astype(np.uint8)


SEGMENT = ((8.0, 20.0, 12.0), (55.0, 44.0, 50.0))


def errors(line, segment):
    first, second = np.asarray(segment)
    along = (second - first) / np.linalg.norm(second - first)
    angle = np.degrees(np.arccos(min(1.0, abs(line.direction @ along))))
    offset = line.ends_px.mean(axis=0) - first
    return angle, np.linalg.norm(offset - (offset @ along) * along)


def test_a_line_is_found_within_half_a_degree_and_a_third_of_a_voxel():
    best = detect_lines(tube(*SEGMENT))[0]
    angle, distance = errors(best, SEGMENT)
    assert angle < 0.5
    assert distance < 0.3


def test_the_same_seed_finds_the_same_line():
    first, second = (detect_lines(tube(*SEGMENT), seed=3)[0].ends_px for _ in range(2))
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("tail", [[0, 1, 0], [0, -1, 0], [0.4, 0.6, -0.69], [-0.6, 0.0, 0.8]])
def test_a_tail_does_not_pull_the_line_whichever_way_it_runs(tail):
    volume = tailed(*SEGMENT, tail)
    line = detect_lines(volume)[0]
    angle, distance = errors(line, SEGMENT)
    assert angle < 0.2
    assert distance < 0.1
    bright, weight = bright_sections(volume.astype(np.float32), np.array(SEGMENT), 6.0)
    ends, _ = fit_line(bright, weight, 0.0)
    _, pulled = errors(LineCandidate(ends, np.zeros((2, 3, 3)), 1.0), SEGMENT)
    assert pulled > 2 * distance


@pytest.mark.parametrize("axes", [(1, 2, 0), (2, 1, 0), (0, 2, 1)])
def test_a_volume_with_its_axes_exchanged_has_the_same_line(axes):
    volume = tailed(*SEGMENT, [0.3, 0.9, 0.3])
    line, other = detect_lines(volume)[0], detect_lines(np.ascontiguousarray(volume.transpose(axes)))[0]
    # An array's axes are (w, v, u), a point's (u, v, w).
    exchanged = other.ends_px[:, ::-1][:, np.argsort(axes)][:, ::-1]
    angle, distance = errors(LineCandidate(exchanged, other.covariance_px2, 1.0), line.ends_px)
    assert angle < 0.1
    assert distance < 0.03


def test_along_the_tail_an_end_is_less_certain():
    tail = np.array([0.0, 1.0, 0.0])
    line = detect_lines(tailed(*SEGMENT, tail))[0]
    down = tail - (tail @ line.direction) * line.direction
    down /= np.linalg.norm(down)
    side = np.cross(down, line.direction)
    for covariance in line.covariance_px2:
        assert down @ covariance @ down > side @ covariance @ side > 0


@pytest.mark.parametrize("reach", [0.2, 1.0, 10.0])
def test_a_faint_needle_is_found_near_where_it_must_be(reach):
    """Given any two points of it, within the volume or far outside, a voxel and a half beside it."""
    volume = (60 + (tube(*SEGMENT, noise=12.0).astype(float) - 60) / 4).astype(np.uint8)
    middle, along = np.mean(SEGMENT, axis=0), np.subtract(*SEGMENT[::-1])
    needle = middle + np.array([[-reach], [reach]]) * along + [1.5, 0.0, 0.0]
    angle, distance = errors(detect_line_near(volume, needle), SEGMENT)
    assert angle < 1
    assert distance < 0.5


@pytest.mark.parametrize("seed", range(5))
def test_where_no_needle_is_none_is_found_near(seed):
    rng = np.random.default_rng(seed)
    noise = (60 + rng.normal(scale=12, size=(SIDE,) * 3)).clip(0, 255).astype(np.uint8)
    assert detect_line_near(noise, rng.uniform(0, SIDE, (2, 3))) is None
    assert detect_line_near(noise, [[-5.0, 0.0, 3.0], [-5.0, 9.0, 70.0]]) is None


def test_an_end_is_uncertain_across_the_line_only():
    line = detect_lines(tube(*SEGMENT))[0]
    for covariance in line.covariance_px2:
        assert abs(line.direction @ covariance @ line.direction) < 1e-12
        assert np.trace(covariance) > 0


def test_a_volume_of_one_grey_has_no_line():
    assert detect_lines(np.full((32, 32, 32), 90, np.uint8)) == []
    assert detect_lines(np.zeros((32, 32, 32), np.uint8)) == []


@pytest.mark.parametrize("seed", range(5))
def test_noise_has_no_line(seed):
    noise = 60 + np.random.default_rng(seed).normal(scale=12, size=(SIDE,) * 3)
    assert detect_lines(noise.clip(0, 255).astype(np.uint8)) == []


def test_a_picture_is_no_volume():
    with pytest.raises(InputError, match="3D images of 16 px or more a side"):
        detect_lines(np.zeros((32, 32), np.uint8))


def test_a_slice_shows_the_voxels_it_says_it_shows():
    volume = np.random.default_rng(0).random((20, 30, 40)).astype(np.float32)
    flat = slice_volume(volume, 0.0, offset_px=0.5)
    u, v, w = flat.to_volume([[7.0, 11.0]])[0]
    np.testing.assert_allclose([u, v, w], [7, 11, 10], atol=1e-9)
    np.testing.assert_allclose(flat.image[11, 7], volume[10, 11, 7], rtol=1e-5)
    across = slice_volume(volume, np.pi / 2, offset_px=-0.5)
    u, v, w = across.to_volume([[20.0, 11.0]])[0]
    np.testing.assert_allclose(across.image[11, 20], volume[round(w), 11, round(u)], rtol=1e-4)


def test_a_tilted_slice_is_rigid():
    cut = slice_volume(np.zeros((20, 30, 40)), 0.7, tilt=0.3, offset_px=2)
    rotation = cut.volume_from_slice[:3, :3]
    np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1)


def test_sections_in_slices_give_the_same_line():
    line = line_through_slices(tube(*SEGMENT), np.radians([110, 130, 150]), offsets_px=[-15, 0, 15])
    angle, distance = errors(line, SEGMENT)
    assert angle < 3
    assert distance < 1
