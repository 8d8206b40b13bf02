"""Messages of OpenIGTLink: one or more of every type, as values and as bytes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sonocal import igtl
from sonocal.igtl.fields import checksum

REFERENCES = Path(__file__).parent.parent.parent.parent / "shared" / "data" / "igtl"
TYPES = ["i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8"]


def pose(seed=0):
    """A rigid matrix (4, 4) whose numbers fit into four bytes each."""
    turn, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    matrix = np.eye(4)
    matrix[:3, :3] = turn * np.linalg.det(turn)
    matrix[:3, 3] = [12.5, -3.25, 100.0 + seed]
    return matrix.astype(np.float32).astype(float)


def pixels(name="u1", shape=(4, 5)):
    """Numbers that differ from one another."""
    return np.arange(np.prod(shape)).reshape(shape).astype(name)


def contents():
    """One content or more of every type that sonocal looks into."""
    place, turn = np.array([1.0, 2.5, -3.0]), np.array([0.5, 0.5, -0.5, 0.5])
    parts = igtl.Image(pixels(shape=(1, 2, 3)), (5, 4, 2), (1, 2, 1), np.arange(12.0).reshape(3, 4), 2, 2)
    return [
        igtl.Transform(pose()),
        igtl.Position(place),
        igtl.Position(place, turn),
        igtl.Position(place, np.array([np.nan, 0.5, 0.5, 0.5])),
        igtl.Tools((igtl.Tool("Probe", pose(1)), igtl.Tool("Needle", pose(2), 4))),
        igtl.QuaternionTools((igtl.QuaternionTool("Probe", place, turn, 3),)),
        igtl.Text("Grüße"),
        igtl.Status(15, -10, "ACTUATOR_DISABLED", "Actuator A is disabled."),
        igtl.Capability(("IMAGE", "GET_IMAGE", "TRANSFORM")),
        igtl.Command(5, "SaveConfig", "<Command Name='SaveConfig'/>"),
        igtl.CommandReply(5, "SaveConfig", "<Result success='true'/>"),
        *(igtl.Image.of(pixels(name)) for name in TYPES),
        igtl.Image.of(pixels(shape=(2, 4, 5))),
        igtl.Image.of(pixels(shape=(2, 4, 5, 3))),
        parts,
        igtl.Start("STT_TDATA", 20, "Patient"),
        igtl.Start("STT_QTDATA", 20),
        igtl.Query("STP_TDATA"),
        igtl.Query("GET_TRANS"),
        igtl.Query("GET_IMAGE"),
        igtl.Reply("RTS_TDATA", 0),
        igtl.Other("POINT", bytes(range(20))),
    ]


def messages():
    """Every content in a message of each version."""
    meta = {"TransformStatus": "OK", "IGTL_DEVICE_NAME": "A probe with a name over twenty bytes"}
    return [
        igtl.Message(content, "ProbeToTracker", igtl.stamp_of(1.6e9 + 0.25), version, texts, identity)
        for content in contents()
        for version, texts, identity in ((1, {}, 0), (2, {}, 7), (2, meta, 2**32 - 1))
    ]


def as_sent(message):
    """The bytes of a message in one piece."""
    return b"".join(igtl.encode(message))


def with_crc(data):
    """Bytes of a message whose header is given the length and the checksum of what follows it."""
    head, body = data[: igtl.HEADER_BYTES], data[igtl.HEADER_BYTES :]
    if len(head) < igtl.HEADER_BYTES:
        return data
    return head[:42] + len(body).to_bytes(8, "big") + checksum(body).to_bytes(8, "big") + body
