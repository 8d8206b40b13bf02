"""A live calibration: messages become items, items a recording and an answer, in two threads."""

from __future__ import annotations

import re
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace

from sonocal import igtl
from sonocal.detection import Detections
from sonocal.errors import InputError
from sonocal.files.closing import Closing
from sonocal.live.answers import Advice, Answers
from sonocal.live.clock import TICKS
from sonocal.live.pairing import Pairing
from sonocal.live.state import State, ToolSeen
from sonocal.live.track import BEFORE_ALL
from sonocal.sweep import CandidateCalibration, Session

__all__ = ["GREETING", "Live"]

GREETING = (igtl.Message(igtl.Query("GET_STATUS"), "sonocal", version=2),)
"""Of version 2, so that servers answer in it: with whole names, and what a tracker thinks of its poses."""
TAKE_S = 0.02
QUIET_S = 1.0
ASK_S = 1.0
TRACKING_MS = 20
SEEN_S = 0.5
MOST_SAID = 50


class Live(Closing):
    """A session that is fed by a server.

    What arrives is recorded by one thread, and looked into by another: images that come faster than they are looked
    into wait in the recording.

    Args:
        client: connected; it stays its owner's to close, after this.
        session: whose stream keeps what comes.
        pairing: how messages become items.
        until_mm: end once the predicted error (95 %) is below this everywhere in the image.
        most_images: end behind so many; None: never.
        advice: what to do next.
        on_state: called with every `State` that follows a fit, and with the last; from a thread of its own.
    """

    def __init__(
        self,
        client: igtl.Client,
        session: Session,
        *,
        pairing: Pairing | None = None,
        until_mm: float | None = None,
        most_images: int | None = None,
        advice: Advice | None = None,
        on_state: Callable[[State], None] | None = None,
    ) -> None:
        self.client, self.session = client, session
        self.pairing = pairing or Pairing()
        self._until_mm, self._most_images, self._on_state = until_mm, most_images, on_state
        self._answers = Answers(session, advice)
        self._begin_s = time.monotonic()
        self._stopping, self._recorded, self._done = threading.Event(), threading.Event(), threading.Event()
        self._new = threading.Event()
        self._why = ""
        self._bug: BaseException | None = None
        self._said: deque[tuple[float, str]] = deque(maxlen=MOST_SAID)
        self._distinct: set[str] = set()
        self._quiet = self._asked = False
        self._threads = [
            threading.Thread(target=self._guarded, args=(run,), name=what, daemon=True)
            for run, what in ((self._record, "records"), (self._look, "looks"))
        ]
        for thread in self._threads:
            thread.start()

    def __repr__(self) -> str:
        return f"<Live: {self.pairing.images} images, {len(self.session.stream)} recorded>"

    @property
    def state(self) -> State:
        """How it stands now."""
        stream, pairing, client, now_s = self.session.stream, self.pairing, self.client, time.monotonic()
        newest = max((track.newest for track in pairing.tools.values()), default=BEFORE_ALL)
        tools = tuple(
            ToolSeen(
                *track.names,
                not self._quiet and track.newest >= newest - SEEN_S * TICKS,
                min(1.0, track.shared / max(1, pairing.images)) if not track.apart else 1.0,
            )
            for track in list(pairing.tools.values())
        )
        return replace(
            self._answers.state,
            elapsed_s=now_s - self._begin_s,
            images=pairing.images,
            recorded=len(stream),
            paired=pairing.paired,
            looked=self.session.looked,
            with_candidates=self.session.seen,
            tools=tools,
            dropped=client.dropped,
            damaged=client.damaged,
            late=pairing.late,
            connected=client.connected,
            quiet_s=client.quiet_s,
            said=tuple(self._said),
            ended=self._why if self._stopping.is_set() else "",
        )

    def wait(self, timeout_s: float) -> bool:
        """Whether it ended within the time, by itself or by `stop`."""
        return self._stopping.wait(timeout_s)

    def stop(self, why: str = "asked to") -> None:
        """Take nothing in any more; what came is still recorded and looked into."""
        self._why = self._why or why
        self._stopping.set()
        self._new.set()

    def finish(self) -> CandidateCalibration:
        """Stop, and calibrate on all that came, as `calibrate_recording` does of the recording.

        Raises:
            SonocalError: as `calibrate_recording`.
        """
        self.close()
        return self.session.finish()

    def detections(self) -> Detections:
        """Stop; what was seen in the images, for whoever calibrates the recording.

        Raises:
            InputError: there are no images.
        """
        self.close()
        return self.session.detections()

    def close(self) -> None:
        """Stop, and wait for the threads; a bug in one of them is raised here."""
        self.stop()
        for thread in self._threads:
            thread.join()
        if self._bug is not None:
            bug, self._bug = self._bug, None
            raise bug

    def _guarded(self, run: Callable[[], None]) -> None:
        try:
            run()
        except BaseException as bug:  # whoever waits for the thread raises it
            self._bug = bug
            self.stop("of a fault")
        finally:
            (self._recorded if run == self._record else self._done).set()
            self._new.set()

    def _record(self) -> None:
        stopping = False
        while not stopping:
            stopping = self._stopping.is_set()
            for message in self.client.take(0.0 if stopping else TAKE_S):
                self.pairing.add(message, time.monotonic())
            self._keep(ended=stopping)
            self._listen()

    def _keep(self, *, ended: bool) -> None:
        for item in self.pairing.items(time.monotonic(), ended=ended):
            if len(self.session.stream) == self._most_images:
                return
            try:
                self.session.stream.add(item)
            except InputError as error:
                self._say(str(error))
            self._new.set()
            if len(self.session.stream) == self._most_images:
                self.stop(f"{self._most_images} images are there")

    def _listen(self) -> None:
        """Say what went wrong, once each."""
        for sentence in [*self.client.said(), *self.pairing.said()]:
            self._say(sentence)
        quiet_s = self.client.quiet_s
        if quiet_s > QUIET_S and not self._quiet and self.client.connected:
            self._quiet = True
            self._say("nothing arrives any more; is the server still sending?", again=True)
        elif quiet_s < QUIET_S and self._quiet:
            self._quiet = False
            self._say("messages arrive again", again=True)
        if self.client.received and not self.pairing.tools and not self._asked:
            self._ask_for_tracking()

    def _ask_for_tracking(self) -> None:
        """Some trackers send only once they are asked to."""
        if time.monotonic() - self._begin_s < ASK_S:
            return
        self._asked = True
        self._say("no pose has arrived yet: asked the server for its tools")
        try:
            self.client.send(igtl.Message(igtl.Start("STT_TDATA", TRACKING_MS), "sonocal", version=2))
        except InputError as error:
            self._say(str(error))

    def _say(self, sentence: str, *, again: bool = False) -> None:
        kind = re.sub(r"\d+", "#", sentence)
        if again or kind not in self._distinct or sentence.endswith(("connected again", "connecting again")):
            self._distinct.add(kind)
            self._said.append((time.monotonic() - self._begin_s, sentence))

    def _look(self) -> None:
        answers, session = self._answers, self.session
        while True:
            self._new.clear()
            ended = self._recorded.is_set()
            while session.look():
                if not self._stopping.is_set() and answers.is_due():
                    self._fit()
            if ended:
                break
            if not self._stopping.is_set() and answers.is_due():
                self._fit()
            self._new.wait(TAKE_S * 5)
        self._tell()

    def _fit(self) -> None:
        answers = self._answers
        answers.fit()
        answers.advise(self.state)
        self._tell()
        if self._until_mm is not None and answers.state.is_below(self._until_mm):
            self.stop(f"the predicted error is below {self._until_mm:g} mm")

    def _tell(self) -> None:
        if self._on_state is not None:
            self._on_state(self.state)
