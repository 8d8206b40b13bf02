"""Where a phantom of known shape was found with a calibration, beside where its landmarks said that it is."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from sonocal.calibration.statistics import ErrorStatistics
from sonocal.findings import Diagnostic
from sonocal.geometry import Array
from sonocal.geometry.shown import brief
from sonocal.registration.uncertainty import NORMAL_95
from sonocal.targets import Phantom

__all__ = ["FoundPhantom", "found_phantom", "phantom_findings", "phantom_in_words"]

# Of six numbers that differ by their own deviations alone: F or chi-squared beyond it is chance once in a thousand.
DISAGREES = 1e-3
# Of the variance that a phantom's shape leaves over that of wires placed by themselves, a number.
MISSHAPEN, MATTERS_MM = 1e-3, 0.1
# Share of rows that agree where none is wrong; and what wrong ones may leave.
CLEAN, BY_OUTLIERS = 0.98, 10.0


@dataclass(frozen=True)
class FoundPhantom:
    """A phantom's place, found with the calibration.

    Attributes:
        frame: of the phantom.
        fixed_to: in which its place is.
        place: (4, 4): fixed_to from frame.
        covariance: (6, 6): of its turn (on the left, rad) and shift (mm).
        middle_mm: (3,): of what was seen of it, in the frame that it is fixed to: differences are told there.
        shape_excess: variance that its shape leaves over that of wires placed by themselves, a number: near 1 where the
            phantom has that shape.
        shape_chance: how often chance alone leaves as much.
        said_off_mm, said_off_deg: of the place from where its landmarks said that it is, at the middle of what was
            seen; None: nothing was said.
        said_chance: how often chance has them differ by more, by the uncertainties of both.
    """

    frame: str
    fixed_to: str
    place: list[list[float]]
    covariance: list[list[float]]
    middle_mm: list[float]
    shape_excess: float
    shape_chance: float
    said_off_mm: float | None = None
    said_off_deg: float | None = None
    said_chance: float | None = None

    __repr__ = brief

    @property
    def sigma_mm(self) -> float:
        """Standard deviation of where the middle of what was seen is, of the loosest direction."""
        return float(np.sqrt(np.linalg.eigvalsh(_at_middle(self)[3:, 3:])[-1]))

    @property
    def sigma_deg(self) -> float:
        """Standard deviation of how it is turned, about the loosest axis."""
        return float(np.degrees(np.sqrt(np.linalg.eigvalsh(np.array(self.covariance)[:3, :3])[-1])))

    @property
    def agrees(self) -> bool | None:
        """Whether that is where its landmarks said that it is, within the uncertainties of both."""
        return None if self.said_chance is None else self.said_chance > DISAGREES


def found_phantom(
    phantom: Phantom, place: Array, covariance: Array, middle_mm: Array, excess: tuple[float, float]
) -> FoundPhantom:
    """A phantom's place as a calibration keeps it.

    Args:
        phantom: with what its landmarks said.
        place: (4, 4): fixed_to from frame.
        covariance: (6, 6), of that.
        middle_mm: (3,): of what was seen.
        excess: what its shape leaves, and how often chance leaves as much.
    """
    found = FoundPhantom(
        phantom.frame, phantom.fixed_to, place.tolist(), covariance.tolist(), middle_mm.tolist(), *excess
    )
    if phantom.said is None:
        return found
    from scipy.spatial.transform import Rotation
    from scipy.special import chdtrc

    turn = Rotation.from_matrix(phantom.said[:3, :3] @ place[:3, :3].T).as_rotvec()
    # Where the phantom's own point that was found in the middle is said to be.
    within = np.linalg.inv(place) @ np.append(middle_mm, 1.0)
    shift = (phantom.said @ within)[:3] - middle_mm
    # What is said is turned about the phantom's origin, away from the middle.
    arm = middle_mm - place[:3, 3]
    away = np.hstack([-_cross(arm), np.eye(3)])
    spread = np.diag([np.radians(phantom.sigma_deg) ** 2] * 3 + [phantom.sigma_mm**2] * 3)
    at_middle = np.vstack([np.hstack([np.eye(3), np.zeros((3, 3))]), away])
    both = at_middle @ spread @ at_middle.T + _at_middle(found)
    off = np.concatenate([turn, shift])
    return replace(
        found,
        said_off_mm=float(np.linalg.norm(shift)),
        said_off_deg=float(np.degrees(np.linalg.norm(turn))),
        said_chance=float(chdtrc(6, off @ np.linalg.solve(both, off))),
    )


def phantom_findings(found: FoundPhantom | None, fit: ErrorStatistics) -> Iterator[Diagnostic]:
    """A phantom that is not where its landmarks said, or has not the shape that its file says."""
    if found is None:
        return
    if found.agrees is False:
        yield Diagnostic(
            code="phantom-elsewhere",
            severity="warning",
            message=(
                f"the phantom was found {found.said_off_mm:.1f} mm and {found.said_off_deg:.1f} deg from where its "
                "landmarks said that it is, more than both are unsure of"
            ),
            advice="pivot the stylus and touch the landmarks again; or the phantom moved between that and the sweep",
        )
    # Wrong dots that lie near their wires by chance leave as much where others were left out.
    clean = fit.inliers >= CLEAN * fit.observations or found.shape_excess > BY_OUTLIERS
    if found.shape_chance < MISSHAPEN and clean and fit.rms_mm > MATTERS_MM:
        yield Diagnostic(
            code="phantom-shape",
            severity="warning",
            message=(
                f"the rows fit wires placed one by one better than the phantom's shape does: it leaves "
                f"{found.shape_excess:.1f} times the variance of their noise"
            ),
            advice="measure the phantom's wires, and check that rows are matched to them by their names",
        )


def phantom_in_words(found: FoundPhantom) -> str:
    """Where a phantom is, how well that is known, and whether its landmarks agree."""
    where = ", ".join(f"{x:.1f}" for x in np.array(found.place)[:3, 3])
    text = (
        f"{found.frame} is at ({where}) mm in the frame {found.fixed_to} (+-{NORMAL_95 * found.sigma_mm:.2f} mm where "
        f"it was seen, +-{NORMAL_95 * found.sigma_deg:.2f} deg, 95 %"
    )
    if found.said_off_mm is None:
        return text + ")"
    agrees = "agrees" if found.agrees else "disagrees"
    return (
        f"{text}); {found.said_off_mm:.2f} mm and {found.said_off_deg:.2f} deg from where its landmarks said, which "
        f"{agrees} within what both are unsure of"
    )


def _at_middle(found: FoundPhantom) -> Array:
    """(6, 6): of the turn, and of the shift of the middle of what was seen."""
    arm = np.array(found.middle_mm) - np.array(found.place)[:3, 3]
    away = np.block([[np.eye(3), np.zeros((3, 3))], [-_cross(arm), np.eye(3)]])
    return np.asarray(away @ np.array(found.covariance) @ away.T)


def _cross(vector: Array) -> Array:
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
