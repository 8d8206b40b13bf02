"""Is one axis in another unit than the others? A needle that changes its length with its direction says so."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sonocal.findings import Diagnostic
from sonocal.geometry.transforms import Array
from sonocal.geometry.units import GO_ON

__all__ = ["axis_doubt", "end_doubt", "odd_axis"]

# Rows whose segments differ: three factors fit the lengths of three segments, whatever these are.
FEWEST_SEGMENTS = 10
# Of lengths, the middle nine tenths against the middle one: a rigid needle's differ by less than the first for the
# tracker's noise, and those of points anywhere on a line by more than the second, whatever axes are multiplied by.
RIGID, UNEQUAL = 0.03, 0.1
# The two other axes are alike, and the odd one is another unit and no error of the tracker's.
ALIKE, LEAST_FACTOR = 0.05, 1.5
# Of the other end's: how far an end lies from the origin, and how far it moves, in metres where that is in mm.
LEAST_END = 0.01
# Standard errors: an axis of which the lengths do not depend on has no factor.
SURE = 10.0


def odd_axis(segments_mm: Array) -> tuple[int, float, float] | None:
    """The axis whose numbers make segments (N, 2, 3) of one length when they are multiplied by a factor.

        a_x dx^2 + a_y dy^2 + a_z dz^2 = 1

    Returns:
        The axis, what to multiply it by, and the length of the segments then; None where no axis is odd.
    """
    squares = np.unique(np.round(segments_mm[:, 1] - segments_mm[:, 0], 6), axis=0) ** 2
    size = np.abs(squares).max(axis=0, initial=0.0)
    if len(squares) < FEWEST_SEGMENTS or not np.all(size > 0) or _spread(squares @ np.ones(3)) < UNEQUAL:
        return None
    shares = squares / size
    found, left, rank, _ = np.linalg.lstsq(shares, np.ones(len(shares)), rcond=None)
    if rank < 3 or np.any(found <= 0) or _spread(shares @ found) > RIGID:
        return None
    errors = np.sqrt(float(left[0]) / (len(shares) - 3) * np.diag(np.linalg.inv(shares.T @ shares)))
    if np.any(found < SURE * errors):
        return None
    factors = np.sqrt(found / size)
    odd = int(np.argmax(np.abs(np.log(factors / np.median(factors)))))
    others = np.delete(factors, odd)
    factor = float(factors[odd] / others.mean())
    if np.ptp(others) > ALIKE * others.mean() or max(factor, 1 / factor) < LEAST_FACTOR:
        return None
    return odd, factor, float(1 / others.mean())


def axis_doubt(segments_mm: Array) -> Iterator[Diagnostic]:
    """The finding, where an axis is odd.

    Args:
        segments_mm: (N, 2, 3), of one needle or wire.
    """
    found = odd_axis(segments_mm)
    if found is None:
        return
    axis, factor, length_mm = found
    lengths = np.linalg.norm(segments_mm[:, 1] - segments_mm[:, 0], axis=1)
    yield Diagnostic(
        code="implausible-units",
        severity="warning",
        message=(
            f"is {'xyz'[axis]} in another unit? the needle's segments are {lengths.min():.3g} to {lengths.max():.3g} "
            f"mm long, and all {length_mm:.3g} mm when {'xyz'[axis]} is multiplied by {factor:.3g}"
        ),
        advice=f"give x, y and z in mm: multiply {'xyz'[axis]} by {factor:.3g}" + GO_ON,
    )


def end_doubt(segments_mm: Array) -> Iterator[Diagnostic]:
    """The finding, where one end of all segments (N, 2, 3) is in another unit than the other."""
    if len(segments_mm) < FEWEST_SEGMENTS:
        return
    away = np.median(np.linalg.norm(segments_mm, axis=2), axis=0)
    moved = np.ptp(segments_mm, axis=0).max(axis=1)
    near, far = int(np.argmin(away)), int(np.argmax(away))
    # An end that rests at the origin is the tip of a tool in its own frame.
    if not (moved[near] > 0 and away[near] < LEAST_END * away[far] and moved[near] < LEAST_END * moved[far]):
        return
    yield Diagnostic(
        code="implausible-units",
        severity="warning",
        message=(
            f"are both ends of the segments in one unit? the {('first', 'second')[near]} ends are {away[near]:.2g} mm "
            f"from the origin in the middle, the {('first', 'second')[far]} ends {away[far]:.3g} mm"
        ),
        advice="give both ends in mm" + GO_ON,
    )


def _spread(squared: Array) -> float:
    """Of lengths whose squares are given: the middle nine tenths against the middle one."""
    low, middle, high = np.sqrt(np.quantile(squared, [0.05, 0.5, 0.95]))
    return float((high - low) / middle) if middle > 0 else 0.0
