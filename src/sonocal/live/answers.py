"""What a session's last fit says: fitted when it is due, and looked at from all sides."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

from sonocal.errors import SonocalError
from sonocal.live.state import LagSoFar, State
from sonocal.sweep import CandidateCalibration, Hold, Session
from sonocal.validation import give_verdict
from sonocal.validation.coverage import coverage_of

__all__ = ["Advice", "Answers", "where_few_are"]

Advice = Callable[[CandidateCalibration | None, State], Hold | str]
"""What to do next, as a pose or in words: of the last fit (None before there is one) and of the moment."""

FIRST, LEAST_NEW, GROWTH = 20, 5, 1.25
"""Images of the first fit; that another waits for, whatever it costs; and, at the most, times as many as before."""
SHARE = 0.25
"""Of the time, at the most, that fits take where there are not so many new images."""
LAG_EACH_S = 2.0


def where_few_are(found: CandidateCalibration | None, state: State) -> str:
    """Where in the image the needle was seldom seen, and under which tilts."""
    if found is None:
        return "hold the needle across the image, in the water, and move it slowly" if state.looked else ""
    said = coverage_of(found.calibration, found.observations)["next"]
    return " ".join(said[:2])


class Answers:
    """Fits a session when it is due, and keeps what the last fit says.

    Args:
        session: which one thread fits.
        advice: what to do next.

    Attributes:
        state: what the last fit says; nothing of messages.
        fitted: how many images it had.
    """

    def __init__(self, session: Session, advice: Advice | None = None) -> None:
        self.state = State()
        self._session, self._advice = session, advice or where_few_are
        self.fitted = 0
        self._free_from_s = self._lag_from_s = 0.0

    def is_due(self) -> bool:
        """Whether there is enough that is new: many images, or some and time."""
        new = self._session.looked - self.fitted
        if new < (LEAST_NEW if self.fitted else FIRST):
            return False
        return self._session.looked >= GROWTH * self.fitted or time.monotonic() >= self._free_from_s

    def fit(self) -> None:
        """Fit, and say what that means."""
        begin_s = time.monotonic()
        session, self.fitted = self._session, self._session.looked
        session.fit()
        found, expected = session.latest, session.expected_mm
        state = replace(self.state, refusal=session.refusal, fits=self.state.fits + 1)
        if found is not None and not session.refusal:
            covered = coverage_of(found.calibration, found.observations)
            tilts = covered["tilt_deg"]
            history = state.history if expected is None else (*state.history, (self.fitted, expected))
            state = replace(
                state,
                used=found.sightings,
                expected_mm=expected,
                history=history[-500:],
                verdict=give_verdict(found.calibration),
                cells=tuple(map(tuple, covered["cells"])),
                tilts_deg=(min(tilts), max(tilts)) if tilts else None,
                latency=self._lag() or state.latency,
            )
        self.state = state
        end_s = time.monotonic()
        self._free_from_s = end_s + (end_s - begin_s) * (1.0 / SHARE - 1.0)

    def advise(self, moment: State) -> None:
        """Ask what to do next."""
        said = self._advice(self._session.latest, moment)
        hold = said if isinstance(said, Hold) else None
        self.state = replace(self.state, advice=said if isinstance(said, str) else said.words, hold=hold)

    def _lag(self) -> LagSoFar | None:
        now_s = time.monotonic()
        if now_s < self._lag_from_s:
            return None
        self._lag_from_s = now_s + LAG_EACH_S
        try:
            lag = self._session.lag()
        except SonocalError:  # of a needle that hardly moved
            return None
        low, high = lag.interval_s
        if self._session.estimates_lag:
            self._session.latency_s = lag.latency_s
        return LagSoFar(lag.latency_s, 0.5 * (high - low))
