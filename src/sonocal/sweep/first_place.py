"""A first calibration and a first place of one target, by the best-ranked candidates, and whether chance gave them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sonocal.calibration import Calibration, calibrate
from sonocal.detection import Detections
from sonocal.errors import DegenerateGeometryError, NoConsensusError, SonocalError
from sonocal.geometry import Array
from sonocal.geometry.shown import brief
from sonocal.observations import Observations
from sonocal.observations.poses import carried, poses_of
from sonocal.recording import Recording
from sonocal.sweep.agreeing import ENOUGH
from sonocal.sweep.chance import away_mm, may_be_chance
from sonocal.sweep.options import PointsOptions, of_calibrate
from sonocal.sweep.own_places import threshold_of
from sonocal.sweep.placed import placed_rows
from sonocal.targets import Unplaced

__all__ = ["FirstPlace", "first_place"]

# Candidates of an image that take part.
RANKS = (1, 2)
CLOSE_MM = 2.0
"""Candidates nearer than this agree by chance far less often, if noise lets them be so near."""
FREE = {"point": 5, "line": 7, "plane": 6}
"""A calibration and a place can be led through what any so many images show."""
TWICE = 2.0
MOST_SPREAD = {"point": 0.66, "line": 0.6, "plane": 0.5}
"""Root mean square over the threshold: of what is anywhere within it 0.77, 0.71 and 0.58."""


@dataclass(frozen=True, eq=False)
class FirstPlace:
    """A first calibration, how many images agree with it, and how many would by chance.

    Attributes:
        target: whose place it found.
        calibration: with that place.
        images, by_chance: that agree; and when points of an image are taken for those of others.
    """

    target: Unplaced
    calibration: Calibration
    images: int
    by_chance: float

    __repr__ = brief

    @property
    def beyond_chance(self) -> float:
        """What the best of several has most of."""
        return self.images - self.by_chance

    def is_enough(self, images: int) -> bool:
        """Whether further candidates of so many images would hardly tell more."""
        return self.images >= ENOUGH * images and not self.may_be_chance(images)

    def may_be_chance(self, images: int) -> bool:
        """Whether as many of so many images would agree had they and the poses nothing in common."""
        kind, found = self.target.kind, self.calibration
        spread = found.fit.rms_mm / found.threshold_mm
        return spread > MOST_SPREAD[kind] or may_be_chance(self.images, images, self.by_chance, FREE[kind])


def first_place(
    recording: Recording, target: Unplaced, detections: Detections, options: PointsOptions
) -> FirstPlace:
    """What the best-ranked candidates say of a target of whose kind they are.

    Raises:
        NoConsensusError: no calibration and no place agree with enough images.
        DegenerateGeometryError: the motion does not tell the one from the other.
        InputError: no detection is in a frame with a valid pose.
    """
    tried: list[FirstPlace] = []
    refusal: SonocalError | None = None
    threshold_mm = threshold_of(options)
    for most in RANKS:
        rows = placed_rows(recording, [target], detections.select(detections.rank < most), options.posing)
        for within_mm in (min(CLOSE_MM, threshold_mm), threshold_mm):
            how = of_calibrate(options, targets=(target,), threshold_mm=within_mm)
            try:
                tried.append(_judged(target, calibrate(rows, **how), rows, detections.points_each))
            except (NoConsensusError, DegenerateGeometryError) as error:
                refusal = refusal or error
        if any(one.is_enough(detections.images) for one in tried):
            break
    best = max(tried, key=lambda one: one.beyond_chance, default=None)
    if best is None:
        assert refusal is not None
        raise refusal
    if best.may_be_chance(detections.images):
        raise NoConsensusError(
            f"{recording.name}: no calibration and no place of the target agree with more than {best.images} of "
            f"{detections.images} images, and so few may agree by chance; check in the contact sheet that it is "
            "visible and marked, and scan it where little else is bright",
            best_count=best.images,
        )
    return best


def _judged(target: Unplaced, found: Calibration, rows: Observations, each: int) -> FirstPlace:
    """Chance: how many agree when points of an image are taken for those of others.

    Nearly all that agree are within twice their root mean square; of points that are anywhere, few are.
    """
    within_mm = min(found.threshold_mm, TWICE * found.fit.rms_mm)
    frame = rows.frame[::each]
    near = (found.inlier & (found.residuals_mm < within_mm)).reshape(-1, each).all(axis=1)
    away = _from_other_images(found, rows, each)
    other = frame[:, None] != frame[None]
    share = float(np.mean(away[other] < within_mm)) if other.any() else 1.0
    return FirstPlace(target, found, len(np.unique(frame[near])), share * len(frame))


def _from_other_images(found: Calibration, rows: Observations, each: int) -> Array:
    """(M, M): how far each candidate's furthest point would be from the target where each other one's frame was."""
    poses = poses_of(rows)
    assert poses is not None
    (target,) = found.targets.values()
    poses = poses[::each]
    spanning = carried(
        poses, np.broadcast_to(target.spanning_mm, (len(poses), *np.shape(target.spanning_mm)))
    )
    points = (found.probe_from_image @ rows.points_px).reshape(-1, each, 3)
    return np.asarray(np.max([away_mm(points[None, :, i], spanning[:, None]) for i in range(each)], axis=0))
