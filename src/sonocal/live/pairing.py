"""From messages to items: an image, and every tool's pose for the same instant."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from numpy.typing import NDArray

from sonocal import igtl
from sonocal.geometry import Array
from sonocal.live.clock import TICKS, Clock
from sonocal.live.parts import Whole
from sonocal.live.poses import pixels_of, poses_in
from sonocal.live.track import BEFORE_ALL, Track
from sonocal.recording import Item

__all__ = ["Pairing"]

NEWER = 2
"""Images behind one that end the wait for its poses: so much out of order is put in order."""
WAIT_S = 0.5
"""By the clock, where nothing follows."""
MOST_TOOLS = 40


@dataclass
class _Frame:
    came_s: float
    image: NDArray[Any] | None = None
    poses: dict[tuple[str, str], Array | None] = field(default_factory=dict)


class Pairing:
    """Pairs images with poses.

    Messages of one frame share a stamp. A tool whose stamps are no image's is a stream of its own, and its pose is
    found between the two around the image. A pose is never used again: what is not there is lost.

    Args:
        image: whose images are taken, where several devices send some; "" for the first that comes.
        latency_s: how much later the tracker stamps an instant than the images do, of streams of their own.

    Attributes:
        images: how many came.
        paired: how many of them got a pose of every tool that was ever seen.
        late: how many messages came when their frame was done.
        tools: by name, such as ("Probe", "Tracker").
        apart: whether poses were taken from streams of their own.
    """

    def __init__(self, image: str = "", latency_s: float = 0.0) -> None:
        self.images = self.paired = self.late = 0
        self.tools: dict[tuple[str, str], Track] = {}
        self.apart = False
        self._device, self._others = image, set[str]()
        self._latency = int(latency_s * TICKS)
        self._clock = Clock()
        self._whole = Whole()
        self._frames: dict[int, _Frame] = {}
        self._done = BEFORE_ALL
        self._ready: list[Item] = []
        self._said: list[str] = []
        self._spelt: dict[tuple[str, str], tuple[str, str]] = {}

    def __repr__(self) -> str:
        return f"<Pairing: {self.images} images, {self.paired} with every pose, {len(self.tools)} tools>"

    def add(self, message: igtl.Message, now_s: float) -> None:
        """Take in a message that came now, by a clock of this machine that never goes back, s."""
        if isinstance(message.content, igtl.Image):
            self._add_image(message, message.content, now_s)
            return
        poses = [(track, pose) for names, pose in poses_in(message) if (track := self._track(names))]
        if not poses:
            return
        at, frame = self._frame(message, now_s)
        for track, pose in poses:
            track.add(at, pose)
            if frame is not None:
                frame.poses[track.names] = pose

    def _add_image(self, message: igtl.Message, image: igtl.Image, now_s: float) -> None:
        whole = None if self._is_other(message.name) else self._whole.taken(image)
        if whole is None:
            return
        self.images += 1
        frame = self._frame(message, now_s)[1]
        if frame is not None:
            frame.image = pixels_of(whole)

    def items(self, now_s: float, *, ended: bool = False) -> list[Item]:
        """The items that are done, in order; all of them once nothing follows."""
        self._close_done(now_s, ended=ended)
        ready, self._ready = self._ready, []
        return ready

    def said(self) -> list[str]:
        """What was wrong since the last time, a sentence each."""
        said, self._said = [*self._clock.said(), *self._whole.said(), *self._said], []
        return said

    def _frame(self, message: igtl.Message, now_s: float) -> tuple[int, _Frame | None]:
        """When a message was taken, and the frame that it belongs to; None where that is done."""
        at = self._clock.ticks(message, now_s)
        if self._clock.jumped:
            self._close_done(now_s, ended=True)
            for track in self.tools.values():
                track.clear()
        if at <= self._done:
            self.late += 1
            return at, None
        return at, self._frames.setdefault(at, _Frame(now_s))

    def _close_done(self, now_s: float, *, ended: bool) -> None:
        """Close the frames for which nothing more is waited for."""
        stamps = sorted(self._frames)
        images = [at for at in stamps if self._frames[at].image is not None]
        for at in stamps:
            newer = sum(one > at for one in images[-NEWER:])
            waited = now_s - self._frames[at].came_s > WAIT_S
            if not (ended or waited or (newer >= NEWER and self._bridged(at))):
                break
            self._close(at, self._frames.pop(at))

    def _track(self, names: tuple[str, str]) -> Track | None:
        # One spelling a tool: recordings take names that differ in capitals alone for one.
        names = self._spelt.setdefault((names[0].lower(), names[1].lower()), names)
        if names not in self.tools:
            if len(self.tools) >= MOST_TOOLS:
                self._once(f"more than {MOST_TOOLS} tools are sent; the others are left out")
                return None
            self.tools[names] = Track(names)
        return self.tools[names]

    def _is_other(self, device: str) -> bool:
        self._device = self._device or device
        if device == self._device:
            return False
        if device not in self._others and len(self._others) < MOST_TOOLS:
            self._others.add(device)
            self._said.append(
                f"images of {device[:60]!r} arrive beside those of {self._device[:60]!r}, which are taken; say with "
                "--image which you mean"
            )
        return True

    def _once(self, sentence: str) -> None:
        if sentence not in self._others:
            self._others.add(sentence)
            self._said.append(sentence)

    def _bridged(self, at: int) -> bool:
        """Whether streams of their own have gone beyond an image."""
        beyond = at + self._latency
        return self._frames[at].image is None or all(
            track.newest >= beyond for track in self.tools.values() if track.is_stream_at(at)
        )

    def _close(self, at: int, frame: _Frame) -> None:
        self._done = at
        for names in frame.poses:
            track = self.tools[names]
            track.shared += frame.image is not None
            track.alone += frame.image is None
        if frame.image is None:
            return
        self.apart = any(track.is_stream_at(at) for track in self.tools.values())
        poses = {names: self._pose(track, at, frame) for names, track in self.tools.items()}
        self.paired += bool(poses) and all(pose is not None for pose in poses.values())
        self._ready.append(Item(at / TICKS, poses, frame.image))

    def _pose(self, track: Track, at: int, frame: _Frame) -> Array | None:
        if self.apart and (self._latency or track.apart):
            return track.at(at + self._latency)
        return frame.poses.get(track.names)
