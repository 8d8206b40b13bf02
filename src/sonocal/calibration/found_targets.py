"""Where targets were found with a calibration, each in its own frame."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sonocal.findings import Diagnostic
from sonocal.geometry import Array
from sonocal.geometry.shown import brief
from sonocal.registration.uncertainty import NORMAL_95
from sonocal.registration.unplaced import Place
from sonocal.registration.unplaced_rows import KINDS

__all__ = ["FoundTarget", "found_target", "target_findings", "target_in_words"]

# Of a line or plane that was found: points that span it lie so far about the middle of what was seen of it, mm.
REACH_MM = 100.0
# A known place that is further off than so many of its standard deviations is not where it is said to be.
SIGNIFICANT = 3.0


@dataclass(frozen=True)
class FoundTarget:
    """A target's place, found with the calibration.

    Attributes:
        kind: "point", "line" or "plane".
        frame: in which it is, such as "Tracker".
        spanning_mm: (K, 3): points that span it, about the middle of what was seen; 1 a point, 2 a line, 3 a plane.
        axes: (3, 3): columns: directions at right angles to the target, then those along it.
        covariance: (3, 3), of a line (4, 4): of shifts along the directions at right angles, mm, at the middle; then
            of turns of each of these towards each of those along it, rad.
        said_off_mm, said_off_deg: from where it was said to be, roughly; None: nothing was said.
        said_deviations: how many standard deviations of what was said that is.
    """

    kind: Literal["point", "line", "plane"]
    frame: str
    spanning_mm: list[list[float]]
    axes: list[list[float]]
    covariance: list[list[float]]
    said_off_mm: float | None = None
    said_off_deg: float | None = None
    said_deviations: float | None = None

    __repr__ = brief

    @property
    def middle_mm(self) -> Array:
        """(3,): of it, in the middle of what was seen."""
        spanning: Array = np.array(self.spanning_mm)
        return np.asarray(spanning.mean(axis=0))

    @property
    def direction(self) -> Array | None:
        """(3,): of a line, or a plane's normal; None of a point."""
        if self.kind == "point":
            return None
        axes: Array = np.array(self.axes)
        return axes[:, 2 if self.kind == "line" else 0]

    @property
    def sigma_mm(self) -> float:
        """Standard deviation of where it is, across it, at the middle: of the loosest direction."""
        normals = 4 - len(self.spanning_mm)
        return float(np.sqrt(np.linalg.eigvalsh(np.array(self.covariance)[:normals, :normals])[-1]))

    @property
    def sigma_deg(self) -> float:
        """Standard deviation of its direction, of the loosest turn; 0 of a point."""
        normals = 4 - len(self.spanning_mm)
        turns = np.array(self.covariance)[normals:, normals:]
        return float(np.degrees(np.sqrt(np.linalg.eigvalsh(turns)[-1]))) if len(turns) else 0.0


def found_target(
    place: Place, frame: str, said_mm: Array | None = None, sigmas: tuple[float, float] = (0.0, 0.0)
) -> FoundTarget:
    """A place as a calibration keeps it.

    Args:
        place: with its covariance.
        frame: in which it is.
        said_mm: (K, 3): where it was said to be, roughly.
        sigmas: how roughly: mm, and degrees of its direction.
    """
    assert place.covariance is not None
    spans, middle, axes = KINDS.index(place.kind) + 1, place.middle_mm, place.axes
    spanning = {
        1: [middle],
        2: [middle - REACH_MM * axes[:, 2], middle + REACH_MM * axes[:, 2]],
        3: [
            middle + REACH_MM * (np.cos(turn) * axes[:, 1] + np.sin(turn) * axes[:, 2])
            for turn in 2 * np.pi / 3 * np.arange(3)
        ],
    }[spans]
    off = (None, None, None) if said_mm is None else _off(place, said_mm, sigmas)
    return FoundTarget(
        place.kind,  # type: ignore[arg-type]  # it is one of the three
        frame,
        np.array(spanning).tolist(),
        axes.tolist(),
        place.covariance.tolist(),
        *off,
    )


def target_findings(targets: Mapping[str, FoundTarget]) -> Iterator[Diagnostic]:
    """Targets that are not where they were said to be."""
    for name, target in targets.items():
        if target.said_deviations is None or target.said_deviations < SIGNIFICANT:
            continue
        turned = f" and {target.said_off_deg:.1f} deg" if target.said_off_deg else ""
        yield Diagnostic(
            code="target-elsewhere",
            severity="warning",
            message=(
                f"{target.kind} {name!r} was found {target.said_off_mm:.1f} mm{turned} from where it was said to be, "
                f"{target.said_deviations:.1f} times what was said of how well that is known"
            ),
            advice=(
                'measure its place again, or write place = "unknown" for it; the calibration took where the rows say '
                "that it is into account"
            ),
        )


def target_in_words(name: str, target: FoundTarget) -> str:
    """Where a target is, and how well that is known."""
    where = ", ".join(f"{x:.1f}" for x in target.middle_mm)
    text = f"{target.kind.capitalize()} {name!r} is at ({where}) mm in the frame {target.frame}"
    text += f" (+-{NORMAL_95 * target.sigma_mm:.2f} mm"
    if target.direction is not None:
        what = "along" if target.kind == "line" else "facing"
        along = ", ".join(f"{x:.3f}" for x in target.direction)
        text += f"), {what} ({along}) (+-{NORMAL_95 * target.sigma_deg:.2f} deg"
    if target.said_off_mm is not None:
        turned = f" and {target.said_off_deg:.2f} deg" if target.direction is not None else ""
        text += f"; {target.said_off_mm:.2f} mm{turned} from where it was said to be"
        if target.said_deviations is not None:
            agrees = "agrees" if target.said_deviations < SIGNIFICANT else "disagrees"
            text += f", which {agrees} ({target.said_deviations:.1f} standard deviations of that)"
    return text + ", 95 %)"


def _off(place: Place, said_mm: Array, sigmas: tuple[float, float]) -> tuple[float, float, float]:
    """How far a place is from where it was said to be: mm at the middle of what was seen, degrees, and deviations."""
    spans = len(said_mm)
    across, along = place.axes[:, : 4 - spans], place.axes[:, 4 - spans :]
    away = said_mm.mean(axis=0) - place.middle_mm
    turned = 0.0
    if spans > 1:
        said_along = np.linalg.svd(said_mm - said_mm.mean(axis=0))[2][: spans - 1].T
        slope = across.T @ said_along @ np.linalg.inv(along.T @ said_along)
        away = away - said_along @ np.linalg.inv(along.T @ said_along) @ (along.T @ away)
        turned = float(np.degrees(np.arctan(np.linalg.norm(slope, 2))))
    off = float(np.linalg.norm(across.T @ away))
    reach = float(np.linalg.norm(along.T @ (said_mm.mean(axis=0) - place.middle_mm))) if spans > 1 else 0.0
    sigma_mm = np.hypot(sigmas[0], reach * np.radians(sigmas[1])) if spans > 1 else sigmas[0]
    deviations = max(off / sigma_mm, turned / sigmas[1] if spans > 1 else 0.0)
    return off, turned, float(deviations)
