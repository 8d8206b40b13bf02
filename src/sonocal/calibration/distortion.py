"""Places in the image that are off by what is smooth over it: sound of another speed, lenses, shear."""

from __future__ import annotations

import numpy as np

from sonocal.calibration.area import corner_of
from sonocal.calibration.forms import beyond_predicted, can_be_tested, moved_by
from sonocal.calibration.groupings import Groupings
from sonocal.findings import Diagnostic
from sonocal.geometry import Array, area_places
from sonocal.registration.fit import Fit
from sonocal.registration.image_distortion import Distortion, likeliest_distortion
from sonocal.registration.mapped import MappedRows
from sonocal.registration.noise import Noise
from sonocal.registration.uncertainty import NORMAL_95

__all__ = ["distortions", "likeliest_of_image"]

# Of five to nine forms, some of which go together, one is beyond this in some five of a thousand sound scans.
SURE = 0.001
# Radius of the face of curved probes: 40 to 60 mm for the abdomen. Others bend the rays alike, by another share.
FACE_MM = 50.0

DEPTH = (
    "depth, from the image's top, {0:+.1f} % (+-{1:.1f} %) off along v, as where sound is of another speed"
)
FORMS = {
    "depth": DEPTH,
    "rays": DEPTH.replace("along v", f"along the rays of a curved probe (of {FACE_MM:.0f} mm radius)"),
    "squared": "an error that grows with the square of the depth, {0:+.1f} % (+-{1:.1f} %) of the image at its bottom",
    "width": "u {0:+.1f} % (+-{1:.1f} %) off",
    "slices": "w {0:+.1f} % (+-{1:.1f} %) off, as where slices are not as far apart as the file says",
    "radial": (
        "an error that grows with the cube of the distance from the middle, {0:+.1f} % (+-{1:.1f} %) of it at the "
        "corners, as lenses and curved screens have it"
    ),
}
OF_SCANNER = (
    "compare mm/px with the scanner's (--scanner-mm-per-px); check the temperature of the bath, its speed of sound, "
    "the probe's geometry in the scanner's settings; for a curved probe say its radius and the speed of sound "
    "(--probe-radius-mm, --sound-speed)"
)
OF_PICTURE = (
    "check how images are grabbed and resampled: a camera before the screen, a wrong stride of the pixels, a volume "
    "whose slices are shifted against each other or swept obliquely"
)
SHEARS = {"uv": (0, 1), "uw": (0, 2), "vw": (1, 2)}
FORMS |= {
    pair: f"that {pair[0]} and {pair[1]} are not at right angles, by {{0:+.1f}} deg (+-{{1:.1f}} deg),"
    for pair in SHEARS
}


def distortions(points: Array, area_px: Array, mm_per_px: float) -> dict[str, Array]:
    """What an image's errors may look like, each as large as its whole measure: depth, distance, angle.

    Args:
        points: (N, 3), px.
        area_px: (2, d): the image; v runs down from the skin at its least v.
        mm_per_px: of the fit.

    Returns:
        By name: (N, 3), px, from where a point is to where it is seen.
    """
    low, high = area_px
    depth = np.maximum(points[:, 1] - low[1], 0.0)
    u, v, w = np.eye(3)
    face = FACE_MM / mm_per_px
    apex = np.array([(low[0] + high[0]) / 2, low[1] - face, 0.0])
    ray = (points - apex) * [1.0, 1.0, 0.0]
    length = np.linalg.norm(ray, axis=1)
    beyond = np.maximum(length - face, 0.0) / np.maximum(length, np.finfo(float).tiny)
    found = {
        "depth": depth[:, None] * v,
        "rays": beyond[:, None] * ray,
        "squared": (depth**2 / max(float(high[1] - low[1]), 1.0))[:, None] * v,
    }
    middle = np.append(area_px.mean(axis=0), np.zeros(3 - len(low)))
    away = points - middle
    half = np.linalg.norm(high - low) / 2
    found["radial"] = away * np.sum(away**2, axis=1, keepdims=True) / max(float(half), 1.0) ** 2
    for pair, (first, second) in SHEARS.items():
        if second < len(low):
            found[pair] = away[:, [second]] * np.eye(3)[first]
    if len(low) == 3:
        found["width"] = away[:, :1] * u
        found["slices"] = away[:, 2:] * w
    return found


def likeliest_of_image(
    mapped: MappedRows, fit: Fit, noise: Noise, groupings: Groupings, area: tuple[Array, str]
) -> tuple[float, Diagnostic] | None:
    """The likeliest distortion, where it is no chance and moves the answer by more than is predicted.

    Args:
        mapped: the fitted rows under the transform, outliers included.
        fit: the transform.
        noise: of the rows.
        groupings: what rows may share an error by.
        area: (2, d), the image or what was seen of it, and what messages call it.

    Returns:
        How often chance does as much, and the finding.
    """
    area_px, area_name = area
    if not can_be_tested(fit, noise):
        return None
    scale = float(fit.transform.scales.mean())
    found = likeliest_distortion(
        mapped,
        fit.inlier,
        distortions(mapped.table.points, area_px, scale),
        levels=(noise.sigma_px or 0.0, noise.sigma_mm or 0.0),
        parameters=len(fit.covariance),
        groups=list(groupings.labels.values()),
        forms_at=lambda points: distortions(points, area_px, scale),
    )
    if found is None or found.p_value > SURE:
        return None
    corners = area_places(area_px)[:-1]
    moved = _moved_mm(found, fit, corners, area_px)
    if (beyond := beyond_predicted(moved, fit, noise, corners)) is None:
        return None
    return found.p_value, _finding(found, *beyond, area_name)


def _moved_mm(found: Distortion, fit: Fit, corners: Array, area_px: Array) -> Array:
    """(C,): how far the transform's answer moves at the corners, or with the form undone there, whichever is more."""
    by_fit = moved_by(fit, found.moved, corners)
    places = np.pad(corners, ((0, 0), (0, 3 - corners.shape[1])))
    form = distortions(places, area_px, float(fit.transform.scales.mean()))[found.form]
    undone = by_fit - found.size * form @ (fit.transform.rotation * fit.transform.scales).T
    return np.asarray(np.maximum(np.linalg.norm(by_fit, axis=1), np.linalg.norm(undone, axis=1)))


def _finding(found: Distortion, moved_mm: float, bound_mm: float, area_name: str) -> Diagnostic:
    unit = float(np.degrees(1.0)) if found.form in SHEARS else 100.0
    share = FORMS[found.form].format(unit * found.size, unit * NORMAL_95 * found.deviation)
    return Diagnostic(
        code="image-distortion",
        severity="warning",
        message=(
            f"residuals are not alike all over the image; of what may be, {share} explains them best (by chance once "
            f"in {1 / max(found.p_value, 1e-6):.0f} scans) and would move the answer by up to {moved_mm:.1f} mm at "
            f"{corner_of(area_name)}, where an error of {bound_mm:.1f} mm (95 %) is predicted"
        ),
        advice=(OF_PICTURE if found.form in {"radial", *SHEARS} else OF_SCANNER) + ", and calibrate again",
    )
