"""A recording that is sent as PLUS sends what it acquires, with the faults of real trackers and networks on demand."""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from threading import Event

import numpy as np

from sonocal import igtl
from sonocal.errors import InputError, require
from sonocal.geometry import Array
from sonocal.geometry.shown import brief
from sonocal.recording import Poses, Recording, interpolate_poses

__all__ = ["Faults", "Replay"]

IMAGE = "Image_Reference"
"""What PLUS calls its image unless told otherwise."""
USUAL_HZ = 30.0
LOST_ITEMS = 4
"""A tool that is hidden stays so for as many items, on average."""
APART = (0.25, 0.75)
"""Of the time between two images, where poses of a stream of their own lie."""
POLL_S = 0.05


@dataclass(frozen=True)
class Faults:
    """What goes wrong on purpose.

    Attributes:
        invalid: share of poses that are lost, some in a row.
        gaps: share of images that are not sent, with their poses.
        reordered: share of messages that change places with the next one.
        say_invalid: send what is lost with the status INVALID; else it is absent, as is PLUS's default.
        seed: of all of it.

    Raises:
        InputError: a share is none.
    """

    invalid: float = 0.0
    gaps: float = 0.0
    reordered: float = 0.0
    say_invalid: bool = False
    seed: int = 0

    __repr__ = brief

    def __post_init__(self) -> None:
        for name in ("invalid", "gaps", "reordered"):
            share = getattr(self, name)
            if not (isinstance(share, (int, float)) and 0.0 <= share < 1.0):
                raise InputError(f"{name} must be a share from 0 to below 1; got {share!r}")


