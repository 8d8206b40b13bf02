"""Two matrices of one probe: how far apart they put the image, and what of it the one that is ours leaves open."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sonocal.calibration import Calibration
from sonocal.existing.matrix import Existing
from sonocal.existing.meaning import meaning_of
from sonocal.geometry import Array, area_places

__all__ = ["Difference", "difference", "known_mm"]


@dataclass(frozen=True, eq=False)
class Difference:
    """How far a matrix puts the image from where another does.

    Attributes:
        other: what the other one is called, in messages.
        places_px: (M, d): corners, then centre, of an area of the image.
        difference_mm: (M, 3): the matrix minus the other, in the probe marker's frame.
        known_mm: (M,): what the other is known to at all of these places at once (95 %); None where nothing says so.
        rotation_deg: the angle between the two.
        scales_mm_per_px, other_scales_mm_per_px: (3,), of the two.
        reread: the same of what was misread, read so that it agrees; None where nothing was, or two ways do.
        because: how that is, in words, where it is not said elsewhere.
    """

    other: str
    places_px: Array
    difference_mm: Array
    known_mm: Array | None
    rotation_deg: float
    scales_mm_per_px: Array
    other_scales_mm_per_px: Array
    reread: Difference | None = None
    because: str = ""

    @property
    def distance_mm(self) -> Array:
        """(M,): how far apart."""
        return np.asarray(np.linalg.norm(self.difference_mm, axis=1))

    @property
    def beyond(self) -> NDArray[np.bool_] | None:
        """(M,): whether that is more than the other leaves open; None where nothing is known of it."""
        return None if self.known_mm is None else np.asarray(self.distance_mm > self.known_mm)

    @property
    def rows(self) -> list[tuple[str, float, float | None]]:
        """A place in words, the distance, and to what the other is known there, for tables."""
        known = [None] * len(self.places_px) if self.known_mm is None else self.known_mm.tolist()
        return [
            (_place(place), float(distance), one)
            for place, distance, one in zip(self.places_px, self.distance_mm, known, strict=True)
        ]

    @property
    def scale_ratios(self) -> Array:
        """(d,): mm/px against the other's, along the image's axes, minus 1."""
        d = self.places_px.shape[1]
        return np.asarray(self.scales_mm_per_px[:d] / self.other_scales_mm_per_px[:d] - 1.0)

    @property
    def sentence(self) -> str:
        """In words: how far, where, and whether that is more than the other leaves open, at the place that shows it."""
        furthest = int(np.argmax(self.distance_mm))
        said = f"They are up to {self.distance_mm[furthest]:.2f} mm apart"
        if self.known_mm is None or self.beyond is None:
            return f"{said}, at ({_place(self.places_px[furthest])}) px."
        # The place that the conclusion rests on, which is not the furthest where the other is known less there.
        worst = int(np.argmax(self.distance_mm / np.maximum(self.known_mm, np.finfo(float).tiny)))
        at = f"at ({_place(self.places_px[worst])}) px"
        where = f", {at}, where" if worst == furthest else f"; {at} {self.distance_mm[worst]:.2f} mm, where"
        known = f"{self.other} is known to {self.known_mm[worst]:.2f} mm (95 %, all places at once)"
        open_to = (
            "more than that leaves open" if self.beyond.any() else "no more than that leaves open anywhere"
        )
        return f"{said}{where} {known}: {open_to}."


def difference(
    one: Existing | Calibration, other: Existing | Calibration, area_px: Array, name: str = "the other"
) -> Difference:
    """How far a matrix puts an area of the image (2, d) from where another one does.

    The other's uncertainty is counted where it is a calibration of ours; a matrix of other software has none that is
    known, so that a difference within it need not be an agreement.
    """
    places = area_places(area_px)
    apart = one.probe_from_image @ places - other.probe_from_image @ places
    first, second = meaning_of(_matrix(one)), meaning_of(_matrix(other))
    turn = second.rotation.T @ first.rotation
    chord = np.linalg.norm(turn - np.eye(3))
    return Difference(
        other=name,
        places_px=places,
        difference_mm=apart,
        known_mm=known_mm(other, places),
        rotation_deg=float(np.degrees(2.0 * np.arcsin(np.clip(chord / np.sqrt(8.0), 0.0, 1.0)))),
        scales_mm_per_px=first.scales_mm_per_px,
        other_scales_mm_per_px=second.scales_mm_per_px,
    )


def _matrix(one: Existing | Calibration) -> Array:
    return one.matrix if isinstance(one, Existing) else one.probe_from_image.matrix


def known_mm(one: Existing | Calibration, places: Array) -> Array | None:
    """(M,): what a calibration of ours is known to at all of these places (M, d) at once (95 %), mm; else None."""
    if isinstance(one, Existing) or one.covariance is None:
        return None
    from sonocal.registration.uncertainty import radius_95

    return radius_95(one.predict(places)[1], one.noise.freedom, at_once=len(places))


def _place(place: Array) -> str:
    return ", ".join(f"{x:.0f}" for x in place)
