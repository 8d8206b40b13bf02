"""What was chosen against targets where they were found first, calibrated with their places unknown again."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sonocal.calibration import Calibration, calibrate, placed_by
from sonocal.geometry import Array
from sonocal.observations import Observations
from sonocal.observations.poses import with_poses
from sonocal.observations.spanning import segments_of
from sonocal.recording import Recording
from sonocal.sweep.options import PointsOptions, of_calibrate
from sonocal.targets import Target, Unplaced
from sonocal.targets.unplaced import target_of

__all__ = ["placed_at", "target_at", "threshold_of", "with_own_places"]


def target_at(target: Target | Unplaced, found: Calibration) -> Target:
    """A target where a calibration found it."""
    if not isinstance(target, Unplaced):
        return target
    return placed_at(target, np.array(found.targets[target.name].spanning_mm))


def placed_at(target: Unplaced, spanning_mm: Array) -> Target:
    """A target in a place of its frame, spanned by points (K, 3)."""
    return target_of(target.kind, target.name, target.frame, spanning_mm)


def threshold_of(options: PointsOptions) -> float:
    """The distance, mm, within which rows agree; where the noise would tell it, the most."""
    return 5.0 if options.threshold_mm == "auto" else float(options.threshold_mm)


def with_own_places(
    chosen: Observations, recording: Recording, targets: Sequence[Target | Unplaced], options: PointsOptions
) -> tuple[Calibration, Observations]:
    """What was chosen, calibrated with places unknown again.

    Args:
        chosen: rows of the targets as they were found first.
        recording: with its poses as they are stamped.
        targets: as they were given.
        options: how to calibrate.

    Returns:
        The calibration, and the rows with their targets where it found them.
    """
    asked = {one.name: one for one in targets if isinstance(one, Unplaced)}
    spanning = _spanning(chosen)
    spanning[np.isin(chosen.target, list(asked))] = np.nan
    poses = np.full((len(chosen), 3, 4), np.nan)
    for name, one in asked.items():
        here = chosen.target == name
        known = recording.between(options.probe, one.frame, options.fixed, options.on_invalid).matrices
        poses[here] = known[chosen.frame[here], :3]
    kept = np.isfinite(spanning[:, 0, 0]) | np.isfinite(poses[:, 0, 0])
    columns = {
        "spanning_mm": spanning,
        "segments_mm": segments_of(spanning),
        "split": np.full(len(chosen), ""),
    }
    rows = with_poses(chosen.with_sound(**columns), poses).select(kept)
    found = calibrate(
        rows, **of_calibrate(options, targets=tuple(targets), threshold_mm=threshold_of(options))
    )
    return found, placed_by(found, rows)


def _spanning(rows: Observations) -> Array:
    """(N, 3, 3): what spans the target of each row; NaN where it is spanned by fewer points."""
    if rows.spanning_mm is not None:
        return np.array(rows.spanning_mm)
    return np.concatenate([rows.segments_mm, np.full((len(rows), 1, 3), np.nan)], axis=1)
