"""From candidate points to a calibration: the geometry chooses, at most one candidate an image and needle.

A wrong candidate agrees with no calibration that many images share. So calibrate on the best-ranked candidates, see
which candidate of each image lies near its needle, and calibrate again on those: consensus over candidates.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sonocal.calibration import Calibration, calibrate
from sonocal.errors import DegenerateGeometryError, InputError, NoConsensusError
from sonocal.findings import Diagnostic
from sonocal.geometry import Array, AxisScaled, homogeneous_points
from sonocal.observations import Observations, group_codes, stacked
from sonocal.registration.noise import residual_vectors

__all__ = [
    "CandidateCalibration",
    "calibrate_candidates",
]

ROUNDS = 10
RANKS = (1, 2, 3, 5, 1000)
ENOUGH = 0.5
"""Share of the images that agree, from which no further ranks are tried."""
CHANCE_FACTOR = 3.0
LEAST_SIGHTINGS = 10
LEAST_SHARE_OF_FEW = 0.8
"""Where there are few images."""
LEAST_SHARE = 0.15
LEAST_SHARE_OF_MANY = 0.5
"""With several needles or wires: a wrong calibration that takes one for another agrees with a part of them."""
TIGHTNESS = {2: 4.0, 3: 5.0}
"""Standard deviations of the residuals within which a candidate is the needle, once a calibration is known.

