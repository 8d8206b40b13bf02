from dataclasses import replace

import numpy as np
import pytest

from sonocal import InputError
from sonocal.recording import (
    ArrayFrames,
    Poses,
    health,
    summarize,
)
from sonocal.recording.formats import read_recording
from tests.builders.recordings import (
    random_poses,
    random_recording,
)


def healthy(n=40):
    rng = np.random.default_rng(0)
    recording = random_recording(0, n=n, tools=())
    poses = Poses.of("Probe", "Tracker", random_poses(rng, n))
    return replace(recording, times=np.arange(n) * 0.05, poses={poses.name: poses})


def codes(recording):
    return {d.code for d in health(recording)}


def with_poses(recording, matrices=None, valid=None):
    old = recording.poses["tracker_from_probe"]
    new = Poses(
        "Probe",
        "Tracker",
        old.matrices if matrices is None else matrices,
        old.valid if valid is None else valid,
    )
    return replace(recording, poses={new.name: new})


def test_a_healthy_recording_has_no_findings():
    assert codes(healthy()) == set()


def test_every_fault_is_found():
    good = healthy()
    matrices, times = good.poses["tracker_from_probe"].matrices, good.times
    far = matrices + np.pad(np.full((1, 1), 500.0), ((0, 3), (3, 0)))
    pixels = np.stack(list(good.frames))
    faults = {
        "stamps-out-of-order": replace(good, times=np.r_[times[:10], times[12], times[11], times[12:]]),
        "stamps-repeated": replace(good, times=np.r_[times[:10], times[9], times[11:]]),
        "gaps": replace(good, times=times + np.where(np.arange(40) > 20, 1.0, 0)),
        "no-times": replace(good, times=np.full(40, np.nan)),
        "invalid-poses": with_poses(good, valid=np.arange(40) > 10),
        "non-rigid-poses": with_poses(
            good, matrices=np.where(np.arange(40)[:, None, None] == 7, 1.1 * matrices, matrices)
        ),
        "static-tool": with_poses(good, matrices=np.repeat(matrices[:1], 40, axis=0)),
        "frozen-poses": with_poses(good, matrices=matrices[np.minimum(np.arange(40), 20)]),
        "duplicated-images": replace(good, frames=ArrayFrames(pixels[[*range(39), 38]])),
        "identity-poses": with_poses(
            good, matrices=np.where((np.arange(40) % 9 == 4)[:, None, None], np.eye(4), far)
        ),
        "frozen-images": replace(good, frames=ArrayFrames(pixels[np.minimum(np.arange(40), 20)])),
        "invalid-images": replace(good, image_valid=np.arange(40) != 3),
    }
    for code, recording in faults.items():
        assert code in codes(recording), code


def test_findings_say_where_and_what_to_do():
    recording = with_poses(healthy(), valid=~np.isin(np.arange(40), [3, 4, 5, 20]))
    (found,) = health(recording)
    assert found.message == "ProbeToTracker: 4 of 40 poses are invalid (10 %), 3 in a row at most"
    assert found.advice == "such frames are left out; keep the marker in the tracker's view"


@pytest.mark.parametrize(
    ("step_s", "sentence"),
    [
        (np.inf, "39 of 40 frames have the stamp of the frame before them: the clock stands"),
        (1.0, "36 of 40 frames have the stamp of the frame before them: the clock goes on by 1 s at a time"),
    ],
)
def test_a_clock_that_stands_or_is_coarse_is_no_copy_of_frames(step_s, sentence):
    times = np.arange(40) / 10
    coarse = np.zeros(40) if np.isinf(step_s) else np.floor(times / step_s) * step_s
    (found,) = (one for one in health(replace(healthy(), times=coarse)) if one.code == "stamps-repeated")
    assert found.message == sentence
    assert found.advice.startswith("stamp each frame with a time of its own")


def test_non_rigid_poses_are_refused_or_skipped():
    good = healthy()
    matrices = good.poses["tracker_from_probe"].matrices.copy()
    matrices[7, :3, :3] *= 0.976
    recording = with_poses(good, matrices=matrices)
    with pytest.raises(InputError) as caught:
        recording.between("Tracker", "Probe")
    assert str(caught.value) == (
        "recording, frame 7: ProbeToTracker is not rigid (det R = 0.93); drop such frames with --on-invalid skip"
    )
    skipped = recording.between("Tracker", "Probe", on_invalid="skip")
    assert np.flatnonzero(~skipped.valid).tolist() == [7]


def test_summary_of_a_real_recording(data_folder):
    summary = summarize(read_recording(data_folder / "recordings" / "fCal_Test_Calibration_3NWires.igs.mha"))
    assert (summary.items, summary.image.size_px, summary.format) == (
        188,
        (820, 616),
        "PLUS sequence metafile",
    )
    assert summary.rate_hz == pytest.approx(12.6, abs=0.05)
    assert [(t.name, t.valid) for t in summary.tools] == [
        ("ProbeToTracker", 188),
        ("ReferenceToTracker", 188),
        ("StylusToTracker", 188),
    ]
    assert [d.code for d in summary.diagnostics] == ["static-tool"]


def test_frames_cancel_along_a_chain():
    """a_from_b @ b_from_c is a_from_c, whichever way the file keeps them."""
    recording = random_recording(2, n=6)
    probe, needle = (recording.poses[f"tracker_from_{tool}"] for tool in ("probe", "needle"))
    found = recording.between("Probe", "Needle")
    np.testing.assert_array_equal(found.valid, probe.valid & needle.valid)
    rows = found.valid
    np.testing.assert_allclose(probe.matrices[rows] @ found.matrices[rows], needle.matrices[rows], atol=1e-10)
    with pytest.raises(InputError) as caught:
        recording.between("Probe", "Stylus")
    assert str(caught.value) == (
        "recording: nothing connects Stylus to Probe; the transforms are ProbeToTracker, NeedleToTracker"
    )


def test_a_recording_relative_to_its_first_pose_may_begin_with_the_identity():
    good = healthy()
    matrices = good.poses["tracker_from_probe"].matrices
    near = matrices.copy()
    near[:, :3, 3] = np.linspace(0, 400, len(near))[:, None] * [1, 0, 0]
    near[0] = np.eye(4)
    assert codes(with_poses(good, matrices=near)) == set()
