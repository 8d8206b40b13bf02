"""Which pose to hold next, while one scans: asked for until it was held, or was in vain for a while."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from sonocal.errors import SonocalError
from sonocal.geometry import Array, segment_directions
from sonocal.live.answers import where_few_are
from sonocal.live.state import State
from sonocal.sweep import (
    CandidateCalibration,
    Hold,
    Reach,
    Session,
    first_holds,
    held,
    holds_met,
    next_holds,
)

__all__ = ["Guide"]

PATIENCE_S = 20.0
"""A pose that was not held by then is out of reach: another is asked for."""
FIRST = 12
APART_DEG, APART_MM = 15.0, 15.0
"""From which on a needle is held otherwise than before."""


class Guide:
    """Advice for `Live`: the next pose as a `Hold`, or in words where there is no pose to ask for.

    Args:
        session: which it looks at: what was asked for counts as held once the tracker says so.
        reach: which poses can be held.
        hub: which end of the needle the hand holds.
    """

    def __init__(self, session: Session, reach: Reach | None = None, *, hub: int = 1) -> None:
        self._session, self._reach, self._hub = session, reach or Reach(), hub
        self._asked: Hold | None = None
        self._asked_s, self._from = 0.0, 0
        self._passed: list[tuple[float, float]] = []

    def __repr__(self) -> str:
        asked = "nothing asked for" if self._asked is None else self._asked.words
        return f"<Guide: {asked}>"

    def __call__(self, found: CandidateCalibration | None, state: State) -> Hold | str:
        """What to do next."""
        if len(self._session.lines) != 1:
            return where_few_are(found, state)
        try:
            needle = self._needle()
            return self._begin(needle, found, state) if found is None else self._next(needle, found)
        except (SonocalError, np.linalg.LinAlgError):  # a volume, too few rows, a tool that was not seen yet
            return where_few_are(found, state)

    def _needle(self) -> Array:
        """(N, 2, 3): its ends in every item."""
        return self._session.posing.segments_mm(self._session.stream.recording(), self._session.lines)[:, 0]

    def _begin(self, needle: Array, found: CandidateCalibration | None, state: State) -> Hold | str:
        image = self._session.stream.recording().image
        if image is None or len(image.size_px) != 2:
            return where_few_are(found, state)
        width, height = image.size_px
        holds = first_holds((width, height), count=FIRST, reach=self._reach)
        return holds[min(_changes(needle), FIRST) - 1]

    def _next(self, needle: Array, found: CandidateCalibration) -> Hold:
        """The pose that was asked for, until it was held; else the best one of now."""
        transform, now_s = found.calibration.probe_from_image, time.monotonic()
        if self._asked is not None and self._asked.scale_mm_per_px is not None:
            new = needle[self._from :]
            self._from = len(needle)
            in_vain = now_s - self._asked_s > PATIENCE_S
            if not holds_met((self._asked,), transform, new, self._reach) and not in_vain:
                return self._asked
            if in_vain:
                self._passed.append(self._asked.place_px)
        holds = next_holds(found.calibration, count=1 + len(self._passed), reach=self._facing(needle, found))
        fresh = [one for one in holds if one.place_px not in self._passed]
        self._asked, self._asked_s, self._from = (fresh or holds)[0], now_s, len(needle)
        return self._asked

    def _facing(self, needle: Array, found: CandidateCalibration) -> Reach:
        """The reach where the images show anything, on that side of them on which the hub was last."""
        mask = self._session.mask
        reach = self._reach if mask is None or mask.ndim != 2 else replace(self._reach, mask=mask)
        size = (2, 2)  # of no matter for the side
        for segment in needle[::-1]:
            now = held(found.calibration.probe_from_image, segment, size, hub=self._hub)
            if now is not None:
                return replace(reach, side=now.side)
        return reach


def _changes(needle: Array) -> int:
    """How many poses were held that differ: each from the one before it that counted; at least one."""
    seen = needle[np.isfinite(needle).all(axis=(1, 2))]
    if len(seen) == 0:
        return 1
    along, middle = segment_directions(seen), seen.mean(axis=1)
    count, last = 1, 0
    for k in range(1, len(seen)):
        turned = np.degrees(np.arccos(min(abs(float(along[k] @ along[last])), 1.0)))
        if turned > APART_DEG or np.linalg.norm(middle[k] - middle[last]) > APART_MM:
            count, last = count + 1, k
    return count
