"""A second needle beside the one that was chosen: a reverberation, or another needle, that moves as it does."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sonocal.findings import Diagnostic
from sonocal.geometry import Array, AxisScaled
from sonocal.registration.copies import common_shift
from sonocal.sweep.candidates import Candidates, Mask

__all__ = ["Twin", "find_twin", "twin_findings"]

SAME_MM = {2: 1.0, 3: 0.7}
"""Two bright spots of one image are placed to this against one another: no tracker comes between them."""
LEAST_MM = {2: 2.0, 3: 0.8}
"""Nearer than this it is the needle's own echo; lines of volumes are placed by more than a spot is."""
FARTHEST_MM = 40.0
LEAST_SHARE = 0.15
"""Of the images that took part: what is seen in fewer cannot have been chosen in its stead."""
OFTEN = 0.4
SIDEWAYS = 0.5
"""Of a way of length one, the part along depth below which neither is the upper one."""


@dataclass(frozen=True, eq=False)
class Twin:
    """Where the second one lies, seen from the chosen one.

    Attributes:
        offset_mm: (3,), along the image's u, v and w.
        seen: in how many of the images that took part.
        images: how many took part.
    """

    offset_mm: Array
    seen: int
    images: int

    @property
    def distance_mm(self) -> float:
        """From the chosen one."""
        return float(np.linalg.norm(self.offset_mm))

    @property
    def depth(self) -> float:
        """The part of the way that is along depth: 1 straight below the chosen one, -1 straight above."""
        return float(self.offset_mm[1] / self.distance_mm)

    @property
    def is_above(self) -> bool:
        """Whether it is nearer to the transducer, and so likelier the needle: echoes come after what they are of."""
        return self.depth < -SIDEWAYS


def find_twin(
    table: Candidates, chosen: Mask, transform: AxisScaled, across: Array | None = None
) -> Twin | None:
    """The second one among the candidates that were not chosen; of two, the one above.

    Either it is in one direction of the image, as reverberations are, or it is a line parallel to the needle in the
    needle's own frame.

    Args:
        table: the candidates of one needle.
        chosen: (N,) the rows that were chosen.
        transform: of which mm are taken.
        across: (F, 2, 3), of every frame: two axes across the needle that turn with it, in the probe's frame, where
            known.
    """
    pairs = _pairs(table, chosen, transform)
    if pairs is None:
        return None
    images = table.agreeing(chosen)
    found = [
        twin
        for displaced, by_shift in _models(table, pairs, transform, across)
        for twin in _both_ways(pairs, displaced, by_shift, images, table.rows.dimension)
    ]
    return min(found, key=lambda one: (not one.is_above, -one.seen), default=None)


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Candidates not chosen (M) against the chosen one of their image.

    Attributes:
        offset_mm: (M, 3), along u, v and w.
        row: (M,), a row of the chosen one.
        sighting: (M,).
        direction: (M, 3), of a volume's chosen line along u, v and w; zeros in images.
    """

    offset_mm: Array
    row: NDArray[np.int64]
    sighting: NDArray[np.int64]
    direction: Array


def _pairs(table: Candidates, chosen: Mask, transform: AxisScaled) -> _Pairs | None:
    """Candidates within reach of the chosen one of the same image."""
    middle, ends = table.places_mm(transform)
    row_of = np.full(table.count, -1)
    row_of[table.sighting[chosen]] = np.flatnonzero(chosen)
    left = np.setdiff1d(np.arange(len(table)), table.candidate[chosen])
    left = left[row_of[table.owner[left]] >= 0]
    row = row_of[table.owner[left]]
    own = table.candidate[row]
    direction = ends[own]
    offset = middle[left] - middle[own]
    offset = offset - np.einsum("ni,ni->n", offset, direction)[:, None] * direction
    near = np.linalg.norm(offset, axis=1) <= FARTHEST_MM
    if not near.any():
        return None
    return _Pairs(offset[near], row[near], table.owner[left][near], direction[near])


def _models(
    table: Candidates, pairs: _Pairs, transform: AxisScaled, across: Array | None
) -> Iterator[tuple[Array, Array]]:
    """Displacements and what shifts do to them: fixed in the image; fixed to the needle."""
    flat = np.broadcast_to(np.eye(2), (len(pairs.row), 2, 2))
    if table.rows.dimension == 2:
        yield pairs.offset_mm[:, :2], flat
    else:
        along = pairs.direction
        yield pairs.offset_mm, np.eye(3) - along[:, :, None] * along[:, None, :]
    if across is not None:
        turning = across[table.rows.frame[pairs.row]]
        yield np.einsum("nij,nj->ni", turning, pairs.offset_mm @ transform.rotation.T), flat


def _both_ways(
    pairs: _Pairs, displaced: Array, by_shift: Array, images: int, dimension: int
) -> Iterator[Twin]:
    """The shift of most images and, where the two were chosen by turns, its opposite."""
    rest = np.ones(len(displaced), dtype=bool)
    for _ in range(2):
        found = common_shift(
            displaced[rest], by_shift[rest], pairs.sighting[rest], within_mm=SAME_MM[dimension], among=images
        )
        if found is None:
            return
        explained = np.flatnonzero(rest)[found.explained]
        offsets = pairs.offset_mm[explained]
        away_mm = float(np.sqrt(np.mean(np.sum(offsets**2, axis=1))))
        if found.groups >= LEAST_SHARE * images and away_mm >= LEAST_MM[dimension]:
            yield Twin(np.median(offsets, axis=0), found.groups, images)
        rest[explained] = False
        if not rest.any():
            return


def twin_findings(twin: Twin | None) -> Iterator[Diagnostic]:
    """What to know of a second one."""
    if twin is None:
        return
    deeper = twin.depth > SIDEWAYS
    rarely = deeper and twin.seen < OFTEN * twin.images
    yield Diagnostic(
        code="second-needle",
        severity="info" if rarely else "warning",
        message=(
            f"a second needle, or an echo of it, moves with the chosen one in {twin.seen} of {twin.images} images, "
            f"{twin.distance_mm:.1f} mm {_where(twin)}: {_likelier(twin)}"
        ),
        advice=(
            "look at the contact sheet; if the other one is the needle, the calibration is off by that much: take the "
            "second needle out of the bath, lower the gain, or give the right points"
        ),
    )


def _where(twin: Twin) -> str:
    if abs(twin.depth) > SIDEWAYS:
        return "deeper" if twin.depth > 0 else "nearer to the transducer"
    return "to the right" if twin.offset_mm[0] > 0 else "to the left"


def _likelier(twin: Twin) -> str:
    if twin.depth > SIDEWAYS:
        return "the upper one, which was chosen, is likelier the needle, as echoes come after it"
    if twin.is_above:
        return "that one is likelier the needle, as echoes come after it, and it was not chosen"
    return "nothing in the images tells which of the two is the needle"
