"""Correspondences of a mirrored volume are named and never answered; many wrong ones are not taken for such."""

import numpy as np
import pytest

import sonocal as sc
from sonocal.registration import point_line, point_plane, register, rows
from tests.builders.similarities import random_similarity

MIRRORED = [1.0, 1.0, -1.0]


def directions(rng, count):
    found = rng.normal(size=(count, 3))
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def matched(seed, count, kind, *, mirrored=False, wrong=0.0):
    """Points or lines of a volume (px), and lines or planes (mm) that they lie on but for noise of 0.3 mm."""
    rng = np.random.default_rng(seed)
    truth = random_similarity(seed, scale=0.2)
    points = rng.uniform(0, 500, (count, 3))
    there = truth @ points
    there[: round(wrong * count)] = there[rng.permutation(count)[: round(wrong * count)]]
    there += 0.3 * rng.normal(size=there.shape)
    seen = points * MIRRORED if mirrored else points
    ways, normals = directions(rng, count), directions(rng, count)
    planes = np.c_[normals, -np.sum(normals * there, axis=1)]
    lines = np.stack([there - 50.0 * ways, there + 40.0 * ways], axis=1)
    if kind == "points on lines":
        return point_line(seen, lines)
    if kind == "points on planes":
        return point_plane(seen, planes)
    return rows(point_line(seen, lines), point_plane(seen, planes))


KINDS = ["points on lines", "points on planes", "both"]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("count", [30, 100])
def test_a_mirrored_volume_is_named_however_many_agree_by_chance(kind, count):
    for seed in range(6):
        with pytest.raises(sc.NoConsensusError, match="when one of the two sides is mirrored") as caught:
            register(matched(seed, count, kind, mirrored=True))
        assert type(caught.value).__name__ == "MirroredVolumeError"


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("wrong", [0.25, 0.5])
def test_wrong_correspondences_are_no_mirror(kind, wrong):
    for seed in range(6):
        found = register(matched(seed, 60, kind, wrong=wrong))
        assert found.target_from_source.scale == pytest.approx(0.2, rel=0.02)
