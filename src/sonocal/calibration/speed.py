"""How fast sound ran in what was scanned: one more unknown beside the transform, along the rays of a curved probe."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sonocal.calibration.groupings import groupings_of
from sonocal.calibration.options import Options
from sonocal.calibration.repeated import fit_distinct
from sonocal.calibration.rows import point_line_rows
from sonocal.errors import InputError
from sonocal.geometry import Array, AxisScaled, homogeneous_points
from sonocal.geometry.fan import Fan
from sonocal.observations import Observations
from sonocal.registration.fit import Fit
from sonocal.registration.image_distortion import Distortion, likeliest_distortion
from sonocal.registration.mapped import MappedRows
from sonocal.registration.refine import refine_point_lines

__all__ = ["SPEEDS_M_S", "Rays", "Speed", "speed_of"]

# Of baths and soft tissue: an estimate stays within.
SPEEDS_M_S = (1400.0, 1650.0)
# Fits of all rows until those that agree stay the same, and steps of one such fit until it rests.
ROUNDS, STEPS = 4, 40
REST = 1e-11


class Asked(NamedTuple):
    """A further stretch along the rays that is asked for.

    Attributes:
        size: of the stretch, as a change of the ratio; deviation, freedom: of that.
        pulled: (k,), what of one of it the transform takes up.
        share: of the size that the scanner's mm/px have, against the fit's; 0: they are not known.
        apart: the size's variance from all but the fit's own scale.
        between: how much more the scanner's mm/px ask for than the rows do.
        between_deviation: of that, where both are right.
    """

    size: float
    deviation: float
    freedom: float
    pulled: Array
    share: float
    apart: float
    between: float = 0.0
    between_deviation: float = np.inf

    def covariance(self, at_ratio: Array) -> Array:
        """(k, k), of a transform that follows the ratio, by that at a ratio that is known.

        What the scanner's mm/px put right of the ratio they put right of the fit's scale.
        """
        follow = np.eye(len(self.pulled))
        if self.share > 0.0:
            follow[:, 6] -= self.share * self.pulled / self.pulled[6]
        return np.asarray(follow @ at_ratio @ follow.T + self.apart * np.outer(self.pulled, self.pulled))


@dataclass(frozen=True)
class Rays:
    """What is known of a curved probe before anything is fitted.

    Attributes:
        face_px: (d,), the middle of the transducer's face in the image.
        radius_mm: of the face.
        ratio: of the true to the assumed speed; None: to be estimated, within `bounds`.
        bounds: of the ratio.
        said: logarithm of what the scanner says of mm/px, and how well that is known; None: it says nothing.
    """

    face_px: tuple[float, ...]
    radius_mm: float
    ratio: float | None
    bounds: tuple[float, float]
    said: tuple[float, float] | None = None

    def fan(self, transform: AxisScaled) -> Fan:
        """The rays in an image at the transform's mm/px."""
        return Fan(self.face_px, self.radius_mm / float(transform.scales[0]))

    def stepped(self, ratio: float, left: Asked | None) -> float:
        """The ratio without the stretch that is left; one that is given stays.

        Raises:
            InputError: it is to be estimated, and no row tells.
        """
        if self.ratio is not None:
            return ratio
        if left is None:
            raise InputError(
                "no row is left over to tell the speed of sound from; scan more needle poses, or give the speed"
            )
        return float(np.clip(ratio - left.size, *self.bounds))

    def heard(self, rows: Distortion, fit: Fit) -> Asked:
        """What rows and the scanner's mm/px, where it says any, ask for together.

        Args:
            rows: what they ask for by themselves.
            fit: the transform at the ratio, and how well the rows know its scale there.
        """
        pulled, variance = rows.pulled, rows.deviation**2
        if self.said is None or pulled[6] == 0.0:
            return Asked(rows.size, rows.deviation, rows.freedom, pulled, 0.0, variance)
        size = (self.said[0] - float(np.log(fit.transform.scales[0]))) / pulled[6]
        said = self.said[1] ** 2 / pulled[6] ** 2
        both = variance + said + float(fit.least_covariance[6, 6]) / pulled[6] ** 2
        share = variance / both
        return Asked(
            size=float((1.0 - share) * rows.size + share * size),
            deviation=float(np.sqrt((1.0 - share) * variance)),
            freedom=rows.freedom,
            pulled=pulled,
            share=float(share),
            apart=float((1.0 - share) ** 2 * variance + share**2 * said),
            between=float(rows.size - size),
            between_deviation=float(np.sqrt(both)),
        )


