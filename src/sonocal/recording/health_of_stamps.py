"""What is wrong with the stamps of a recording's items: none, out of order, alike, or with gaps."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from sonocal.findings import Diagnostic

__all__ = ["stamp_findings"]

# A gap is this many usual intervals; one or two dropped frames are normal.
GAP_FACTOR = 4.0
# Share of the stamps that equal the one before, above which frames are no copies and the clock is to blame.
COARSE = 0.5


def stamp_findings(times: NDArray[np.float64]) -> Iterator[Diagnostic]:
    """The findings of stamps (N,), s; NaN: none."""
    if np.isnan(times).all():
        if len(times) > 1:
            yield _warning(
                "no-times", "no item has a time stamp", "poses cannot be moved in time; record with stamps"
            )
        return
    steps = np.diff(times)
    if (steps < 0).any():
        i = int(np.flatnonzero(steps < 0)[0]) + 1
        yield _warning(
            "stamps-out-of-order",
            f"{(steps < 0).sum()} stamps are earlier than the one before them, first at frame {i} "
            f"({times[i - 1]:.3f} s, then {times[i]:.3f} s)",
            "sort the frames by time, or delete those",
        )
    if (steps == 0).any():
        yield _repeated_stamps(times, steps)
    usual = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    gaps = np.flatnonzero(steps > GAP_FACTOR * usual) if usual > 0 else np.empty(0, dtype=np.int64)
    if len(gaps):
        widest = int(gaps[np.argmax(steps[gaps])])
        what = "gap is" if len(gaps) == 1 else "gaps are"
        yield _warning(
            "gaps",
            f"{len(gaps)} {what} longer than {GAP_FACTOR:g} usual intervals of {1000 * usual:.0f} ms, the longest "
            f"{1000 * float(steps[widest]):.0f} ms after frame {widest}",
            "poses are not interpolated across long gaps; check the recorder's load",
        )


def _repeated_stamps(times: NDArray[np.float64], steps: NDArray[np.float64]) -> Diagnostic:
    """Copies of frames; where most stamps are alike it is the clock that is coarse, or stands."""
    alike = int((steps == 0).sum())
    if alike <= COARSE * len(steps):
        i = int(np.flatnonzero(steps == 0)[0]) + 1
        return _warning(
            "stamps-repeated",
            f"{alike} frames have the stamp of the frame before them, first frame {i}",
            "delete the repeated frames; a copy is not a second measurement",
        )
    forward = steps[steps > 0]
    clock = (
        f"the clock goes on by {np.median(forward):.3g} s at a time" if len(forward) else "the clock stands"
    )
    return _warning(
        "stamps-repeated",
        f"{alike} of {len(times)} frames have the stamp of the frame before them: {clock}",
        "stamp each frame with a time of its own, as no latency can be told of these; delete frames only if they are "
        "copies",
    )


def _warning(code: str, message: str, advice: str) -> Diagnostic:
    return Diagnostic(code=code, severity="warning", message=message, advice=advice)
