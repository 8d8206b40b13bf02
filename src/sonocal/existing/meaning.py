"""What a matrix from an image to a probe means, and what of it no calibration of a scanner's image has."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sonocal.existing.matrix import Existing
from sonocal.findings import Diagnostic
from sonocal.geometry import Array, AxisScaled
from sonocal.geometry.shown import brief
from sonocal.geometry.units import LEAST_SCALE, MOST_SCALE, UNITS, USUAL_SCALE, Hint

__all__ = ["UNUSABLE", "Meaning", "matrix_findings", "meaning_of", "unsheared"]

# Findings by which a matrix is none from px to mm.
UNUSABLE = {"implausible-units", "inverted-matrix", "rigid-matrix"}
# Of a scale: six printed digits leave less, and no scanner has pixels of 1 mm to that.
RIGID = 1e-3
# Of the angle between the image's axes: half a mm at 100 mm; four printed decimals leave 0.06.
SHEAR_DEG = 0.25
# Of mm/px along u and v: 1 % is 0.5 mm at 50 mm.
UNEQUAL = 0.01
# Of the third column, which 2D images do not use: beyond this it is no cross product.
THIRD_DEG, THIRD_SHARE = 1.0, 0.05


@dataclass(frozen=True, eq=False)
class Meaning:
    """A matrix in words' numbers.

    Attributes:
        scales_mm_per_px: (3,), along u, v and w.
        rotation: (3, 3): the nearest rotation of the image's plane: directions of u, v and their normal in the marker's
            frame, as columns.
        rotation_deg: its angle.
        offset_mm: (3,): where the first pixel's centre is in the marker's frame.
        uv_deg: the angle between the image's axes: 90 in a similarity.
        third_deg: the angle between the third column and the normal of the first two: 0 in a similarity.
    """

    scales_mm_per_px: Array
    rotation: Array
    rotation_deg: float
    offset_mm: Array
    uv_deg: float
    third_deg: float

    __repr__ = brief

    @property
    def is_sheared(self) -> bool:
        """Whether the image's axes are at no right angle."""
        return abs(self.uv_deg - 90.0) > SHEAR_DEG

    @property
    def is_mirrored(self) -> bool:
        """Whether the third column points against the normal."""
        return self.third_deg > 90.0

    @property
    def is_rigid(self) -> bool:
        """Whether nothing is scaled: px are taken for mm."""
        return bool(np.abs(self.scales_mm_per_px - 1.0).max() < RIGID)

    @property
    def unequal(self) -> float:
        """How much longer a pixel is along u than along v, as a share."""
        return float(self.scales_mm_per_px[0] / self.scales_mm_per_px[1] - 1.0)


def meaning_of(matrix: Array) -> Meaning:
    """The parts of a matrix (4, 4) that can be inverted."""
    scales = np.linalg.norm(matrix[:3, :3], axis=0)
    u, v, w = (matrix[:3, :3] / scales).T
    normal = np.cross(u, v)
    across = np.linalg.norm(normal)
    # The rotation whose first two columns are nearest to u and v, with nothing said of the third.
    left, _, right = np.linalg.svd(np.column_stack([u, v, normal / across]))
    rotation = left @ right
    angle = np.arccos(np.clip((np.trace(rotation) - 1.0) / 2.0, -1.0, 1.0))
    return Meaning(
        scales_mm_per_px=scales,
        rotation=rotation,
        rotation_deg=float(np.degrees(angle)),
        offset_mm=matrix[:3, 3],
        uv_deg=float(np.degrees(np.arctan2(across, u @ v))),
        third_deg=float(np.degrees(np.arccos(np.clip(normal @ w / across, -1.0, 1.0)))),
    )


def unsheared(matrix: Array) -> AxisScaled:
    """The nearest transform of an image that no scanner shears, with the scales of u and v."""
    meaning = meaning_of(matrix)
    u, v, _ = meaning.scales_mm_per_px
    return AxisScaled(meaning.rotation, meaning.offset_mm, np.array([u, v, np.sqrt(u * v)]))


def matrix_findings(existing: Existing, dimension: int | None = None) -> tuple[Diagnostic, ...]:
    """What is odd about a matrix, seen without a scan, warnings first.

    Args:
        existing: the matrix.
        dimension: of the images that it is for, where that is known: 2D ones do not use the third column.
    """
    meaning = meaning_of(existing.matrix)
    found = [
        *existing.notes,
        *_scale_findings(existing.said, meaning),
        *_angle_findings(existing.said, meaning),
        *_third_column(existing.said, meaning, dimension),
    ]
    return tuple(sorted(found, key=lambda one: one.severity != "warning"))


