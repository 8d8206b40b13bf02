"""What is known at one moment of a live calibration: for a screen, a page, a program."""

from __future__ import annotations

from dataclasses import dataclass

from sonocal.geometry.shown import brief
from sonocal.sweep import Hold
from sonocal.validation import Verdict

__all__ = ["LagSoFar", "State", "ToolSeen"]


@dataclass(frozen=True)
class ToolSeen:
    """A tool of the tracker.

    Attributes:
        name: such as "Probe".
        frame: in which it is tracked, such as "Tracker".
        seen: whether it was there a moment ago.
        share: of the images, those for which it was there.
    """

    name: str
    frame: str
    seen: bool
    share: float

    __repr__ = brief


@dataclass(frozen=True)
class LagSoFar:
    """How much later the tracker stamps an instant than the images do, as the scan tells so far.

    Attributes:
        latency_s: the lag.
        within_s: of it, to either side (95 %).
    """

    latency_s: float
    within_s: float

    __repr__ = brief


@dataclass(frozen=True)
class State:
    """A moment.

    Attributes:
        elapsed_s: since it began.
        images: how many came.
        recorded: how many of them are kept.
        paired: how many of these have a pose of every tool.
        looked: how many were looked into.
        with_candidates: in how many of these something stands out.
        used: sightings that the last fit rests on.
        expected_mm: predicted error (95 %) at the worst corner of the image; None without a fit.
        history: how that fell: (images looked into, mm), one a fit.
        verdict: on the last fit; None without one.
        refusal: why there is no fit, in a sentence.
        fits: how many there were, those refused among them.
        cells: sightings in ninths of the area, row by row of the image.
        tilts_deg: the least and the most that the needle was tilted from the image's normal.
        tools: what the tracker sees.
        latency: as the scan tells so far; None until it does.
        dropped: messages that came faster than they were taken.
        damaged: messages that were refused.
        late: messages that came when their frame was done.
        connected: whether the server is there.
        quiet_s: how long nothing came.
        advice: what to do next, in words.
        hold: the same as a pose, where it is one.
        said: what went wrong: (elapsed_s, a sentence), the last ones.
        ended: why it ended; "" while it goes on.
    """

    elapsed_s: float = 0.0
    images: int = 0
    recorded: int = 0
    paired: int = 0
    looked: int = 0
    with_candidates: int = 0
    used: int = 0
    expected_mm: float | None = None
    history: tuple[tuple[int, float], ...] = ()
    verdict: Verdict | None = None
    refusal: str = ""
    fits: int = 0
    cells: tuple[tuple[int, ...], ...] = ()
    tilts_deg: tuple[float, float] | None = None
    tools: tuple[ToolSeen, ...] = ()
    latency: LagSoFar | None = None
    dropped: int = 0
    damaged: int = 0
    late: int = 0
    connected: bool = True
    quiet_s: float = 0.0
    advice: str = ""
    hold: Hold | None = None
    said: tuple[tuple[float, str], ...] = ()
    ended: str = ""

    __repr__ = brief

    def is_below(self, error_mm: float) -> bool:
        """Whether the predicted error is, and nothing speaks against the answer itself."""
        if self.refusal or self.verdict is None or self.expected_mm is None:
            return False
        return self.verdict.level != "stop" and self.expected_mm <= error_mm
