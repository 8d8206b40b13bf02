"""ROS bags: version 1 (``.bag``), version 2 (a folder with ``metadata.yaml``), files of its storages (MCAP, SQLite).

Images are those of one topic, stamped by their headers; transforms in metres become poses in mm at these stamps.
A folder is read as it stands; nothing is written.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from sonocal.errors import InputError
from sonocal.files.kinds import Format, Head
from sonocal.geometry import Array
from sonocal.recording.formats.parts.bag import METADATA, STARTS, Bag
from sonocal.recording.formats.parts.bag_images import BagFrames, stamp_of
from sonocal.recording.formats.parts.bag_poses import Transforms
from sonocal.recording.model import ImageGeometry, Provenance, Recording

__all__ = ["FORMAT", "is_bag_folder", "read_rosbag"]

IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
POSES = (
    "tf2_msgs/msg/TFMessage",
    "geometry_msgs/msg/TransformStamped",
    "geometry_msgs/msg/PoseStamped",
)
SUFFIXES = (".bag", ".mcap", ".db3")
COMPRESSED = "/compressed"  # what image_transport publishes beside the images themselves
KEEP_ONE = "write one with the transforms into a bag of its own: rosbags-convert --include-topic"
MOST_NAMED = 12


def read_rosbag(path: Path) -> Recording:
    """Read a bag: it is gone through once for stamps and transforms, images are decoded when asked for.

    Raises:
        FormatError: it is no bag, or damaged.
        InputError: it has images of several topics, or neither images nor transforms; the sentence lists what it has.
        UnsupportedError: rosbags is not installed, or images are of an encoding that is not read.
    """
    transforms = Transforms(path.resolve().name)
    with Bag(path) as bag:
        topics = bag.topics
        images = _images(bag.name, topics)
        poses = [topic for topic, kind in topics.items() if kind in POSES]
        stamps, received = [], []
        for message in bag.messages([*poses, *images]):
            if message.topic in images:
                stamps.append(stamp_of(message.content.header))
                received.append(message.received)
            else:
                transforms.add(message)
    provenance = Provenance(transforms.name, "ROS bag", _files(path))
    if not images or not stamps:
        return _tracker(transforms, provenance, topics)
    frames = BagFrames(path, images[0], np.array(received, dtype=np.int64))
    times = _times(stamps)
    return Recording(
        times=times,
        frames=frames,
        poses=transforms.at(times),
        image=ImageGeometry.of(frames),
        provenance=provenance,
    )


def is_bag_folder(folder: Path) -> bool:
    """Whether a folder is a bag of ROS 2."""
    return folder.is_dir() and (folder / METADATA).is_file()


def _tracker(transforms: Transforms, provenance: Provenance, topics: Mapping[str, str]) -> Recording:
    """A recording of transforms alone."""
    times = transforms.times()
    if not len(times):
        what = "transforms that never move" if transforms.fixed else "neither images nor transforms"
        raise InputError(f"{provenance.name}: holds {what}; its topics are {_listed(topics)}")
    return Recording(times=times, poses=transforms.at(times), provenance=provenance)


def _images(name: str, topics: Mapping[str, str]) -> list[str]:
    """The one topic of images, or none."""
    found = [topic for topic, kind in topics.items() if kind in IMAGES]
    found = [
        topic
        for topic in found
        if topic.removesuffix(COMPRESSED) not in found or not topic.endswith(COMPRESSED)
    ]
    if len(found) > 1:
        listed = _listed({topic: topics[topic] for topic in found})
        raise InputError(f"{name}: holds images of {len(found)} topics, {listed}; {KEEP_ONE}")
    return found


def _listed(topics: Mapping[str, str]) -> str:
    """Topics with their types, for a message."""
    named = [f"{topic} ({kind})"[:120] for topic, kind in topics.items()][:MOST_NAMED]
    more = len(topics) - len(named)
    return (", ".join(named) or "none") + (f" and {more} more" if more else "")


def _times(stamps: list[float]) -> Array:
    """(N,) s; NaN where no header was stamped."""
    times = np.array(stamps)
    return times if times.any() else np.full(len(times), np.nan)


def _files(path: Path) -> tuple[str, ...]:
    return (
        tuple(str(one) for one in sorted(path.iterdir()) if one.is_file()) if path.is_dir() else (str(path),)
    )


def _sniff(head: Head) -> bool:
    return head.content.startswith(STARTS) or is_bag_folder(head.path)


FORMAT = Format(
    name="ROS bag",
    kind="recording",
    suffixes=SUFFIXES,
    sniff=_sniff,
    read=read_rosbag,
    holds="ROS 1; ROS 2 as a folder or a file of its storage (SQLite, MCAP): tf and tf_static, stamped "
    "transforms and poses; one topic of images, as they are or as JPEG and PNG",
    needs=("rosbags", "pillow"),
)
