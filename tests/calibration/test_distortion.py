"""An image whose places are off by what is smooth over it is warned of, by the form that explains it best."""

import dataclasses
import re

import numpy as np
import pytest
from benchmarks.comparison import needle_scan
from scipy.spatial.transform import Rotation

import sonocal as sc
from sonocal.calibration.distortion import FACE_MM, distortions
from sonocal.simulation.scene import simulate_observations

CODE = "image-distortion"
SIDE, SCALE = 500.0, 0.24


def rows_of(seed, count, moved=None):
    """Sightings of a 2D image; `moved` carries points (N, 2) to where they are seen."""
    rng = np.random.default_rng([seed, count])
    truth = (Rotation.random(random_state=seed).as_matrix(), rng.uniform(-100, 100, 3))
    rows = needle_scan(rng, truth, 2, count)
    points = rows.points_px if moved is None else rows.points_px + moved(rows.points_px)
    return dataclasses.replace(rows, points_px=points)


def along_rays(share, face_px=250.0):
    """Depth beyond the face of a curved probe, off by a share of itself along the rays."""

    def moved(points):
        ray = points - [SIDE / 2, -face_px]
        length = np.linalg.norm(ray, axis=1, keepdims=True)
        return share * np.maximum(length - face_px, 0) * ray / length

    return moved


def growing(share):
    """An error that grows with the square of the depth."""
    return lambda points: share * points[:, 1:] ** 2 / SIDE * [0.0, 1.0]


def radial(share):
    """An error that grows with the cube of the distance from the image's middle, as large as the share at corners."""

    def moved(points):
        away = points - SIDE / 2
        return share * away * np.sum(away**2, axis=1, keepdims=True) / (SIDE**2 / 2)

    return moved


def sheared(angle_deg):
    """Axes that are off a right angle by so much."""
    return lambda points: np.tan(np.radians(angle_deg)) * (points[:, 1:] - SIDE / 2) * [1.0, 0.0]


def said(rows, **options):
    found = sc.calibrate(rows, image_size_px=(500, 500), **options)
    return [one for one in found.diagnostics if one.code == CODE]


def said_of(rows):
    return [one for one in sc.calibrate(rows).diagnostics if one.code == CODE]


@pytest.mark.parametrize("moved", [along_rays(0.06), along_rays(-0.06), growing(0.06)])
def test_a_distortion_is_found(moved):
    warned = 0
    for seed in range(6):
        found = sc.calibrate(rows_of(seed, 200, moved), image_size_px=(500, 500))
        warned += bool(found.warnings)
    assert warned == 6


def test_the_form_is_named_where_forms_are_unlike():
    """Two scales take up all that is a stretch: of the square of depth the curve is left, and named."""
    for seed in range(5):
        (finding,) = said(rows_of(seed, 400, growing(0.1)), model="anisotropic")
        assert "grows with the square of the depth" in finding.message


@pytest.mark.parametrize("count", [10, 30, 200])
def test_sound_images_are_not_accused(count):
    assert sum(bool(said(rows_of(seed, count))) for seed in range(30)) <= 1


def test_a_form_that_the_transform_takes_up_is_not_tested():
    """An anisotropic fit leaves nothing of a stretch of depth."""
    for seed in range(5):
        rows = rows_of(seed, 100, lambda points: 0.06 * points * [0.0, 1.0])
        assert not said(rows, model="anisotropic")


def test_forms_leave_the_skin_where_it_is():
    """Every error of depth is none at the image's top, and its whole measure at the bottom's middle."""
    middle = np.array([[SIDE / 2, 0.0, 0.0], [SIDE / 2, SIDE, 0.0]])
    found = distortions(middle, np.array([[0.0, 0.0], [SIDE, SIDE]]), SCALE)
    for form in ("depth", "rays", "squared"):
        np.testing.assert_allclose(found[form], [[0, 0, 0], [0, SIDE, 0]], atol=1e-9)
    assert FACE_MM / SCALE < SIDE


def test_rows_that_weigh_alike_show_it_too():
    for seed in range(5):
        found = sc.calibrate(
            rows_of(seed, 300, growing(0.08)), image_size_px=(500, 500), weighting="geometric"
        )
        assert {CODE, "anisotropic-scale"} & {one.code for one in found.warnings}


@pytest.mark.parametrize("share", [0.05, -0.05])
def test_a_radial_distortion_is_named_by_its_size_at_the_corners(share):
    for seed in range(5):
        (finding,) = said(rows_of(seed, 200, radial(share)))
        assert "cube of the distance from the middle" in finding.message
        percent = float(re.search(r"([+-][\d.]+) % \(", finding.message)[1])
        assert percent == pytest.approx(100 * share, abs=2.5)
        assert "grabbed" in finding.advice


@pytest.mark.parametrize("angle_deg", [3.0, -5.0])
def test_a_shear_is_named_by_its_angle(angle_deg):
    for seed in range(5):
        (finding,) = said(rows_of(seed, 200, sheared(angle_deg)))
        assert "u and v are not at right angles" in finding.message
        degrees = float(re.search(r"by ([+-][\d.]+) deg", finding.message)[1])
        assert degrees == pytest.approx(angle_deg, abs=1.0)


@pytest.mark.parametrize(("first", "second"), [(0, 1), (0, 2), (1, 2)])
def test_axes_of_a_volume_that_are_not_at_right_angles_are_named(first, second):
    for seed in range(3):
        rows = simulate_observations(3, 100, seed=seed).observations
        points = rows.points_px.copy()
        points[:, first] += 0.08 * (points[:, second] - points[:, second].mean())
        (finding,) = said_of(dataclasses.replace(rows, points_px=points))
        assert f"{'uvw'[first]} and {'uvw'[second]} are not at right angles" in finding.message


def test_a_scan_of_the_middle_of_the_image_is_judged_by_the_corners():
    """Forms are laid about the image's middle, whatever part of it was seen; the error at its corners counts."""
    middle = np.array([[SIDE / 2, SIDE / 2, 0.0], [SIDE, SIDE, 0.0]])
    found = distortions(middle, np.array([[0.0, 0.0], [SIDE, SIDE]]), SCALE)
    np.testing.assert_allclose(found["radial"], [[0, 0, 0], [SIDE / 2, SIDE / 2, 0]], atol=1e-9)
    np.testing.assert_allclose(found["uv"], [[0, 0, 0], [SIDE / 2, 0, 0]], atol=1e-9)


@pytest.mark.parametrize("count", [10, 40, 150])
def test_sound_volumes_are_not_accused(count):
    rows = (simulate_observations(3, count, seed=seed).observations for seed in range(15))
    assert sum(bool(said_of(one)) for one in rows) <= 1
