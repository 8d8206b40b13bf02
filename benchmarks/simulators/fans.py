"""Images of curved probes whose scanner assumes another speed of sound than there is; NumPy alone."""

from __future__ import annotations

import numpy as np

from benchmarks.simulators.trust_scans import SIDE_PX, Array, Scan, clean, noisy

__all__ = ["RADIUS_MM", "as_shown", "face_of", "fan_scan"]

RADIUS_MM = 60.0


def face_of(dimension: int) -> Array:
    """The middle of the transducer's face: of the image's top."""
    middle = (SIDE_PX[dimension] - 1) / 2
    return np.array([middle, 0.0, middle][:dimension])


def as_shown(places_px: Array, truth: Array, ratio: float, radius_mm: float = RADIUS_MM) -> Array:
    """Where an image shows what lies at places (..., D), px: echoes come early where sound is fast.

    The ray from the centre of the face's arc is followed to where its time ends.

    Args:
        places_px: as they would be at the assumed speed.
        truth: (4, 4), mm from px.
        ratio: of the true to the assumed speed.
        radius_mm: of the face.
    """
    mm_per_px = float(np.linalg.norm(truth[:3, 0]))
    face = face_of(places_px.shape[-1])
    centre = face - radius_mm / mm_per_px * np.eye(len(face))[1]
    from_centre = (places_px - centre) * mm_per_px
    reach_mm = np.sqrt((from_centre**2).sum(axis=-1, keepdims=True))
    shown_mm = np.where(reach_mm > radius_mm, radius_mm + (reach_mm - radius_mm) / ratio, reach_mm)
    return np.asarray(centre + from_centre / reach_mm * shown_mm / mm_per_px)


def fan_scan(seed: int, frames: int, dimension: int, ratio: float, *, still: bool) -> Scan:
    """Sightings as such a scanner shows them; the noise is of the image that is seen."""
    scan = clean(seed, frames, dimension, still=still, frames_per_s=frames / 30)
    shown = scan.but(points_px=as_shown(scan.points_px, scan.truth, ratio))
    return noisy(shown, np.random.default_rng([seed, 2]), 1.0, 0.4)
