"""A desk that follows a live session: its moments are told as they pass, and at the end its recording is opened."""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable

from sonocal.errors import InputError
from sonocal.studio.desk import Desk
from sonocal.studio.feed import Feed
from sonocal.studio.told import refusal_told
from sonocal.studio.work import Work

__all__ = ["Following"]

EACH_S = 0.25


class Following:
    """Tells a desk of a live session until that ends.

    Args:
        desk: that listens; what it is told are messages of the kinds "work", "live" and "answer".
        feed: the session.
        recorded: opens what was recorded, once it ended.
    """

    def __init__(self, desk: Desk, feed: Feed, recorded: Callable[[], Work]) -> None:
        self.desk, self.feed = desk, feed
        self._recorded, self._closing = recorded, False
        self._thread = threading.Thread(target=self._run, name="follows", daemon=True)
        self._thread.start()

    @property
    def goes_on(self) -> bool:
        """Whether what comes is still taken in, or looked into."""
        return self._thread.is_alive()

    def end(self, why: str = "asked to on the page") -> None:
        """Take nothing in any more; what was recorded is put on the desk."""
        self.feed.stop(why)

    def close(self) -> None:
        """End, and leave what was recorded on the disk."""
        self._closing = True
        self.end("the studio ends")
        self._thread.join()

    def refuse_while_it_goes_on(self) -> None:
        """Refuse to put anything else on the desk.

        Raises:
            InputError: what comes is still taken in.
        """
        if self.goes_on:
            raise InputError("a scan is being recorded; end it first (Q), and open another recording then")

    def _run(self) -> None:
        try:
            self._follow()
        except Exception:  # the recording is there all the same
            traceback.print_exc()
        try:
            self.feed.close()
        except Exception as bug:  # of its threads
            traceback.print_exc()
            self.desk.tell("work", {"phase": "refused", "refused": refusal_told(bug)})
        if not self._closing:
            self.desk.put(self._recorded)

    def _follow(self) -> None:
        about, fits, ended = None, 0, False
        while not ended:
            ended = self.feed.running.wait(EACH_S)
            if about != (about := self.feed.about):
                self.desk.tell("work", {"phase": "live", **about, "folder": str(self.desk.folder)})
            moment = self.feed.moment()
            self.desk.tell("live", moment)
            if moment["fits"] != fits:
                fits = moment["fits"]
                told = self.feed.answer()
                if told is not None:
                    self.desk.tell("answer", {"revision": fits, "touched": False, **told})
