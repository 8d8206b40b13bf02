"""One time line of stamps, whatever a sender's clock does."""

from __future__ import annotations

from collections import deque

from sonocal.igtl import Message

__all__ = ["Clock"]

TICKS = 1 << 32
BACK_S, AHEAD_S = 2.0, 2.0
"""A stamp so far behind the newest, or so much further ahead than time went on, is of a clock that was set."""
MOST_JUMPS, WITHIN = 4, 40
"""More in so many messages: image and tracker do not have one clock."""
TOGETHER_S = 0.05


class Clock:
    """Stamps as ticks of 2^-32 s from the first, which never run backwards by a lot.

    Attributes:
        by_arrival: whether stamps mean nothing, and the time of arrival is taken.
        jumped: whether the last stamp was of a clock that was set: what came before belongs to nothing that follows.
    """

    def __init__(self) -> None:
        self.by_arrival = self.jumped = False
        self._offset: int | None = None
        self._newest = 0
        self._came_s = self._first_s = 0.0
        self._jumps: deque[int] = deque(maxlen=MOST_JUMPS)
        self._count = 0
        self._said: list[str] = []

    def ticks(self, message: Message, now_s: float) -> int:
        """When a message that came now was taken."""
        self._count += 1
        self.jumped = False
        if self._offset is None:
            self._offset, self._came_s, self._first_s = message.stamp, now_s, now_s
        if message.stamp == 0 and not self.by_arrival:
            self._without("messages carry no stamps", now_s)
        if self.by_arrival:
            return self._arrived(now_s)
        at, passed_s = message.stamp - self._offset, now_s - self._came_s
        ahead_s = (at - self._newest) / TICKS
        if ahead_s < -BACK_S or ahead_s > AHEAD_S + 2.0 * passed_s:
            at = self._set(at, ahead_s - passed_s, now_s)
            if self.by_arrival:
                return self._arrived(now_s)
        if at > self._newest:
            self._newest, self._came_s = at, now_s
        return at

    def said(self) -> list[str]:
        """What was wrong since the last time, a sentence each."""
        said, self._said = self._said, []
        return said

    def _set(self, at: int, by_s: float, now_s: float) -> int:
        """Go on without a gap behind a clock that was set."""
        self.jumped = True
        self._jumps.append(self._count)
        if len(self._jumps) == MOST_JUMPS and self._count - self._jumps[0] < WITHIN:
            self._without(
                "images and poses are stamped by clocks that differ, or one that jumps all the time",
                now_s,
            )
            return 0
        self._said.append(
            f"the sender's clock was set {'ahead' if by_s > 0 else 'back'} by {abs(by_s):.1f} s; the time line goes on "
            "without it"
        )
        assert self._offset is not None
        goes_on = self._newest + int(max(now_s - self._came_s, TOGETHER_S) * TICKS)
        self._offset += at - goes_on
        return goes_on

    def _arrived(self, now_s: float) -> int:
        self._newest = max(self._newest, int((now_s - self._first_s) * TICKS))
        return self._newest

    def _without(self, why: str, now_s: float) -> None:
        self.by_arrival = self.jumped = True
        self._first_s = now_s - self._newest / TICKS - TOGETHER_S  # the time line goes on
        self._said.append(
            f"{why}; the time at which they arrive is taken instead, which is off by what the network adds: let the "
            "sender stamp images and poses by one clock"
        )
