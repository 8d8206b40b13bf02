"""Recorded scans whose motion cannot give the place of their targets: refused, with the motion that is missing."""

import numpy as np
import pytest

import sonocal as sc
from sonocal.registration.unplaced import UnplacedTarget, register_unplaced


def phantom_poses(rows):
    """(N, 4, 4): of a phantom in the probe marker's frame, from its wires: where it was in the first image is home."""
    home = {
        name: rows.segments_mm[rows.frame == rows.frame[0]][i]
        for i, name in enumerate(rows.target[rows.frame == rows.frame[0]])
    }
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    for frame in np.unique(rows.frame):
        mine = np.flatnonzero(rows.frame == frame)
        there, here = (
            np.concatenate([one[i] for i in mine])
            for one in (rows.segments_mm, {i: home[rows.target[i]] for i in mine})
        )
        u, _, vt = np.linalg.svd((there - there.mean(0)).T @ (here - here.mean(0)))
        turn = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
        poses[mine, :3, :3], poses[mine, :3, 3] = turn, there.mean(0) - turn @ here.mean(0)
        assert np.abs(here @ turn.T + poses[mine[0], :3, 3] - there).max() < 1e-3
    return poses


@pytest.mark.parametrize("name", ["fcal12_ascension", "depth15_polaris"])
@pytest.mark.parametrize("wires", [1, 3, 9])
def test_wires_scanned_without_tilts_are_refused(data_folder, name, wires):
    table = sc.read_observations(data_folder / "observations" / f"{name}.csv").select_split("calibration")
    poses, names = phantom_poses(table), np.unique(table.target)[:wires].tolist()
    chosen = np.isin(table.target, names)
    with pytest.raises(sc.DegenerateGeometryError, match="the probe hardly turned") as refused:
        register_unplaced(
            table.points_px[chosen],
            poses[chosen],
            [UnplacedTarget("line")] * wires,
            target=np.array([names.index(one) for one in table.target[chosen]]),
            frame=table.frame[chosen],
        )
    assert refused.value.code == "unplaced-translation"


def test_a_tanks_floor_seen_from_above_alone_is_refused(data_folder):
    """A probe moved up and down over it: the floor is the brightest row of its columns."""
    folder = data_folder / "recordings"
    video = sc.read_recording(folder / "WaterTankBottomTranslationVideoBuffer.igs.mha")
    tracked = sc.read_recording(folder / "WaterTankBottomTranslationTrackerBuffer-trimmed.igs.mha")
    pose = tracked.poses["tracker_from_probe"].matrices
    points, poses, frame = [], [], []
    for i in range(0, len(video), 4):
        at = int(np.argmin(np.abs(tracked.times - video.times[i])))
        image = np.asarray(video.frames[i], dtype=float)
        for column in (300, 500):
            band = image[150:560, column - 10 : column + 11].mean(axis=1)
            points.append([column, 150 + int(np.argmax(band))])
            poses.append(np.linalg.inv(pose[at]))
            frame.append(i)
    poses = np.array(poses)
    usable = np.isfinite(poses).all(axis=(1, 2))
    with pytest.raises(sc.DegenerateGeometryError, match="the probe hardly turned"):
        register_unplaced(
            np.array(points, dtype=float)[usable],
            poses[usable],
            [UnplacedTarget("plane")],
            frame=np.array(frame)[usable],
        )
