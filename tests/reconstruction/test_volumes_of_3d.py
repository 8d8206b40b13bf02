"""Volumes of a 3D probe are put where they were as the stacks of images that they are."""

import numpy as np
import pytest
from benchmarks.simulators.fields import grey_at, path, probe_from_image

import sonocal as sc
from sonocal import UnsupportedError
from sonocal.reconstruction import reconstruct_like_plus
from sonocal.recording import ArrayFrames, ImageGeometry, Poses, Recording

SHAPE = (12, 40, 50)
MASK = np.ones(SHAPE[1:], dtype=bool)
MODES = ["nearest", "linear", "between"]


def stacked(poses, valid=None):
    """A 3D probe's volumes of the field, and the same slices as images of a 2D probe with a pose each."""
    w, v, u = np.indices(SHAPE).astype(float)
    voxels = np.stack([u, v, w, 1 + 0 * u], axis=-1)
    volumes = np.stack(
        [np.rint(grey_at((voxels @ (pose @ probe_from_image()).T)[..., :3])) for pose in poses]
    ).astype(np.uint8)
    seen = np.where(
        np.ones(len(poses), bool)[:, None, None] if valid is None else valid[:, None, None], poses, np.nan
    )
    frames, one = ArrayFrames(volumes), Poses.of("Probe", "Tracker", seen)
    probe = Recording(np.arange(len(poses)) / 5, frames, {one.name: one}, ImageGeometry.of(frames, 3, "MF"))
    return probe, volumes, seen


def as_images(volumes, seen):
    """Between two volumes is an image without a pose: nothing is known of the way between them."""
    images, poses = [], []
    from_image = probe_from_image()
    for volume, pose in zip(volumes, seen, strict=True):
        for w, image in enumerate(volume):
            shift = np.eye(4)
            shift[2, 3] = w
            images.append(image)
            poses.append(pose @ from_image @ shift @ np.linalg.inv(from_image))
        images.append(0 * image)
        poses.append(np.full((4, 4), np.nan))
    frames, one = ArrayFrames(np.stack(images)), Poses.of("Probe", "Tracker", np.stack(poses))
    return Recording(np.arange(len(images)) / 60, frames, {one.name: one}, ImageGeometry.of(frames, 2, "MF"))


@pytest.mark.parametrize("mode", MODES)
def test_a_volume_is_a_stack_of_images(mode):
    probe, volumes, seen = stacked(path(4, step_mm=1.1), np.array([True, False, True, True]))
    options = {
        "mask": MASK,
        "interpolation": mode,
        "coverage": True,
        "bounds_mm": [[-8.03, 21, 61], [1, 27, 68]],
    }
    whole = sc.reconstruct(probe, probe_from_image(), **options)
    flat = sc.reconstruct(as_images(volumes, seen), probe_from_image(), **options)
    assert (whole.images, whole.left_out) == (3, 1)
    off = np.abs(whole.values.astype(int) - flat.values)
    assert np.mean((off <= 1) & (whole.coverage == flat.coverage)) > 0.99
    assert whole.filled > 500


@pytest.mark.parametrize("mode", MODES)
def test_it_shows_the_field(mode):
    probe, _, _ = stacked(path(3, step_mm=1.1))
    volume = sc.reconstruct(
        probe,
        probe_from_image(),
        mask=MASK,
        interpolation=mode,
        coverage=True,
        spacing_mm=0.3,
        speckle="kept",
    )
    there = volume.coverage > 0
    z, y, x = np.nonzero(there)
    points = np.stack([x, y, z], axis=1) * volume.grid.spacing_mm + volume.grid.origin_mm
    off = volume.values[there] - grey_at(points)
    assert np.sqrt(np.mean(off**2)) < 6
    assert abs(off.mean()) < 0.5


def test_a_mask_is_found_and_what_is_not_done_is_refused(tmp_path):
    probe, _, _ = stacked(path(3))
    assert sc.reconstruct(probe, probe_from_image()).filled > 1000
    with pytest.raises(UnsupportedError, match="is not told of the volumes of a 3D probe"):
        sc.reconstruct(probe, probe_from_image(), mask=MASK, error=True, noise_mm=0.2)
    devices = tmp_path / "devices.xml"
    devices.write_text(
        '<PlusConfiguration version="2.1"><CoordinateDefinitions/><VolumeReconstruction OutputSpacing="1 1 1" '
        'ReferenceCoordinateFrame="Tracker"/></PlusConfiguration>'
    )
    with pytest.raises(UnsupportedError, match="of which PLUS makes none"):
        reconstruct_like_plus(probe, probe_from_image(), devices)
