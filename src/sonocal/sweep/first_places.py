"""A first calibration and a first place of a line, by the best-ranked candidates, and whether chance gave them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sonocal.calibration import Calibration, calibrate
from sonocal.detection import Detections
from sonocal.errors import DegenerateGeometryError, NoConsensusError, SonocalError
from sonocal.geometry.shown import brief
from sonocal.observations import Observations
from sonocal.observations.poses import carried, poses_of
from sonocal.recording import Recording, with_latency
from sonocal.sweep.agreeing import CLUTTER_FRAMES
from sonocal.sweep.options import PointsOptions, of_calibrate
from sonocal.sweep.placed import line_at, placed_rows, threshold_of
from sonocal.targets import Line, Unplaced

__all__ = ["FirstPlaces", "at_latency", "first_places"]

# Candidates of an image that take part in the first calibration.
RANKS = (1, 2)
CLOSE_MM = 2.0
"""Candidates nearer than this agree by chance far less often, if noise lets them be so near."""
LEAST_SHARE, LEAST_ROWS = 0.15, 20
"""Of the images, that must agree on a calibration and a place at once: in fewer chance may."""
FREE_ROWS = 7
"""A calibration and a place can be led through the points of any so many images."""
TWICE, MOST_SPREAD = 2.0, 0.6
"""Root mean square over the threshold: of points that are anywhere 0.7."""


@dataclass(frozen=True, eq=False)
class FirstPlaces:
    """What the best-ranked candidates say.

    Attributes:
        lines: every line, where it is known or was found.
        latency_s: that was found, too; None where none was asked for.
        calibration: of those candidates.
    """

    lines: tuple[Line, ...]
    latency_s: float | None
    calibration: Calibration

    __repr__ = brief


def first_places(
    recording: Recording, lines: Sequence[Line | Unplaced], detections: Detections, options: PointsOptions
) -> FirstPlaces:
    """The places of lines by the best-ranked candidates.

    Raises:
        NoConsensusError: no calibration and no place agree with enough images.
        DegenerateGeometryError: the motion does not tell the one from the other.
        InputError: no detection is in a frame with a valid pose.
    """
    tried: list[_First] = []
    refusal: SonocalError | None = None
    threshold_mm = threshold_of(options)
    for most in RANKS:
        rows = placed_rows(recording, lines, detections.select(detections.rank < most), options.posing)
        for within_mm in (min(CLOSE_MM, threshold_mm), threshold_mm):
            how = of_calibrate(options, targets=tuple(lines), threshold_mm=within_mm)
            try:
                tried.append(_First.of(calibrate(rows, **how), rows))
            except (NoConsensusError, DegenerateGeometryError) as error:
                refusal = refusal or error
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
    found = best.calibration
    places = tuple(line_at(one, found) for one in lines)
    return FirstPlaces(places, found.latency_s if options.latency else None, found)


@dataclass(frozen=True, eq=False)
class _First:
    """A first calibration, how many images agree with it, and how many would by chance."""

    calibration: Calibration
    images: int
    by_chance: float

    @classmethod
    def of(cls, found: Calibration, rows: Observations) -> _First:
        """Chance: how many agree when points of an image are taken for those of others.

        Nearly all that agree are within twice their root mean square; of points that are anywhere, few are.
        """
        within_mm = min(found.threshold_mm, TWICE * found.fit.rms_mm)
        images = len(np.unique(rows.frame[found.inlier & (found.residuals_mm < within_mm)]))
        poses = poses_of(rows)
        assert poses is not None
        (target,) = found.targets.values()
        lines = carried(poses, np.broadcast_to(target.spanning_mm, (len(poses), 2, 3)))
        points = found.probe_from_image @ rows.points_px
        along = lines[:, 1] - lines[:, 0]
        along = along / np.linalg.norm(along, axis=1, keepdims=True)
        away = points[None] - lines[:, :1]
        away -= np.einsum("ijk,ik->ij", away, along)[:, :, None] * along[:, None]
        other = rows.frame[:, None] != rows.frame[None]
        share = float(np.mean(np.linalg.norm(away, axis=2)[other] < within_mm)) if other.any() else 1.0
        return cls(found, images, share * len(rows))

    @property
    def beyond_chance(self) -> float:
        return self.images - self.by_chance

    def may_be_chance(self, images: int) -> bool:
        """Whether as many would agree with some calibration and some place had images and poses nothing in common.

        Neighbouring images that show the same clutter count once.

        Source: a-contrario model estimation (Moisan and Stival 2004).
        """
        from scipy.special import bdtrc, gammaln

        spread = self.calibration.fit.rms_mm / self.calibration.threshold_mm
        if spread > MOST_SPREAD or self.images < max(LEAST_SHARE * images, min(LEAST_ROWS, 0.8 * images)):
            return True
        combinations = gammaln(images + 1) - gammaln(images - FREE_ROWS + 1) - gammaln(FREE_ROWS + 1)
        chance = min(self.by_chance / images, 1.0)
        tail = max(bdtrc(self.images - FREE_ROWS - 1, images - FREE_ROWS, chance), np.finfo(float).tiny)
        return bool(combinations + np.log(tail) / CLUTTER_FRAMES > 0)


def at_latency(recording: Recording, first: FirstPlaces, options: PointsOptions) -> Recording:
    """The recording with its poses where the first calibration's lag leads."""
    if first.latency_s is None:
        return recording
    return with_latency(recording, first.latency_s, on_invalid=options.on_invalid)
