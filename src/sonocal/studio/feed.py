"""A live session as the page follows it: how it stands, its newest image, and what the last fit says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sonocal.calibration import Calibration
from sonocal.errors import SonocalError
from sonocal.geometry import Array
from sonocal.geometry.shown import quoted
from sonocal.live import Live, State
from sonocal.recording import Recording, with_latency
from sonocal.studio.answer import answer_of, crossings, numbers
from sonocal.studio.growing import Growing
from sonocal.studio.images import shown_grey
from sonocal.sweep import Hold

__all__ = ["Feed", "Shown"]

BACK = 40
"""Items that are looked back on, so that poses of a tracker that lags are there."""
NEAR_PX = 3.0
"""A point is the needle's within the threshold of the fit, and never asked to be nearer than this."""
MOST_FALL = 400
LEAN_SHARE = 0.25
"""Of the image's width: as long is a ghost that lies in the image."""


@dataclass(frozen=True, eq=False)
class Shown:
    """An image, and where the needle is in it.

    Attributes:
        number: of the image, from 0; the next has a larger one.
        item: of the recording.
        image: (rows, columns), grey.
        candidates: (K, 2) px, what stands out, best first.
        crosses: of each line, where the last fit says that it is, (u, v); None where that is not known.
        rings: of each line, the point that is taken for it; None without one.
    """

    number: int
    item: int
    image: NDArray[np.uint8]
    candidates: list[list[float]]
    crosses: list[list[float] | None]
    rings: list[list[float] | None]

    @property
    def told(self) -> dict[str, Any]:
        """All but the image, as JSON has it."""
        names = ("number", "item", "candidates", "crosses", "rings")
        return {name: getattr(self, name) for name in names}


class Feed:
    """A live session that a page follows.

    Args:
        running: the session; its frames are already coming.
        server: how messages call where they come from.
        until_mm: below which predicted error it ends by itself.
        close: gives back what `running` rests on, once that has ended.

    Attributes:
        volume: of what was scanned so far.
    """

    def __init__(
        self, running: Live, server: str, *, until_mm: float | None = None, close: Callable[[], None]
    ) -> None:
        self.running, self.server, self._until_mm, self._close = running, server, until_mm, close
        self.volume = Growing(running.session)
        self._fall: list[list[float]] = []
        self._fits = 0

    def __repr__(self) -> str:
        return f"<Feed of {quoted(self.server)}: {self.running!r}>"

    @property
    def about(self) -> dict[str, Any]:
        """What is known of the recording that grows."""
        session = self.running.session
        told = {"name": self.server, "targets": [one.name for one in session.lines], "frames": 0}
        image = session.stream.recording(max(0, len(session.stream) - 1)).image
        if image is not None:
            told |= {"size_px": list(image.size_px[:2]), "dimension": image.dimension}
        return told | {"tools": [one.name for one in self.running.state.tools]}

    def moment(self) -> dict[str, Any]:
        """How it stands."""
        state = self.running.state
        if state.fits != self._fits:
            self._fits = state.fits
            if state.expected_mm is not None and not state.refusal:
                self._fall.append([round(state.elapsed_s, 2), float(f"{state.expected_mm:.4g}")])
                if len(self._fall) > MOST_FALL:
                    del self._fall[1:-1:2]
        return _told(state, self._found()) | {
            "server": self.server,
            "until_mm": self._until_mm,
            "fall": list(self._fall),
        }

    def answer(self) -> dict[str, Any] | None:
        """What the last fit says, as of a recording; None without one."""
        found = self.running.session.latest
        return None if found is None else answer_of(found.calibration, found.observations)

    @property
    def newest_number(self) -> int:
        """Of the newest image that can be shown; -1 before there is one."""
        session = self.running.session
        if not session.looked:
            return session.stream.stored - 1
        return session.looked - 1 - self._without_poses()

    def newest(self, after: int = -1) -> Shown | None:
        """The newest image that was looked into, and whose poses are there; None where it is not behind one."""
        session = self.running.session
        looked, number = session.looked, self.newest_number
        if number <= after:
            return None
        if not looked:
            return self._bare(number)
        item, points = session.stood_out(number)
        since = max(0, item - BACK)
        window = session.stream.recording(since)
        crosses, reach_px = self._crosses(window, item - since)
        flat = points[:, :, :2].mean(axis=1)
        rings = [_nearest(flat, one, reach_px) for one in crosses]
        if all(one is None for one in crosses) and len(session.lines) == 1 and len(flat):
            rings = [numbers(flat[0], 2)]
        grey = shown_grey(window, item - since, self.server)
        return Shown(number, item, grey, numbers(flat, 2), crosses, rings)

    def stop(self, why: str) -> None:
        """Take nothing in any more."""
        self.running.stop(why)

    def close(self) -> None:
        """Stop, and wait until all that came is kept."""
        try:
            self.volume.close()
            self.running.close()
        finally:
            self._close()

    def _without_poses(self) -> int:
        """How many of the last images the tracker's stamps have not reached, for it is late."""
        session, stream = self.running.session, self.running.session.stream
        last_s, back = stream.time_s(len(stream) - 1), 0
        while back < min(BACK, session.looked - 1) and session.latency_s > 0:
            if stream.time_s(stream.image_item(session.looked - 1 - back)) + session.latency_s <= last_s:
                break
            back += 1
        return back

    def _bare(self, number: int) -> Shown:
        item, _ = self.running.session.stream.image(number)
        grey = shown_grey(self.running.session.stream.recording(item), 0, self.server)
        return Shown(number, item, grey, [], [], [])

    def _found(self) -> Calibration | None:
        session = self.running.session
        return None if session.latest is None or session.refusal else session.latest.calibration

    def _crosses(self, window: Recording, index: int) -> tuple[list[list[float] | None], float]:
        """Where the last fit says that the lines are in an image of a few items, and how near a point of theirs is."""
        session, found = self.running.session, self._found()
        nothing: list[list[float] | None] = [None] * len(session.lines)
        if found is None or found.dimension != 2:
            return nothing, NEAR_PX
        try:
            lagged = with_latency(window, session.latency_s, on_invalid="skip")
            segments = session.posing.segments_mm(lagged, session.lines)
        except SonocalError:  # of a tool that was not seen lately
            return nothing, NEAR_PX
        places = crossings(found, segments[index : index + 1])[0]
        reach_px = found.threshold_mm / float(min(found.scales_mm_per_px))
        return [None if one[0] is None else one for one in places], max(NEAR_PX, reach_px)


