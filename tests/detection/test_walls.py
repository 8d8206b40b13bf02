"""Walls in images and volumes: laws of a detector, and pictures whose truth is known by a formula."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter

from sonocal import InputError
from sonocal.detection import DetectionOptions, WallDetector
from sonocal.detection.wall_recordings import RecordedWalls
from sonocal.simulation.ultrasound import BATH, Look, UltrasoundImager
from sonocal.simulation.ultrasound_probe import curvilinear, linear
from sonocal.simulation.ultrasound_walls import WallLook, wall_echo
from tests.builders.sweeps import recording_of_images
from tests.builders.wall_images import wall_image

SHAPE = (300, 360)
MIDDLE = np.array([180.3, 150.7])
WHOLE = np.ones(SHAPE, dtype=bool)


def normal_at(degrees):
    return np.array([np.sin(np.radians(degrees)), np.cos(np.radians(degrees))])


def detected(image, mask=None, count=3):
    return WallDetector(np.ones(image.shape, dtype=bool) if mask is None else mask, count).detect(image)


def off(wall, normal, through=MIDDLE):
    return (wall.points_px - through) @ normal


@settings(max_examples=25, deadline=None)
@given(st.floats(-80, 80), st.integers(0, 99))
def test_a_wall_at_any_angle_is_found_to_a_tenth_of_a_pixel_and_before_its_second_echo(degrees, seed):
    normal = normal_at(degrees)
    walls, why = detected(wall_image(normal, MIDDLE, SHAPE, seed=seed))
    assert why == ""
    np.testing.assert_allclose(off(walls[0], normal), 0, atol=0.1)
    assert not walls[0].is_echo


@pytest.mark.parametrize("degrees", [0, 12, -35, 60])
@pytest.mark.parametrize(
    "how",
    [
        {"peak": 330.0},  # so much gain that most of the pulse is white
        {"peak": 120.0},
        {"fading": 90.0},
        {"part": 0.5},
        {"gap": 0.1},
        {"second_share": 2.0, "peak": 180.0},  # the second echo brighter than the first
        {"spots": [(60, 60), (300, 220), (200, 40), (120, 260)]},
        {"sigma": 4.0, "second": 30.0},
    ],
)
def test_gain_fading_gaps_spots_and_second_echoes_do_not_move_it(degrees, how):
    normal = normal_at(degrees)
    walls, _ = detected(wall_image(normal, MIDDLE, SHAPE, **how))
    np.testing.assert_allclose(off(walls[0], normal), 0, atol=0.2)


def test_the_second_echo_is_told_and_comes_last():
    walls, _ = detected(wall_image([0.1, 1], MIDDLE, SHAPE))
    assert [wall.is_echo for wall in walls] == [False, True]
    assert walls[1].score < walls[0].score


def test_shifting_mirroring_and_turning_the_image_moves_the_wall_with_it():
    image = wall_image(normal_at(15), MIDDLE, SHAPE, second_share=0.0)
    wall = detected(image)[0][0]
    normal = wall.normal
    shifted = detected(np.roll(image, (6, 12), axis=(0, 1))[10:, 16:])[0][0]
    np.testing.assert_allclose(
        (shifted.points_px - [12 - 16, 6 - 10] - MIDDLE) @ normal, off(wall, normal), atol=0.05
    )
    flipped = detected(image[:, ::-1])[0][0].points_px * [-1, 1] + [SHAPE[1] - 1, 0]
    np.testing.assert_allclose((flipped - MIDDLE) @ normal, 0, atol=0.05)
    turned = detected(np.ascontiguousarray(image.T))[0][0].points_px[:, ::-1]
    np.testing.assert_allclose((turned - MIDDLE) @ normal, 0, atol=0.05)


def test_its_points_lie_well_apart_on_it_and_their_covariance_is_across_it():
    normal = normal_at(20)
    wall = detected(wall_image(normal, MIDDLE, SHAPE))[0][0]
    assert np.linalg.norm(wall.points_px[1] - wall.points_px[0]) > 150
    across = normal @ wall.covariance_px2 @ normal
    along = normal[::-1] * [1, -1]
    assert np.all(across > 0.005)
    np.testing.assert_allclose(along @ wall.covariance_px2 @ along, 0, atol=1e-4 * across.max())


def test_a_plane_of_a_volume_is_found_by_three_points():
    shape, normal = (60, 70, 64), np.array([0.2, 1.0, -0.15])
    through = np.array([32.0, 30.4, 29.0])
    walls, _ = detected(wall_image(normal, through, shape, sigma=1.2, second=8.0))
    unit = normal / np.linalg.norm(normal)
    np.testing.assert_allclose((walls[0].points_px - through) @ unit, 0, atol=0.15)
    sides = walls[0].points_px[1:] - walls[0].points_px[0]
    assert np.linalg.norm(np.cross(*sides)) > 300


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("geometry", [curvilinear(), linear()], ids=["curvilinear", "linear"])
def test_where_there_is_no_wall_none_is_found_and_it_is_said_why(geometry, seed):
    imager = UltrasoundImager(geometry, BATH)
    walls, why = detected(imager.image([], np.random.default_rng(seed)), imager.inside)
    assert walls == []
    assert why


def test_a_black_and_a_white_image_have_no_wall():
    for level in (0, 255):
        walls, why = detected(np.full(SHAPE, level, dtype=np.uint8))
        assert (walls, why) == ([], "nothing straight stands out")


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 999), st.floats(4.0, 30.0), st.booleans())
def test_speckle_with_bright_spots_in_it_has_no_wall(seed, level, smooth):
    """A brightest place in every section, and spots that pull the rest into line, are no wall."""
    rng = np.random.default_rng(seed)
    field = rng.normal(size=(2, *SHAPE))
    field = gaussian_filter(field, (0, 1.0, 2.0 if smooth else 0.0))
    grey = 40 + level + 20 * np.log10(np.hypot(*field) / field.std() + 1e-3) * level / 10
    rows, cols = np.indices(SHAPE)
    for row, col in rng.uniform([20, 20], [280, 340], (6, 2)):
        grey = np.maximum(grey, 250 - 0.5 * ((rows - row) ** 2 + 0.3 * (cols - col) ** 2))
    walls, why = detected(np.clip(grey, 0, 255).astype(np.uint8))
    assert walls == []
    assert why


def test_the_edge_of_what_is_shown_is_no_wall_however_bright():
    """A crop's border, a face's bright band, a step from dark to bright."""
    rows = np.mgrid[: SHAPE[0], : SHAPE[1]][0]
    rng = np.random.default_rng(0)
    for image in (
        np.where(rows < 40, 250 - 6 * rows, 20),
        np.where(rows > 200, 200, 20),
        np.where(rows < 3, 255, 20),
    ):
        walls, _ = detected(np.clip(image + 3 * rng.normal(size=SHAPE), 0, 255).astype(np.uint8))
        assert walls == []
    mask = (rows > 60) & (rows < 240)
    image = np.where((np.abs(rows - 60) < 4) | (np.abs(rows - 240) < 4), 255, 20).astype(np.uint8)
    assert detected(image, mask)[0] == []


def test_an_arc_is_no_wall():
    rows, cols = np.mgrid[: SHAPE[0], : SHAPE[1]]
    away = np.hypot(rows + 60, cols - 180) - 250
    arc = np.clip(20 + 200 * np.exp(-0.5 * (away / 2.0) ** 2), 0, 255).astype(np.uint8)
    walls, why = detected(arc)
    assert walls == []
    assert why


@pytest.mark.parametrize(("look", "most_px"), [(BATH, 0.35), (Look(), 0.5)], ids=["bath", "tissue"])
def test_walls_of_simulated_ultrasound_are_found_where_they_are(look, most_px):
    geometry = curvilinear(300, 300, 0.4)
    imager = UltrasoundImager(geometry, look)
    detector = WallDetector(imager.inside)
    for seed in range(6):
        rng = np.random.default_rng(seed)
        place = geometry.point_at(np.array(rng.uniform(0.3, 0.85)), np.array(rng.uniform(-0.3, 0.3)))
        normal = np.array([np.tan(rng.normal(scale=0.25)), 1.0, np.tan(rng.normal(scale=0.1))])
        normal /= np.linalg.norm(normal)
        image = imager.image(
            wall_echo(np.append(normal, -normal @ place), geometry, look, WallLook(), rng), rng
        )
        walls, _ = detector.detect(image)
        px = np.column_stack([walls[0].points_px, np.zeros(2)]) - place / geometry.scale_mm_per_px
        assert np.abs(px @ normal).max() / np.hypot(*normal[:2]) < most_px


def test_lines_that_stand_still_in_a_recording_are_left_out_and_those_that_move_stay():
    drawn = wall_image([0, 1], [180, 80], SHAPE, second_share=0.0, peak=180)
    moving = [
        np.maximum(drawn, wall_image([0.2, 1], [180, 140 + 8 * i], SHAPE, second_share=0.0, seed=i))
        for i in range(12)
    ]
    walls = RecordedWalls(recording_of_images(moving), DetectionOptions(mask=WHOLE))
    found = walls.detect()
    assert set(found.frame.tolist()) == set(range(12))
    assert found.points_px[..., 1].min() > 90
    assert walls.reasons["what stands out stands still in the image"] == 12


def test_what_cannot_be_looked_at_is_refused_in_a_sentence():
    with pytest.raises(InputError, match="count of 1 or more; got 0"):
        WallDetector(WHOLE, 0)
    with pytest.raises(InputError, match="hides the whole image"):
        WallDetector(~WHOLE)
    with pytest.raises(InputError, match=r"is \(20, 30\) where the mask is \(300, 360\)"):
        WallDetector(WHOLE).detect(np.zeros((20, 30), dtype=np.uint8))
