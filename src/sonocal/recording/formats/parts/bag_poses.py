"""Transforms in the messages of bags: trees of tf, stamped transforms and poses, in metres."""

from __future__ import annotations

import re
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sonocal.errors import InputError
from sonocal.geometry import Array
from sonocal.recording.formats.parts.bag import Message
from sonocal.recording.formats.parts.bag_images import stamp_of
from sonocal.recording.formats.parts.layout import COUNT_LIMIT
from sonocal.recording.poses import Poses, by_name, poses_from_quaternions
from sonocal.recording.timing import interpolate_poses

__all__ = ["Transforms"]

MM_PER_M = 1000.0
WORLD = "Tracker"  # the frame of a pose whose header names none, as in tables
# What the last part of a topic says of its messages, and not of whose they are.
PLAIN_WORDS = ("pose", "measured_cp", "transform", "transform_stamped", "pose_stamped")
MATRIX_BYTES = 128
POSES_LIMIT = 1 << 30
"""Most that the poses of a bag may take, bytes: twenty tools for more than an hour at 100 Hz."""
STATIC = "tf_static"


@dataclass
class Transforms:
    """Transforms as they are met in a bag, each with the stamp of its header.

    Attributes:
        name: of the bag, for messages.
        moving: (source, target) -> 8 numbers each: stamp, s; quaternion, w first; place, mm.
        fixed: the same of what holds for all times.
    """

    name: str
    moving: dict[tuple[str, str], array[float]] = field(default_factory=dict)
    fixed: dict[tuple[str, str], array[float]] = field(default_factory=dict)

    def add(self, message: Message) -> None:
        """Take the transforms of a message: target_from_source, which ROS calls parent and child."""
        topic, content = message.topic, message.content
        if hasattr(content, "transforms"):
            place = self.fixed if topic.rsplit("/", 1)[-1] == STATIC else self.moving
            for one in content.transforms:
                _keep(place, one, one.child_frame_id, one.transform.rotation, one.transform.translation)
        elif hasattr(content, "transform"):
            child = content.child_frame_id or _thing(topic)
            _keep(self.moving, content, child, content.transform.rotation, content.transform.translation)
        else:
            _keep(self.moving, content, _thing(topic), content.pose.orientation, content.pose.position)

    def times(self) -> Array:
        """(N,) s: every instant at which something was measured, where no images say which are wanted."""
        return np.unique(np.concatenate([_rows(one)[:, 0] for one in self.moving.values()] or [np.empty(0)]))

    def at(self, times: Array) -> dict[str, Poses]:
        """The poses at some times, by name.

        Raises:
            InputError: their stamps and the times do not overlap, or there are too many.
        """
        self._check_size(len(times))
        self._check_overlap(times)
        constant = {edge: one for edge, one in self.fixed.items() if edge not in self.moving}
        return by_name([*self._moved(times), *self._constant(constant, len(times))], self.name)

    def _moved(self, times: Array) -> Iterator[Poses]:
        for (source, target), numbers in self.moving.items():
            rows = _rows(numbers)
            stamps, first = np.unique(rows[:, 0], return_index=True)  # repeated ones are copies
            one = self._poses(source, target, rows[first])
            yield interpolate_poses(one, stamps, times, source=self.name)

    def _constant(self, fixed: dict[tuple[str, str], array[float]], count: int) -> Iterator[Poses]:
        for (source, target), numbers in fixed.items():
            one = self._poses(source, target, _rows(numbers)[-1:])
            yield Poses(
                source,
                target,
                np.broadcast_to(one.matrices[0], (count, 4, 4)),
                np.broadcast_to(one.valid[0], (count,)),
            )

    def _poses(self, source: str, target: str, rows: Array) -> Poses:
        quaternions = rows[:, 1:5].copy()
        quaternions[~quaternions.any(axis=1)] = np.nan  # all zero: a driver's "not seen"
        return poses_from_quaternions(quaternions, rows[:, 5:], source, target, self.name)

    def _check_size(self, count: int) -> None:
        if count > COUNT_LIMIT or count * len(self.moving) * MATRIX_BYTES > POSES_LIMIT:
            raise InputError(
                f"{self.name}: has {len(self.moving)} transforms at {count} instants, more than are read; "
                "take the topics that are needed with rosbags-convert --include-topic"
            )

    def _check_overlap(self, times: Array) -> None:
        stamps = self.times()
        if not len(stamps):
            return
        if np.isnan(times).any():
            raise InputError(
                f"{self.name}: the headers of its images have no stamps, so poses cannot be joined to them; "
                "record with a driver that stamps images"
            )
        if times.max() < stamps[0] or times.min() > stamps[-1]:
            raise InputError(
                f"{self.name}: its images span {times.min():.3f} to {times.max():.3f} s and its transforms "
                f"{stamps[0]:.3f} to {stamps[-1]:.3f} s: they do not overlap; bring both to one clock"
            )


def _keep(place: dict[tuple[str, str], array[float]], stamped: Any, child: str, turn: Any, at: Any) -> None:
    edge = _frame(child), _frame(stamped.header.frame_id) or WORLD
    numbers = place.setdefault(edge, array("d"))
    numbers.extend((stamp_of(stamped.header), turn.w, turn.x, turn.y, turn.z))
    numbers.extend(MM_PER_M * value for value in (at.x, at.y, at.z))


def _rows(numbers: Sequence[float]) -> Array:
    return np.array(numbers, dtype=float).reshape(-1, 8)


def _frame(name: str) -> str:
    """A frame's name as PLUS could write it: ``camera/tip-1`` is ``Camera_tip_1``; case has no meaning in look-ups."""
    words = re.sub(r"\W+", "_", name.strip("/ "))
    return words[:1].upper() + words[1:]


def _thing(topic: str) -> str:
    """What a topic is of: ``probe`` of ``/ndi/probe/pose``."""
    *_, last = [part for part in topic.split("/") if part and part not in PLAIN_WORDS] or [topic]
    return last
