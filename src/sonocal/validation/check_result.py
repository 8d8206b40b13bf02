"""What a check found, and what it could have found: the power of its test.

P(F'_{k, f}(lambda) > F_{k, f}(1 - level)),        lambda = d' (C_then + C_now)^-1 d
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from sonocal.calibration import Calibration
from sonocal.errors import InputError
from sonocal.findings import Diagnostic
from sonocal.geometry import Array, real_array
from sonocal.geometry.shown import brief

__all__ = ["LEAST_POWER", "LEVEL", "Check"]

# Of sound sweeps so many are said to have changed.
LEVEL = 0.005
# Of changes of the size that matters so many are seen, whichever way they go; with less, none seen says nothing.
LEAST_POWER = 0.8
# Of the change that matters: one so many times as large must be seen whichever way it goes.
WHICHEVER_WAY = 3.0
WAYS = 40
BISECTIONS = 40


@dataclass(frozen=True, eq=False)
class Check:
    """What a short sweep says of a calibration.

    Attributes:
        verdict: "holds", "changed" or "cannot tell".
        rows: of the sweep, those that agree.
        tolerance_mm: the change that matters, rms over the image's corners and centre.
        tangent: (k,): the change seen, of the calibration's map: turn (rad), shift (mm), log scale.
        covariance: (k, k): of it, the calibration's own uncertainty included.
        freedom: residuals to spare that this rests on.
        seen: (k, m): an orthonormal basis, for displacements of the image, of the motions that the sweep can tell.
        image_jacobian: (3 M, k): displacements of the image's corners and centre, mm, by the tangent.
        centre_mm: (3,): the image's origin in the probe marker's frame.
        by_itself: the sweep's own calibration; None where it leaves a motion free.
        same_rows: the sweep is what the calibration was made of.
        diagnostics: what to know, warnings first.
    """

    verdict: Literal["holds", "changed", "cannot tell"]
    rows: int
    tolerance_mm: float
    tangent: Array
    covariance: Array
    freedom: float
    seen: Array
    image_jacobian: Array
    centre_mm: Array
    by_itself: Calibration | None
    same_rows: bool
    diagnostics: tuple[Diagnostic, ...]

    __repr__ = brief

    @property
    def moved_mm(self) -> float:
        """How far the image's corners and centre moved, rms."""
        return self._rms_mm(self.tangent)

    @property
    def turned_deg(self) -> float:
        """By how much the image turned in the marker's frame."""
        return float(np.degrees(np.linalg.norm(self.tangent[:3])))

    @property
    def scale_change(self) -> float:
        """By what share mm/px grew; 0 where the scale is known."""
        return float(np.expm1(np.mean(self.tangent[6:]))) if len(self.tangent) > 6 else 0.0

    @cached_property
    def p_value(self) -> float:
        """How often a calibration that holds would show as much; 1 where the sweep tells no motion at all."""
        from scipy.special import fdtrc

        count = self.seen.shape[1]
        if count == 0 or self.freedom < 1:
            return 1.0
        return float(fdtrc(count, self.freedom, self._noncentrality(self.tangent) / count))

    @cached_property
    def power_least(self) -> float:
        """The share of changes of the tolerance that would be seen, where they go the way that is seen least."""
        return self._power_at(self.tolerance_mm)

    @cached_property
    def power_mean(self) -> float:
        """The share of knocks that would be seen, of those that move the image by the tolerance, rms.

        Half of them are shifts of the marker, half turns about it, and each goes any way as often as any other.
        """
        powers = []
        for knocks in self._knocks():
            tangents = knocks @ _directions().T
            sizes = self.tolerance_mm / np.array([self._rms_mm(one) for one in tangents.T])
            powers += [self._power(self._noncentrality(one)) for one in (tangents * sizes).T]
        return float(np.mean(powers))

    @cached_property
    def tells(self) -> bool:
        """Whether no change seen means that there is none: most that matter would be seen, and all much larger ones."""
        return (
            self.power_mean >= LEAST_POWER
            and self._power_at(WHICHEVER_WAY * self.tolerance_mm) >= LEAST_POWER
        )

    @cached_property
    def visible_mm(self) -> float:
        """The least change of which 80 % would be seen, whichever way it goes; without end where one cannot be seen."""
        if not self._least_information > 0 or self.freedom < 1:
            return float("inf")
        low, high = 0.0, 1.0
        while self._power_at(high) < LEAST_POWER and high < 1e6:
            high *= 2
        for _ in range(BISECTIONS):
            middle = (low + high) / 2
            low, high = (middle, high) if self._power_at(middle) < LEAST_POWER else (low, middle)
        return high

    def power(self, marker_motion: ArrayLike) -> float:
        """The share of sweeps like this one that would show such a knock.

        Args:
            marker_motion: (4, 4), rigid, mm: what the knock does to places in the marker's frame.

        Raises:
            InputError: it is no such matrix.
        """
        from scipy.spatial.transform import Rotation

        motion = real_array("marker_motion", marker_motion)
        if motion.shape != (4, 4):
            raise InputError(f"marker_motion must have shape (4, 4); got {motion.shape}")
        tangent = np.zeros(len(self.tangent))
        tangent[:3] = Rotation.from_matrix(motion[:3, :3]).as_rotvec()
        tangent[3:6] = motion[:3, 3] + (motion[:3, :3] - np.eye(3)) @ self.centre_mm
        return self._power(self._noncentrality(tangent))

    def _rms_mm(self, tangent: Array) -> float:
        moved = (self.image_jacobian @ tangent).reshape(-1, 3)
        return float(np.sqrt(np.mean(np.sum(moved**2, axis=1))))

    def _noncentrality(self, tangent: Array) -> float:
        """Of a change in units of its own uncertainty, along the motions that are seen."""
        if not self.seen.shape[1]:
            return 0.0
        way = np.linalg.pinv(self.seen)
        part = way @ tangent
        return float(part @ np.linalg.solve(way @ self.covariance @ way.T, part))

    @cached_property
    def _least_information(self) -> float:
        """1/mm^2: of knocks that move the image by 1 mm rms, the least that the test knows of one.

        Knocks are shifts of the marker, whichever way, and turns about it, about whichever axis.
        """
        if not self.seen.shape[1]:
            return 0.0
        way = np.linalg.pinv(self.seen)
        within = np.linalg.inv(way @ self.covariance @ way.T)
        least = []
        for knocks in self._knocks():
            moved, part = self.image_jacobian @ knocks, way @ knocks
            metric = moved.T @ moved / (len(moved) / 3)
            values, vectors = np.linalg.eigh(metric)
            half = vectors / np.sqrt(np.maximum(values, 1e-12))
            least.append(np.linalg.eigvalsh(half.T @ part.T @ within @ part @ half)[0])
        return max(float(min(least)), 0.0)

    def _knocks(self) -> tuple[Array, Array]:
        """(k, 3) each: the tangents of shifts of the marker along its axes, and of turns about them."""
        shifts, turns = np.zeros((2, len(self.tangent), 3))
        shifts[3:6], turns[:3] = np.eye(3), np.eye(3)
        turns[3:6] = np.cross(np.eye(3), self.centre_mm).T
        return shifts, turns

    def _power_at(self, size_mm: float) -> float:
        return self._power(self._least_information * size_mm**2)

    def _power(self, noncentrality: float) -> float:
        from scipy.special import fdtri, ncfdtr

        count = self.seen.shape[1]
        if not count or self.freedom < 1:
            return 0.0
        limit = fdtri(count, self.freedom, 1 - LEVEL)
        # The noncentral distribution's series gives out far away, where nothing is missed.
        if noncentrality > 400 + 20 * count * limit:
            return 1.0
        return float(np.clip(1 - ncfdtr(count, self.freedom, noncentrality, limit), 0.0, 1.0))


def _directions() -> Array:
    """(WAYS, 3): unit vectors, evenly over the sphere (a Fibonacci lattice)."""
    i = np.arange(WAYS) + 0.5
    z, turn = 1 - 2 * i / WAYS, np.pi * (1 + np.sqrt(5)) * i
    flat = np.sqrt(1 - z**2)
    return np.column_stack([flat * np.cos(turn), flat * np.sin(turn), z])