def _nearest(points: Array, to: list[float] | None, reach_px: float) -> list[float] | None:
    if to is None or not len(points):
        return None
    away = np.linalg.norm(points - to, axis=1)
    best = int(np.argmin(away))
    return list(numbers(points[best], 2)) if away[best] <= reach_px else None


def _told(state: State, found: Calibration | None) -> dict[str, Any]:
    """A moment as JSON has it."""
    lag = state.latency
    counts = ("images", "recorded", "paired", "looked", "used", "fits", "dropped", "damaged", "late")
    return {name: getattr(state, name) for name in counts} | {
        "at_s": round(state.elapsed_s, 1),
        "seen": state.with_candidates,
        "expected_mm": state.expected_mm,
        "refusal": state.refusal,
        "tools": [[one.name, one.seen, round(one.share, 3)] for one in state.tools],
        "lag_ms": None if lag is None else [round(1e3 * lag.latency_s, 1), round(1e3 * lag.within_s, 1)],
        "connected": state.connected,
        "quiet_s": round(state.quiet_s, 1),
        "advice": state.advice,
        "hold": None if state.hold is None else _ghost(state.hold, found),
        "said": [[round(at_s, 1), sentence] for at_s, sentence in state.said],
        "ended": state.ended,
    }


def _ghost(hold: Hold, found: Calibration | None) -> dict[str, Any]:
    """A needle to hold: in the image, and, where the calibration is known, both its ends in the marker's frame."""
    place = np.array([*hold.place_px, 0.0])
    along = LEAN_SHARE * hold.image_size_px[0] * hold.direction
    told: dict[str, Any] = {
        "place_px": numbers(place[:2], 1),
        "hub_px": numbers((place + along)[:2], 1),
        "tilt_deg": round(hold.tilt_deg, 1),
        "words": hold.words,
        "ends_mm": None,
    }
    if found is not None and found.dimension == 2:
        matrix = found.probe_from_image.matrix
        ends = np.stack([place + along, place - along])
        told["ends_mm"] = numbers(ends @ matrix[:3, :3].T + matrix[:3, 3], 2)
    return told