@dataclass(frozen=True, eq=False)
class Speed:
    """The speed of sound as a ratio to the assumed one, and what rows say of it.

    Attributes:
        ratio: of the true to the assumed speed, given or estimated.
        fan: the rays in the image.
        left: what is asked for still: of an estimate no size; None: no row is to spare that would tell.
        ignored: the transform of the rows as they are.
    """

    ratio: float
    fan: Fan
    left: Asked | None
    ignored: AxisScaled

    def corrected(self, rows: Observations) -> Observations:
        """The rows with their places where they would lie at the assumed speed."""
        return rows.with_sound(points_px=self.fan.stretched(rows.points_px, self.ratio))


def speed_of(rows: Observations, plain: Options, rays: Rays) -> Speed:
    """The speed of sound, where it is to be estimated, and the rays' place in the image.

        r = J d + A f(x) k + e        f: from the face to x along its ray, k: the ratio's change

    The radius in px follows the fit's scale, which is mm/px at the assumed speed. Gauss-Newton with the likelihood's
    weights, the transform at its best for every ratio; which rows agree is found anew once their places are right.

    Args:
        rows: those to fit, as scanned.
        plain: how to fit rows whose places are right.
        rays: of the probe.

    Raises:
        SonocalError: as `fit_rows`.
        InputError: no row is left to tell a speed from.
    """
    kept, (_, fit, _), _ = fit_distinct(rows, plain)
    ignored, ratio = fit.transform, rays.ratio or 1.0
    for _ in range(ROUNDS):
        ratio, fan, left = _settled(kept, fit, rays, ratio)
        found, fitted = Speed(ratio, fan, left, ignored), fit.inlier
        _, (_, fit, _), repeated = fit_distinct(found.corrected(rows), plain)
        kept = rows if repeated is None else rows.select(repeated.kept)
        if np.array_equal(fit.inlier, fitted):
            break
    return found


def _settled(rows: Observations, fit: Fit, rays: Rays, ratio: float) -> tuple[float, Fan, Asked | None]:
    """The ratio at which the rows that agree ask for no further stretch, or as it is given."""
    transform, least = fit.transform, _Stretched(rows, fit)
    for _ in range(STEPS):
        fan = rays.fan(transform)
        refined, rows_ask = least.at(fan, ratio, transform)
        transform, left = refined.transform, None if rows_ask is None else rays.heard(rows_ask, refined)
        before = np.array([ratio, fan.radius_px])
        ratio = rays.stepped(ratio, left)
        if np.all(np.abs(before - [ratio, rays.fan(transform).radius_px]) < REST * before):
            break
    return ratio, fan, left


class _Stretched:
    """Rows that agree, with their places stretched along the rays.

    Args:
        rows: as scanned.
        fit: says which agree, and how large their noise is.
    """

    def __init__(self, rows: Observations, fit: Fit) -> None:
        self.points_px, self.table, self.fit = rows.points_px, point_line_rows(rows), fit
        self.groups: list[NDArray[np.int64]] = list(groupings_of(self.table, rows).labels.values())

    def at(self, fan: Fan, ratio: float, start: AxisScaled) -> tuple[Fit, Distortion | None]:
        """The fit at a ratio, and what the rows say of a further stretch."""
        table = replace(self.table, points=homogeneous_points(fan.stretched(self.points_px, ratio)))
        fit = self.fit
        refined = refine_point_lines(start, table, fit.inlier, fit.levelled)
        return refined, likeliest_distortion(
            MappedRows(refined.transform, table),
            fit.inlier,
            {"rays": homogeneous_points(fan.below_face(self.points_px))},
            levels=(fit.sigma_px, fit.sigma_mm),
            parameters=len(fit.covariance),
            groups=self.groups,
        )