Those of all rows: where a needle is seen near its end, tracking noise is up to 1.4 times what it is on average. Few
lines of a volume have both ends near the needle by chance, so that there is no need to lose any of its own."""

LookAgain = Callable[[AxisScaled, Observations, float], Sequence[Observations]]
"""A calibration, the candidates near their needles, a distance in mm: to candidates near the other needles."""


@dataclass(frozen=True, eq=False)
class CandidateCalibration:
    """A calibration and what became of every candidate.

    Attributes:
        calibration: fitted to the chosen rows.
        observations: the chosen rows, one a sighting in 2D; `calibration.inlier` belongs to them.
        chosen: (N,) of the candidates given: which row was chosen (before the second look).
        sightings: images and needles looked at.
        used: sightings that took part.
        reasons: sightings that did not, counted by why.
    """

    calibration: Calibration
    observations: Observations
    chosen: NDArray[np.bool_]
    sightings: int
    used: int
    reasons: dict[str, int]


def calibrate_candidates(
    candidates: Observations,
    *,
    sightings: int | None = None,
    look_again: LookAgain | None = None,
    threshold_mm: float = 5.0,
    seed: int = 0,
    **options: Any,
) -> CandidateCalibration:
    """Calibrate from several candidates a sighting, of which at most one is right.

    Args:
        candidates: one row a candidate, best first within a frame and target; in 3D two or more rows a line
            candidate, with the candidate's number as `split`.
        sightings: images and needles looked at, where some had no candidate at all.
        look_again: finds further candidates, once a calibration says where needles must be: given it, the
            candidates within a distance of their needles, and that distance in mm.
        threshold_mm: candidates further than this from their needle are wrong.
        seed: of the random samples.
        options: of `sonocal.calibrate`.

    Returns:
        The calibration and the share of images that it rests on.

    Raises:
        NoConsensusError: no calibration explains more images than chance would.
        DegenerateGeometryError: the sightings leave a motion free.
        InputError: there are too few candidates.
    """
    table = _Table(candidates)
    total = max(sightings or 0, table.count)
    start = _first_consensus(table, total, threshold_mm, seed, options)
    calibration, chosen = _settle(table, start, threshold_mm, seed, options)
    first = chosen
    if look_again is not None:
        near = table.nearest(calibration.probe_from_image, threshold_mm)
        further = look_again(calibration.probe_from_image, candidates_at(table.rows, near), threshold_mm)
        table = _Table(stacked([table.rows, *further]))
        calibration, chosen = _settle(table, calibration, threshold_mm, seed, options)
    observations = candidates_at(table.rows, chosen)
    used = len(np.unique(group_codes(observations.frame, observations.target)))
    if used < _least_agreeing(table, total):  # of a few images most agree by chance, until one looks closer
        raise _nothing_found(table, total, used)
    reasons = {
        "no candidate or no pose": total - table.count,
        "no candidate near the needle": table.count - used,
    }
    found = _report(used, total, reasons)
    calibration = replace(calibration, diagnostics=(*calibration.diagnostics, found))
    return CandidateCalibration(calibration, observations, first, total, used, reasons)


def candidates_at(rows: Observations, chosen: NDArray[np.bool_]) -> Observations:
    """The chosen rows."""
    return rows.select(np.flatnonzero(chosen))


class _Table:
    """Candidates grouped: rows of one candidate, candidates of one sighting."""

    def __init__(self, rows: Observations) -> None:
        self.rows = rows
        self.points = homogeneous_points(rows.points_px)
        self.sighting = group_codes(rows.frame, rows.target)
        self.count = int(self.sighting.max()) + 1 if len(rows) else 0
        if rows.dimension == 3:
            self.candidate = rows.sightings
            self.rank = np.array([int(name or 0) for name in rows.split], dtype=np.int64)
        else:
            self.candidate = np.arange(len(rows))
            self.rank = _ranks(self.sighting)
        # One candidate may be tried against several needles: each of its trials has the same place in the image.
        self.owner, self.place = (
            np.zeros(int(self.candidate.max(initial=-1)) + 1, dtype=np.int64) for _ in "12"
        )
        self.owner[self.candidate] = self.sighting
        self.place[self.candidate] = group_codes(rows.frame, *rows.points_px.T)

    def nearest(self, transform: AxisScaled, threshold_mm: float) -> NDArray[np.bool_]:
        """(N,) rows of the nearest candidate of each sighting, where all of its points are within the threshold.

        A candidate that is nearest to several needles is that of the nearest one.
        """
        distance = _distances(transform, self.points, self.rows.segments_mm)
        worst = np.zeros(len(self.owner))
        np.maximum.at(worst, self.candidate, distance)
        least = np.full(self.count, np.inf)
        np.minimum.at(least, self.owner, worst)
        best = np.flatnonzero((worst == least[self.owner]) & (worst <= threshold_mm))
        best = best[np.argsort(worst[best], kind="stable")]
        best = best[np.unique(self.place[best], return_index=True)[1]]
        return np.isin(self.candidate, best)

    def agreeing(self, chosen: NDArray[np.bool_]) -> int:
        """How many sightings the chosen rows belong to."""
        return len(np.unique(self.sighting[chosen]))


def _first_consensus(
    table: _Table, total: int, threshold_mm: float, seed: int, options: dict[str, Any]
) -> Calibration:
    """The calibration that most sightings agree with, tried on ever lower ranks."""
    best: tuple[int, Calibration] | None = None
    refusal: Exception | None = None
    for most in RANKS:
        keep = table.rank < most
        try:
            found = calibrate(
                candidates_at(table.rows, keep), threshold_mm=threshold_mm, seed=seed, **options
            )
        except (NoConsensusError, DegenerateGeometryError, InputError) as error:
            refusal = refusal or error
            continue
        count = table.agreeing(table.nearest(found.probe_from_image, threshold_mm))
        if best is None or count > best[0]:
            best = count, found
        if count >= ENOUGH * total or keep.all():
            break
    if best is None:
        raise (
            _nothing_found(table, total, 0)
            if isinstance(refusal, NoConsensusError)
            else refusal or _nothing_found(table, total, 0)
        )
    chance = CHANCE_FACTOR * _by_chance(table, best[1], threshold_mm)
    if best[0] < max(_least_agreeing(table, total), chance):
        raise _nothing_found(table, total, best[0])
    return best[1]


def _least_agreeing(table: _Table, total: int) -> float:
    """Sightings without which a calibration is no answer."""
    share = LEAST_SHARE if len(np.unique(table.rows.target)) == 1 else LEAST_SHARE_OF_MANY
    return max(min(LEAST_SIGHTINGS, LEAST_SHARE_OF_FEW * total), share * total)


def _by_chance(table: _Table, calibration: Calibration, threshold_mm: float) -> float:
    """Sightings that would agree if their candidates lay anywhere in the box that holds all of them."""
    points = table.rows.points_px
    area = np.prod(np.ptp(points, axis=0)[:2] * calibration.probe_from_image.scales[:2])
    one = min(1.0, np.pi * threshold_mm**2 / max(float(area), 1e-9))
    if table.rows.dimension == 3:  # both ends of a line must agree
        one *= one
    candidates = np.bincount(table.owner, minlength=table.count)
    return float(np.sum(1 - (1 - one) ** candidates))


def _settle(
    table: _Table, calibration: Calibration, threshold_mm: float, seed: int, options: dict[str, Any]
) -> tuple[Calibration, NDArray[np.bool_]]:
    """Choose the nearest candidates and calibrate on them, with an ever fitter threshold, until nothing changes."""
    chosen = table.nearest(calibration.probe_from_image, threshold_mm)
    for _ in range(ROUNDS):
        within = min(threshold_mm, _fitting_threshold(table, calibration.probe_from_image, chosen))
        closer = table.nearest(calibration.probe_from_image, within)
        calibration = calibrate(
            candidates_at(table.rows, closer), threshold_mm=threshold_mm, seed=seed, **options
        )
        if np.array_equal(closer, chosen):
            break
        chosen = closer
    return calibration, chosen


def _fitting_threshold(table: _Table, transform: AxisScaled, chosen: NDArray[np.bool_]) -> float:
    distance = _distances(transform, table.points[chosen], table.rows.segments_mm[chosen])
    # The distance of a point to a line in space has two components: its median is 1.18 standard deviations.
    sigma = float(np.median(distance)) / 1.1774 if len(distance) else np.inf
    return TIGHTNESS[table.rows.dimension] * sigma


def _report(used: int, total: int, reasons: dict[str, int]) -> Diagnostic:
    why = ", ".join(f"{count} with {reason}" for reason, count in reasons.items() if count)
    few = used < ENOUGH * total
    return Diagnostic(
        code="images-used",
        severity="warning" if few else "info",
        message=f"{used} of {total} sightings took part" + (f"; left out were {why}" if why else ""),
        advice="look at the contact sheet; raise the scanner's gain and keep the needle across the beam"
        if few
        else "nothing, if the needle was out of view for that share of the time",
    )


def _nothing_found(table: _Table, total: int, best: int) -> NoConsensusError:
    return NoConsensusError(
        f"{table.rows.source}: no calibration agrees with more than {best} of {total} images; {len(table.owner)} "
        f"candidates in {table.count} images were tried, and so few agree by chance; check in the contact sheet that "
        "the needle is visible and marked",
        best_count=best,
    )


def _ranks(sighting: NDArray[np.int64]) -> NDArray[np.int64]:
    order = np.argsort(sighting, kind="stable")
    start = np.searchsorted(sighting[order], sighting[order], side="left")
    ranks = np.empty(len(sighting), dtype=np.int64)
    ranks[order] = np.arange(len(sighting)) - start
    return ranks


def _distances(transform: AxisScaled, points: Array, segments_mm: Array) -> Array:
    """(N,) mm: of mapped points to their lines."""
    return np.asarray(np.linalg.norm(residual_vectors(transform, points, segments_mm), axis=1))
