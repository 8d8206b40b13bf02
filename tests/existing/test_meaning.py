"""What a matrix means, and the one sentence for each that no scanner's image has."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonocal.existing import Existing, meaning_of
from sonocal.existing.meaning import matrix_findings
from tests.builders.similarities import random_similarity

seeds = st.integers(0, 10_000)
SCALE = 0.2


def existing(matrix):
    return Existing("a.xml", "PLUS device set", "ImageToProbe", matrix)


def similar(seed, scale=SCALE):
    return random_similarity(seed, scale).matrix


def changed(seed, linear, scale=SCALE):
    """A similarity of an image that was changed first."""
    matrix = similar(seed, scale).copy()
    matrix[:3, :3] = matrix[:3, :3] @ linear
    return matrix


@given(seed=seeds, scale=st.floats(0.02, 0.7))
def test_a_similarity_has_no_finding_and_its_own_parts(seed, scale):
    one = random_similarity(seed, scale)
    meaning = meaning_of(one.matrix)
    assert matrix_findings(existing(one.matrix)) == ()
    assert meaning.scales_mm_per_px == pytest.approx([scale] * 3)
    np.testing.assert_allclose(meaning.rotation, one.rotation, atol=1e-9)
    np.testing.assert_array_equal(meaning.offset_mm, one.translation)
    assert meaning.uv_deg == pytest.approx(90)
    assert meaning.third_deg == pytest.approx(0, abs=1e-5)


SHEAR = np.array([[1.0, np.sin(np.radians(2)), 0], [0, np.cos(np.radians(2)), 0], [0, 0, 1]])
ODD = {
    "sheared-matrix": (
        SHEAR,
        SCALE,
        "its axes u and v are 88.00 deg apart in space, where a scanner's are 90",
    ),
    "anisotropic-scale": (
        np.diag([1, 1.06, 1.03]),
        SCALE,
        "0.20000 and 0.21200 mm/px, 5.7 % apart along u and v",
    ),
    "mirrored-matrix": (
        np.diag([1, 1, -1]),
        SCALE,
        "mirrors: its third column points against the image's normal",
    ),
    "rigid-matrix": (np.eye(3), 1.0, "scales nothing: it is from mm, or by it a pixel is 1 mm wide"),
    "inverted-matrix": (
        np.eye(3),
        5.0,
        "is it the inverse, from the probe to the image? its inverse has 0.2 mm/px",
    ),
    "implausible-units": (np.eye(3), 2e-4, "are these metres? ImageToProbe of a.xml has 0.0002 mm/px"),
    "third-column": (
        np.diag([1, 1, 5]),
        SCALE,
        "has a third column of 1 mm/px, 0.0 deg off the image's normal",
    ),
}


@pytest.mark.parametrize("code", ODD)
@given(seed=seeds)
def test_each_oddity_is_named_in_a_sentence_whatever_the_place(code, seed):
    linear, scale, words = ODD[code]
    found = matrix_findings(existing(changed(seed, linear, scale)))
    assert [one.code for one in found] == [code]
    assert words in found[0].message
    assert "ImageToProbe of a.xml" in found[0].message
    assert found[0].advice


@given(seed=seeds)
def test_of_a_2d_image_the_third_column_moves_nothing(seed):
    """The rotation is told by u and v alone, so that a mirrored or missing third column does not turn it."""
    plain = meaning_of(similar(seed))
    for third in (-1.0, 5.0, 1e-6):
        other = meaning_of(changed(seed, np.diag([1, 1, third])))
        np.testing.assert_allclose(other.rotation, plain.rotation, atol=1e-9)
    for dimension, severity in ((2, "info"), (None, "info"), (3, "warning")):
        (finding,) = matrix_findings(existing(changed(seed, np.diag([1, 1, -1]))), dimension=dimension)
        assert finding.severity == severity
    (finding,) = matrix_findings(existing(changed(seed, np.diag([1, 1, 5]))), dimension=3)
    assert finding.severity == "warning"


@given(seed=seeds, angle=st.floats(-3, 3))
def test_the_rotation_of_a_sheared_matrix_is_between_its_axes(seed, angle):
    shear = np.array([[1, np.sin(np.radians(angle)), 0], [0, np.cos(np.radians(angle)), 0], [0, 0, 1]])
    matrix = changed(seed, shear)
    rotation = meaning_of(matrix).rotation
    for i in range(2):
        along = matrix[:3, i] / np.linalg.norm(matrix[:3, i])
        apart = np.degrees(np.arccos(np.clip(along @ rotation[:, i], -1, 1)))
        assert apart == pytest.approx(abs(angle) / 2, abs=1e-4)


def test_plus_own_spine_matrix_is_said_to_shear(data_folder):
    from sonocal.existing import read_existing

    found = matrix_findings(read_existing(data_folder / "volumes" / "SpinePhantom_LN_MAXI.xml"), 2)
    assert [one.code for one in found] == ["anisotropic-scale", "sheared-matrix"]
    assert "92.74 deg apart" in found[1].message
