"""ROS bags of every kind, written by rosbags."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

TF, STAMPED, POSE = (
    "tf2_msgs/msg/TFMessage",
    "geometry_msgs/msg/TransformStamped",
    "geometry_msgs/msg/PoseStamped",
)
IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
FORMS = (
    "1",
    "1 lz4",
    "1 bz2",
    "sqlite3",
    "mcap",
    "mcap zstd",
    "sqlite3 message",
    "mcap file",
    "sqlite3 file",
)


class Messages:
    """Makes messages of one ROS version."""

    def __init__(self, ros1):
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        self.ros1 = ros1
        self.store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.LATEST)
        if ros1:
            transforms = "geometry_msgs/TransformStamped[] transforms"
            self.store.register(get_types_from_msg(transforms, TF))
            self.store.register(get_types_from_msg(transforms, "tf/msg/tfMessage"))

    def make(self, kind, **fields):
        return self.store.types[kind](**fields)

    def header(self, frame, time):
        sec = int(np.floor(time))
        stamp = self.make("builtin_interfaces/msg/Time", sec=sec, nanosec=round((time - sec) * 1e9))
        return self.make(
            "std_msgs/msg/Header", **({"seq": 0} if self.ros1 else {}), stamp=stamp, frame_id=frame
        )

    def parts(self, matrix):
        """The place, m, and the turn of a pose in mm."""
        x, y, z, w = Rotation.from_matrix(matrix[:3, :3]).as_quat()
        return dict(zip("xyz", matrix[:3, 3] / 1000, strict=True)), {"x": x, "y": y, "z": z, "w": w}

    def stamped(self, parent, child, time, matrix):
        place, turn = self.parts(matrix)
        return self.make(
            STAMPED,
            header=self.header(parent, time),
            child_frame_id=child,
            transform=self.make(
                "geometry_msgs/msg/Transform",
                translation=self.make("geometry_msgs/msg/Vector3", **place),
                rotation=self.make("geometry_msgs/msg/Quaternion", **turn),
            ),
        )

    def tf(self, *stamped, kind=TF):
        return self.make(kind, transforms=list(stamped))

    def pose(self, parent, time, matrix):
        place, turn = self.parts(matrix)
        pose = self.make(
            "geometry_msgs/msg/Pose",
            position=self.make("geometry_msgs/msg/Point", **place),
            orientation=self.make("geometry_msgs/msg/Quaternion", **turn),
        )
        return self.make(POSE, header=self.header(parent, time), pose=pose)

    def image(self, time, pixels, encoding, padding=0, big=False):
        pixels = pixels.astype(pixels.dtype.newbyteorder(">" if big else "<"))
        rows = np.ascontiguousarray(pixels).view("u1").reshape(len(pixels), -1)
        rows = np.pad(rows, ((0, 0), (0, padding)))
        return self.make(
            IMAGE,
            header=self.header("us", time),
            height=len(pixels),
            width=pixels.shape[1],
            encoding=encoding,
            is_bigendian=int(big),
            step=rows.shape[1],
            data=rows.ravel(),
        )

    def compressed(self, time, data, form="jpeg"):
        return self.make(
            COMPRESSED, header=self.header("us", time), format=form, data=np.frombuffer(data, dtype="u1")
        )

    def encode(self, message, kind):
        return (
            self.store.serialize_ros1(message, kind) if self.ros1 else self.store.serialize_cdr(message, kind)
        )


def small_sweep(messages):
    """Three images of a probe that moves in a frame that does not."""
    entries = [("/tf_static", TF, 0.5, messages.tf(messages.stamped("base", "tracker", 0.0, np.eye(4))))]
    for i in range(1, 4):
        pose = np.eye(4)
        pose[0, 3] = i
        entries.append(("/tf", TF, i, messages.tf(messages.stamped("tracker", "probe", i, pose))))
        pixels = np.full((3, 4), i, dtype="uint8")
        entries.append(("/us", IMAGE, i + 0.5, messages.image(i, pixels, "mono8")))
    return entries


def messages_for(form):
    pytest.importorskip("rosbags", reason="rosbags is not installed")
    return Messages(form.startswith("1"))


def write_bag(path, form, messages, entries):
    """Write ``(topic, kind, received s, message)`` as one of `FORMS`; the path that is to be read."""
    kind, _, how = form.partition(" ")
    writer = _writer_1(path, how) if kind == "1" else _writer_2(path, kind, how)
    with writer:
        connections = {}
        for topic, type_name, received, message in entries:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, type_name, typestore=messages.store)
            data = messages.encode(message, type_name)
            writer.write(connections[topic], round(received * 1e9), data)
    return next(path.glob("*.mcap" if kind == "mcap" else "*.db3")) if how == "file" else path


def _writer_1(path, how):
    from rosbags.rosbag1 import Writer

    writer = Writer(path)
    if how:
        writer.set_compression(Writer.CompressionFormat[how.upper()])
    return writer


def _writer_2(path, kind, how):
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    writer = Writer(path, version=9, storage_plugin=StoragePlugin[kind.upper()])
    if how in ("zstd", "message"):
        mode = CompressionMode.STORAGE if how == "zstd" else CompressionMode.MESSAGE
        writer.set_compression(mode, CompressionFormat.ZSTD)
    return writer
