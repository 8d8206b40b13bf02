"""A volume that grows as images come is the volume of all of them."""

import dataclasses

import numpy as np
import pytest
from benchmarks.simulators.fields import path, probe_from_image, recorded

import sonocal as sc
from sonocal import InputError, UnsupportedError
from sonocal.reconstruction import LiveVolume
from sonocal.recording import Poses
from sonocal.recording.stream import Item, RecordingStream

MASK = np.ones((80, 100), dtype=bool)
MODES = ["nearest", "linear", "between"]


def swept(poses):
    """A sweep that is not aligned with the voxels: none of them lies on an image's rim to the last bit."""
    return recorded(poses, jitter=(0.05, 0.05), seed=3)


def items(recording, missing=()):
    for k, image in enumerate(recording.frames):
        poses = {
            (one.source, one.target): one.matrices[k] if one.valid[k] else None
            for one in recording.poses.values()
        }
        yield Item(recording.times[k], poses, None if k in missing else image)


def grown(recording, missing=(), **options):
    live = LiveVolume(probe_from_image(), **options)
    stream = RecordingStream()
    for item in items(recording, missing):
        live.add(item)
        stream.add(item)
    return live, sc.reconstruct(stream.recording(), probe_from_image(), **options)


def assert_equal(live, whole):
    volume = live.finish()
    np.testing.assert_array_equal(volume.grid.origin_mm, whole.grid.origin_mm)
    np.testing.assert_array_equal(volume.values, whole.values)
    for name in ("reference", "images", "left_out", "filled"):
        assert getattr(volume, name) == getattr(whole, name)
    if whole.coverage is not None:
        np.testing.assert_array_equal(volume.coverage, whole.coverage)


@pytest.mark.parametrize("compounding", ["mean", "maximum", "latest"])
@pytest.mark.parametrize("mode", MODES)
def test_it_is_the_volume_of_all_items(mode, compounding):
    if mode == "linear" and compounding != "mean":
        pytest.skip("linear is a mean")
    options = {
        "interpolation": mode,
        "compounding": compounding,
        "mask": MASK,
        "coverage": True,
        "spacing_mm": 0.7,
    }
    assert_equal(*grown(swept(path(20)), **options))
    assert_equal(*grown(swept(path(20)), bounds_mm=[[-5, 14, 62.3], [9, 24, 75]], **options))


def lost(recording, which):
    (name, one), valid = next(iter(recording.poses.items())), np.ones(len(recording), dtype=bool)
    valid[list(which)] = False
    return dataclasses.replace(recording, poses={name: dataclasses.replace(one, valid=valid)})


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(
    ("count", "which", "missing"),
    [(12, (3, 4, 9), ()), (12, (0,), (6,)), (1, (), ()), (2, (), ()), (3, (1,), ()), (12, (11,), (2, 3))],
)
def test_items_without_a_pose_or_an_image_are_left_out_as_ever(mode, count, which, missing):
    sweep = lost(swept(path(count, step_mm=1.5)), which)
    assert_equal(*grown(sweep, missing, interpolation=mode, mask=MASK, coverage=True))


@pytest.mark.parametrize("count", [8, 24])
def test_a_mask_is_found_from_the_first_images(count):
    live, whole = grown(swept(path(count)))
    assert len(live.slices()) == (3 if count == 24 else 0)
    assert_equal(live, whole)


def test_cuts_are_those_of_the_volume():
    for mode in MODES:
        live, _ = grown(swept(path(20)), interpolation=mode, mask=MASK)
        volume = live.volume()
        at = volume.grid.origin_mm + volume.grid.spacing_mm * (10, 12, 20)
        across, front, side = live.slices(at)
        np.testing.assert_array_equal(across.image, volume.values[20])
        np.testing.assert_array_equal(front.image, volume.values[::-1, 12])
        np.testing.assert_array_equal(side.image, volume.values[::-1, :, 10])
        assert [one.at_mm for one in (side, front, across)] == pytest.approx(at)
        assert live.slices(at + 500) == ()
        assert all(one.image.any() for one in live.slices())


def test_a_reference_that_is_seen_late_begins_anew():
    sweep = swept(path(12))
    probe = sweep.poses["tracker_from_probe"]
    valid = np.arange(12) >= 4
    moving = np.tile(np.eye(4), (12, 1, 1))
    moving[:, 0, 3] = np.arange(12)
    tied = Poses.of("Reference", "Tracker", np.where(valid[:, None, None], moving, np.nan))
    live, stream = LiveVolume(probe_from_image(), mask=MASK), RecordingStream()
    for k, item in enumerate(items(dataclasses.replace(sweep, poses={"a": probe, "b": tied}))):
        alone = {("Probe", "Tracker"): item.poses["Probe", "Tracker"]}
        for one in (live, stream):
            one.add(Item(item.time_s, alone, item.image) if k < 4 else item)
    whole = sc.reconstruct(stream.recording(), probe_from_image(), mask=MASK)
    assert whole.reference == "Reference"
    assert whole.images == 8
    assert_equal(live, whole)


def test_what_cannot_be_put_in_is_said_and_changes_nothing():
    live = LiveVolume(probe_from_image(), mask=MASK)
    with pytest.raises(InputError, match="live: no image was put in yet"):
        live.finish()
    sweep = list(items(swept(path(6))))
    assert not live.add(Item(0.0, {}, sweep[0].image))
    assert "Probe" in live.refusal
    assert live.slices() == ()
    for item in sweep[:4]:
        assert live.add(item)
    before = live.volume().values
    for image, kind, words in [
        (np.zeros((8, 9), np.uint8), InputError, "9 x 8 px, uint8, after"),
        (np.zeros((80, 100), np.uint16), InputError, "uint16"),
        (np.zeros((3, 80, 100), np.uint8), UnsupportedError, "2D images"),
        (np.zeros((80, 100), np.float32), UnsupportedError, "float32"),
    ]:
        with pytest.raises(kind, match=words):
            live.add(Item(0.0, sweep[0].poses, image))
    with pytest.raises(InputError, match=r"ProbeToTracker must have shape \(4, 4\)"):
        live.add(Item(0.0, {("Probe", "Tracker"): np.eye(3)}, sweep[0].image))
    assert not live.add(Item(0.0, {("Probe", "Tracker"): np.eye(4) * 2}, sweep[0].image))
    assert "not rigid" in live.refusal
    np.testing.assert_array_equal(live.volume().values, before)
    for wrong in ({"smooth": True, "noise_mm": 1.0}, {"error": True, "noise_mm": 1.0}):
        with pytest.raises(InputError, match="no smooth and no error"):
            LiveVolume(probe_from_image(), **wrong)
    with pytest.raises(InputError, match="mask must be"):
        LiveVolume(probe_from_image(), mask=~MASK)


def test_a_volume_that_grows_too_large_is_refused(monkeypatch):
    monkeypatch.setattr("sonocal.reconstruction.bricks.MOST_BYTES", 40 << 20)
    live = LiveVolume(probe_from_image(), mask=MASK, interpolation="nearest", spacing_mm=0.2)
    with pytest.raises(InputError, match="give bounds_mm of the part"):
        for item in items(swept(path(60, step_mm=3.0))):
            live.add(item)
    assert live.volume().images == live.images > 0