def _scale_findings(said: str, meaning: Meaning) -> Iterator[Diagnostic]:
    scales = meaning.scales_mm_per_px[:2]
    least, most = float(scales.min()), float(scales.max())
    if meaning.is_rigid:
        yield Diagnostic(
            code="rigid-matrix",
            severity="warning",
            message=f"{said} scales nothing: it is from mm, or by it a pixel is 1 mm wide",
            advice=(
                "look where the mm per px went: in 3D Slicer and ITK the image's own spacing may hold them; multiply "
                "the first three columns by the scanner's mm per px, or compare it as a transform from mm"
            ),
        )
    elif most > MOST_SCALE and USUAL_SCALE[0] <= 1.0 / most <= USUAL_SCALE[1]:
        yield Diagnostic(
            code="inverted-matrix",
            severity="warning",
            message=(
                f"{said} has {most:.4g} mm/px, and no scanner shows more than {MOST_SCALE:g}: is it the inverse, from "
                f"the probe to the image? its inverse has {1 / most:.4g} mm/px"
            ),
            advice="if it is, give --stored-as inverse",
        )
    elif least < LEAST_SCALE or most > MOST_SCALE:
        yield _unit_doubt(said, least, most)
    if abs(meaning.unequal) > UNEQUAL:
        yield Diagnostic(
            code="anisotropic-scale",
            severity="warning",
            message=(
                f"{said} has {scales[0]:.5f} and {scales[1]:.5f} mm/px, {100 * abs(meaning.unequal):.1f} % apart along "
                "u and v"
            ),
            advice="see whether the scanner's pixels are square in mm: in a similarity they are",
        )


def _unit_doubt(said: str, least: float, most: float) -> Diagnostic:
    bound = f"less than {LEAST_SCALE:g}" if least < LEAST_SCALE else f"more than {MOST_SCALE:g}"
    value = least if least < LEAST_SCALE else most
    units = Hint("", value, USUAL_SCALE).units("millimetres")
    question = " or ".join(units) or "millimetres"
    return Diagnostic(
        code="implausible-units",
        severity="warning",
        message=f"are these {question}? {said} has {value:.2g} mm/px, and no scanner shows {bound}",
        advice=(
            f"multiply its first three rows by {' or '.join(f'{UNITS[unit]:g}' for unit in units)}"
            if units
            else "give a matrix from px to mm"
        ),
    )


def _angle_findings(said: str, meaning: Meaning) -> Iterator[Diagnostic]:
    if meaning.is_sheared:
        yield Diagnostic(
            code="sheared-matrix",
            severity="warning",
            message=(
                f"{said} shears the image: its axes u and v are {meaning.uv_deg:.2f} deg apart in space, where a "
                "scanner's are 90"
            ),
            advice=(
                "it is no similarity: it was fitted without that constraint, as fCal does unless told otherwise, or "
                "numbers of it were changed; calibrate again with more sightings"
            ),
        )


def _third_column(said: str, meaning: Meaning, dimension: int | None) -> Iterator[Diagnostic]:
    """Of 2D images it moves nothing; volumes, and programs that invert the matrix, use it."""
    used = dimension == 3
    if meaning.is_mirrored:
        yield Diagnostic(
            code="mirrored-matrix",
            severity="warning" if used else "info",
            message=(
                f"{said} mirrors: its third column points against the image's normal (determinant below 0), which no "
                "rotation does; a volume would come out mirrored, and of a 2D image nothing moves"
            ),
            advice="of a 2D image turn the third column round; of a volume check which axis runs the other way",
        )
        return
    lengths = meaning.scales_mm_per_px
    apart = abs(lengths[2] / np.sqrt(lengths[0] * lengths[1]) - 1.0)
    if meaning.third_deg > THIRD_DEG or apart > THIRD_SHARE:
        yield Diagnostic(
            code="third-column",
            severity="warning" if used else "info",
            message=(
                f"{said} has a third column of {lengths[2]:.4g} mm/px, {meaning.third_deg:.1f} deg off the image's "
                "normal, where a similarity's is the normal, as long as the others; of a 2D image nothing moves by it"
            ),
            advice="mind it where volumes are placed by this matrix",
        )