class Replay:
    """The messages of a recording.

    Args:
        recording: images and poses, or poses alone.
        faults: what goes wrong on purpose.
        apart: send poses as streams of their own, with stamps between those of the images.
        begin_s: what the first item is stamped, s since 1970; default: now.
    """

    def __init__(
        self,
        recording: Recording,
        faults: Faults | None = None,
        *,
        apart: bool = False,
        begin_s: float | None = None,
    ) -> None:
        require("recording", recording, Recording)
        self.recording, self.faults = recording, faults or Faults()
        self._begin_s = time.time() if begin_s is None else begin_s
        self._times = _times(recording)
        if len(recording) == 0:
            raise InputError(f"{recording.name}: is empty, there is nothing to send")
        self._chance = random.Random(self.faults.seed)
        self._streams = [_between(one, self._times) for one in recording.poses.values()] if apart else None
        self._hidden: dict[str, int] = {}

    def __repr__(self) -> str:
        return f"<Replay of {self.recording.name[:40]!r}: {len(self.recording)} items, {self.length_s:.1f} s>"

    @property
    def length_s(self) -> float:
        """How long it takes at the rate at which it was recorded."""
        times = self._times
        return float(times[-1] - times[0]) + self.interval_s

    @property
    def interval_s(self) -> float:
        """Between two items, as recorded."""
        times = self._times
        return float(np.median(np.diff(times))) if len(times) > 1 else 1.0 / USUAL_HZ

    def messages(self, index: int, turn: int = 0) -> list[igtl.Message]:
        """What is sent of an item, in order; nothing in a gap.

        Args:
            index: of the item.
            turn: how often the recording was played before.
        """
        recording = self.recording
        if self._chance.random() < self.faults.gaps:
            return []
        at_s = float(self._times[index] - self._times[0]) + turn * self.length_s
        stamp = self._stamp(at_s)
        sent = list(self._poses_apart(index, at_s)) if self._streams is not None else []
        if recording.image is not None and recording.image_valid[index]:
            sent.append(igtl.Message(igtl.Image.of(np.asarray(recording.frames[index])), IMAGE, stamp))
        if self._streams is None:
            for one in recording.poses.values():
                pose = one.matrices[index] if one.valid[index] else None
                sent += self._pose(one, pose, stamp)
        return sent

    def run(
        self,
        server: igtl.Server,
        stop: Event,
        *,
        rate_hz: float | None = None,
        loop: bool = False,
        on_item: Callable[[int], None] | None = None,
        answer: Callable[[igtl.Arrival], igtl.Message | None] | None = None,
    ) -> int:
        """Send the recording to whoever is connected, from the moment that somebody is.

        Args:
            server: that listens.
            stop: ends it.
            rate_hz: items a second; default: as recorded.
            loop: begin again at the end.
            on_item: called with how many items were sent.
            answer: what to reply to a message; default: that all is well, to who asks.

        Returns:
            How many items were sent.
        """
        while not stop.is_set() and not server.wait_for_peer(POLL_S):
            pass
        begin_s, sent, waiting = time.monotonic(), 0, list[igtl.Message]()
        for due_s, messages in self._timed(rate_hz, loop):
            while (left_s := begin_s + due_s - time.monotonic()) > 0 and not stop.wait(min(left_s, POLL_S)):
                _reply(server, answer or usual_answer)
            if stop.is_set():
                break
            _reply(server, answer or usual_answer)
            waiting = self._sent(server, waiting + messages)
            sent += 1
            if on_item is not None:
                on_item(sent)
        for message in waiting:
            server.send(message)
        return sent

    def _timed(self, rate_hz: float | None, loop: bool) -> Iterator[tuple[float, list[igtl.Message]]]:
        turn, count = 0, len(self.recording)
        while True:
            for index in range(count):
                as_recorded_s = float(self._times[index] - self._times[0]) + turn * self.length_s
                due_s = as_recorded_s if rate_hz is None else (turn * count + index) / rate_hz
                yield due_s, self.messages(index, turn)
            turn += 1
            if not loop:
                return

    def _sent(self, server: igtl.Server, messages: list[igtl.Message]) -> list[igtl.Message]:
        """Send messages, some in another order; what is left waits for those that follow."""
        if self.faults.reordered:
            for i in range(len(messages) - 1):
                if self._chance.random() < self.faults.reordered:
                    messages[i], messages[i + 1] = messages[i + 1], messages[i]
        now = messages[:-1] if self.faults.reordered else messages
        for message in now:
            server.send(message)
        return messages[len(now) :]

    def _pose(self, one: Poses, pose: Array | None, stamp: int) -> Iterator[igtl.Message]:
        hidden = self._hidden.get(one.name, 0)
        if hidden == 0 and self._chance.random() < self.faults.invalid / LOST_ITEMS:
            hidden = self._chance.randint(1, 2 * LOST_ITEMS - 1)
        self._hidden[one.name] = max(hidden - 1, 0)
        if pose is not None and not hidden:
            yield igtl.Message(igtl.Transform(pose), one.plus_name, stamp, meta={"TransformStatus": "OK"})
        elif self.faults.say_invalid:
            status = {"TransformStatus": "INVALID"}
            yield igtl.Message(igtl.Transform(np.eye(4)), one.plus_name, stamp, meta=status)

    def _poses_apart(self, index: int, at_s: float) -> Iterator[igtl.Message]:
        assert self._streams is not None
        for k in range(index * len(APART), (index + 1) * len(APART)):
            for times, poses in self._streams:
                if k < len(poses):
                    shift_s = float(times[k] - self._times[index])
                    pose = poses.matrices[k] if poses.valid[k] else None
                    yield from self._pose(poses, pose, self._stamp(at_s + shift_s))

    def _stamp(self, at_s: float) -> int:
        return igtl.stamp_of(self._begin_s) + round(at_s * (1 << 32))


def usual_answer(arrival: igtl.Arrival) -> igtl.Message | None:
    """That all is well, to who asks how it is."""
    if arrival.message.kind == "GET_STATUS":
        return igtl.Message(igtl.Status(1), arrival.message.device)
    return None


def _reply(server: igtl.Server, answer: Callable[[igtl.Arrival], igtl.Message | None]) -> None:
    for arrival in server.take(0.0):
        if (said := answer(arrival)) is not None:
            arrival.peer.send(said)


def _times(recording: Recording) -> Array:
    """When items were taken, s; at the usual rate where the recording does not know, or its clock ran backwards."""
    times = recording.times
    if np.isfinite(times).all() and (np.diff(times) > 0).all():
        return times
    return np.arange(len(recording)) / USUAL_HZ


def _between(poses: Poses, times: Array) -> tuple[Array, Poses]:
    """A tool's poses at times between those of the images."""
    if len(times) < 2:
        return times, poses
    at = (times[:-1, None] + np.diff(times)[:, None] * np.array(APART)).reshape(-1)
    return at, interpolate_poses(poses, times, at, max_gap_s=np.inf, on_invalid="skip")
