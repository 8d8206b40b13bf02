"""Tables of a probe that a hand led over a thread, a cross or a floor that nobody placed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import sonocal as sc
from sonocal.recording import Poses
from sonocal.targets import Unplaced


def unplaced_table(scene, name="thread", **columns):
    """Rows of a scene of `benchmarks.simulators`, with poses, and no place of the target."""
    rows = len(scene.frame)
    posed = {
        f"probe_from_target_{row}{column}": scene.poses[:, row, column].astype(np.str_)
        for row in range(3)
        for column in range(4)
    }
    return sc.Observations.of_targets(
        scene.points_px[:, : scene.dimension],
        np.full((rows, 3, 3), np.nan),
        frame=scene.frame,
        target=np.full(rows, name),
        extra=posed | columns.pop("extra", {}),
        **columns,
    )


def placed_table(scene, name="cross"):
    """Rows of a scene whose target's place is known, in the probe marker's frame."""
    rows = len(scene.frame)
    spanning = np.full((rows, 3, 3), np.nan)
    there = scene.place @ np.swapaxes(scene.poses[:, :3, :3], 1, 2) + scene.poses[:, None, :3, 3]
    spanning[:, : len(scene.place)] = there
    return sc.Observations.of_targets(
        scene.points_px[:, : scene.dimension], spanning, frame=scene.frame, target=np.full(rows, name)
    )


def both(unplaced, placed):
    """One table of rows without and of rows with places, each image of one of the two."""
    parts = (unplaced, placed)
    spanning = [
        part.spanning_mm
        if part.spanning_mm is not None
        else np.concatenate([part.segments_mm, np.full((len(part), 1, 3), np.nan)], axis=1)
        for part in parts
    ]
    poses = np.array(
        [[float(x) for x in cells] for cells in zip(*list(unplaced.extra.values())[:12], strict=True)]
    )
    nothing = np.full((len(placed), 12), np.nan)
    names = list(unplaced.extra)[:12]
    text = np.where(np.isfinite(whole := np.vstack([poses, nothing])), whole.astype(np.str_), "")
    return sc.Observations.of_targets(
        np.vstack([part.points_px for part in parts]),
        np.vstack(spanning),
        frame=np.concatenate([unplaced.frame, placed.frame + unplaced.frame.max() + 1]),
        target=np.concatenate([part.target for part in parts]),
        extra=dict(zip(names, text.T, strict=True)),
    )


def unknown(kind, name="thread", frame="Tracker"):
    return Unplaced(kind, name, frame)


def resting_in_room(recording):
    """The same images of something that rests in the room: what was the needle's frame is the tracker's."""
    probe, needle = (recording.poses[f"tracker_from_{name}"].matrices for name in ("probe", "needle"))
    poses = Poses.of("Probe", "Tracker", np.linalg.inv(needle) @ probe)
    return replace(recording, poses={poses.name: poses})


__all__ = ["both", "placed_table", "resting_in_room", "unknown", "unplaced_table"]
