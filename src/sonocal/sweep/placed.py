"""A recording of a thread, or of a needle, whose place nobody knows: it is found with the calibration.

The best-ranked candidates give a first calibration and a first place. With that the thread is a line like any other:
candidates are chosen by it, and fainter ones looked for. What was chosen is calibrated once more, its place unknown.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sonocal.calibration import Calibration, calibrate, placed_by
from sonocal.detection import Detections
from sonocal.errors import (
    DegenerateGeometryError,
    NoConsensusError,
    SonocalError,
    UnsupportedError,
)
from sonocal.geometry import Array
from sonocal.geometry.shown import brief
from sonocal.observations import Observations
from sonocal.observations.poses import carried, pose_cells, poses_of, with_poses
from sonocal.recording import Recording, with_latency
from sonocal.sweep.choice import CLUTTER_FRAMES
from sonocal.sweep.mixed import named_targets, require_posed
from sonocal.sweep.options import PointsOptions, of_calibrate
from sonocal.sweep.tabulate import Posing, check_places
from sonocal.targets import Line, Target, Unplaced, check_lines

__all__ = [
    "FirstPlaces",
    "at_latency",
    "first_places",
    "line_at",
    "placed_rows",
    "require_findable",
    "with_own_places",
]

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


def require_findable(lines: Sequence[Line | Unplaced]) -> None:
    """Refuse targets that are not looked for in images, or cannot be told apart there.

    Raises:
        UnsupportedError: one is a point or a plane, or there are several lines.
    """
    for one in lines:
        if isinstance(one, Unplaced) and one.kind != "line":
            raise UnsupportedError(
                f"{one.kind} {one.name!r}: its place is unknown, and in images lines alone are looked for; give its "
                "points with --points (in Python: calibrate_points)"
            )
    if len(lines) > 1:
        raise UnsupportedError(
            f"the places of some of {len(lines)} lines are unknown, and in images they cannot be told apart; scan one "
            "at a time, or give their points with --points"
        )


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
    threshold_mm = _number(options)
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


def line_at(line: Line | Unplaced, found: Calibration) -> Line:
    """A line where a calibration found it."""
    if isinstance(line, Line):
        return line
    return Line(line.name, line.frame, np.array(found.targets[line.name].spanning_mm))


def placed_rows(
    recording: Recording, targets: Sequence[Target | Unplaced], detections: Detections, posing: Posing
) -> Observations:
    """Points against targets, of those whose place is asked for with the pose of their frame.

    Raises:
        InputError: a point names no target or no frame, nothing connects a target to the probe, or nothing is left.
    """
    check_lines(recording.name, targets, "targets")
    check_places(recording, detections)
    which = named_targets(targets, detections)
    poses = np.stack(
        [
            recording.between(posing.probe, one.frame, posing.fixed, posing.on_invalid).matrices
            for one in targets
        ]
    )[which, detections.frame]
    posed = np.asarray(np.isfinite(poses).all(axis=(1, 2)))
    if len(recording.frames):
        posed &= recording.image_valid[detections.frame]
    require_posed(recording, detections, posed)
    each = detections.points_each
    poses, which, frame = poses[posed], which[posed], detections.frame[posed]
    spanning: Array = np.full((len(which), 3, 3), np.nan)
    for i, one in enumerate(targets):
        if not isinstance(one, Unplaced):
            mine = which == i
            points = one.spanning_mm @ np.swapaxes(poses[mine, :3, :3], 1, 2) + poses[mine, None, :3, 3]
            spanning[mine, : points.shape[1]] = points
            poses[mine] = np.nan
    return _table(recording, targets, detections, (posed, which, frame, spanning, poses, each))


def _table(
    recording: Recording,
    targets: Sequence[Target | Unplaced],
    detections: Detections,
    rows: tuple[NDArray[np.bool_], NDArray[np.int64], NDArray[np.int64], Array, Array, int],
) -> Observations:
    posed, which, frame, spanning, poses, each = rows
    names = np.array([one.name for one in targets])[which]
    rank = detections.rank[posed].astype(np.str_) if each > 1 else np.full(len(which), "")
    extra = pose_cells(np.repeat(poses[:, :3], each, axis=0))
    if np.isfinite(recording.times).all():
        extra["time_s"] = np.repeat(recording.times[frame], each).astype(np.str_)
    return Observations.of_targets(
        detections.points_px[posed].reshape(-1, detections.dimension),
        np.repeat(spanning, each, axis=0),
        frame=np.repeat(frame, each),
        target=np.repeat(names, each),
        split=np.repeat(rank, each),
        extra=extra,
        image_size_px=None if recording.image is None else recording.image.size_px,
        source=detections.source,
    )


def with_own_places(
    chosen: Observations, recording: Recording, lines: Sequence[Line | Unplaced], options: PointsOptions
) -> tuple[Calibration, Observations]:
    """What was chosen, calibrated with places unknown again.

    Args:
        chosen: rows of the lines as they were found first.
        recording: with its poses as they are stamped.
        lines: as they were given.
        options: how to calibrate.

    Returns:
        The calibration, and the rows with their lines where it found them.
    """
    asked = {one.name: one for one in lines if isinstance(one, Unplaced)}
    mine = np.isin(chosen.target, list(asked))
    spanning = np.concatenate([chosen.segments_mm, np.full((len(chosen), 1, 3), np.nan)], axis=1)
    spanning[mine] = np.nan
    poses = np.full((len(chosen), 3, 4), np.nan)
    for name, one in asked.items():
        here = chosen.target == name
        known = recording.between(options.probe, one.frame, options.fixed, options.on_invalid).matrices
        poses[here] = known[chosen.frame[here], :3]
    kept = np.isfinite(spanning[:, 0, 0]) | np.isfinite(poses[:, 0, 0])
    columns = {"spanning_mm": spanning, "segments_mm": spanning[:, :2], "split": np.full(len(chosen), "")}
    rows = with_poses(chosen.with_sound(**columns), poses).select(kept)
    found = calibrate(rows, **of_calibrate(options, targets=tuple(lines), threshold_mm=_number(options)))
    return found, placed_by(found, rows)


def at_latency(recording: Recording, first: FirstPlaces, options: PointsOptions) -> Recording:
    """The recording with its poses where the first calibration's lag leads."""
    if first.latency_s is None:
        return recording
    return with_latency(recording, first.latency_s, on_invalid=options.on_invalid)


def _number(options: PointsOptions) -> float:
    return 5.0 if options.threshold_mm == "auto" else float(options.threshold_mm)
