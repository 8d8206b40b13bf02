"""An image whose places are off by what is smooth over it is warned of, by the form that explains it best."""

import dataclasses

import numpy as np
import pytest
from benchmarks.comparison import needle_scan
from scipy.spatial.transform import Rotation

import sonocal as sc
from sonocal.calibration.distortion import FACE_MM, distortions

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


def said(rows, **options):
    found = sc.calibrate(rows, image_size_px=(500, 500), **options)
    return [one for one in found.diagnostics if one.code == CODE]


@pytest.mark.parametrize("moved", [along_rays(0.06), along_rays(-0.06), growing(0.06)])
def test_a_distortion_is_found(moved):
    warned = 0
    for seed in range(20):
        found = sc.calibrate(rows_of(seed, 200, moved), image_size_px=(500, 500))
        warned += bool(found.warnings)
    assert warned == 20


def test_the_form_is_named_where_forms_are_unlike():
    """Two scales take up all that is a stretch: of the square of depth the curve is left, and named."""
    for seed in range(5):
        (finding,) = said(rows_of(seed, 400, growing(0.1)), model="anisotropic")
        assert "grows with the square of the depth" in finding.message


@pytest.mark.parametrize("count", [10, 30, 200])
def test_sound_images_are_not_accused(count):
    assert sum(bool(said(rows_of(seed, count))) for seed in range(100)) <= 3


def test_a_form_that_the_transform_takes_up_is_not_tested():
    """An anisotropic fit leaves nothing of a stretch of depth."""
    for seed in range(5):
        rows = rows_of(seed, 100, lambda points: 0.06 * points * [0.0, 1.0])
        assert not said(rows, model="anisotropic")


def test_forms_leave_the_skin_where_it_is():
    """Every error of depth is none at the image's top, and its whole measure at the bottom's middle."""
    middle = np.array([[SIDE / 2, 0.0, 0.0], [SIDE / 2, SIDE, 0.0]])
    found = distortions(middle, np.array([[0.0, 0.0], [SIDE, SIDE]]), SCALE)
    for form in found.values():
        np.testing.assert_allclose(form, [[0, 0, 0], [0, SIDE, 0]], atol=1e-9)
    assert FACE_MM / SCALE < SIDE


def test_rows_that_weigh_alike_show_it_too():
    for seed in range(5):
        found = sc.calibrate(
            rows_of(seed, 300, growing(0.08)), image_size_px=(500, 500), weighting="geometric"
        )
        assert {CODE, "anisotropic-scale"} & {one.code for one in found.warnings}
