"""Where tools are: TRANSFORM, POSITION, TDATA and QTDATA."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from sonocal.errors import FormatError, InputError
from sonocal.geometry import Array
from sonocal.geometry.shown import brief
from sonocal.igtl.fields import Bytes, as_floats, floats, name_of, padded

__all__ = ["Position", "QuaternionTool", "QuaternionTools", "Tool", "Tools", "Transform"]

MOST_TOOLS = 1 << 12
"""Of a message: each takes several times its bytes once it is read."""


@dataclass(frozen=True, eq=False)
class Transform:
    """A pose.

    Attributes:
        matrix: (4, 4), mm, as it was sent: rigid or not, finite or not.
    """

    kind: ClassVar[str] = "TRANSFORM"
    matrix: Array

    __repr__ = brief

    @classmethod
    def from_bytes(cls, body: Bytes, where: str) -> Self:
        """Decoded from the content of a message."""
        return cls(_matrix(_exactly(body, 48, where)))

    def as_bytes(self) -> tuple[Bytes, ...]:
        """The content of the message."""
        return (_columns(self.matrix),)


@dataclass(frozen=True, eq=False)
class Position:
    """A place and, where it is sent, a direction.

    Attributes:
        place_mm: (3,).
        quaternion: (4,) as w, x, y, z; NaN of w where only x, y, z were sent; None where nothing was.
    """

    kind: ClassVar[str] = "POSITION"
    place_mm: Array
    quaternion: Array | None = None

    __repr__ = brief

    @classmethod
    def from_bytes(cls, body: Bytes, where: str) -> Self:
        """Decoded from the content of a message."""
        if len(body) not in (12, 24, 28):
            raise FormatError(
                f"{where}: a place has 12, 24 or 28 bytes, {len(body)} arrived; see what sends it"
            )
        turn = floats(body, (len(body) - 12) // 4, 12)
        w = turn[3:] if len(turn) == 4 else [np.nan]
        return cls(floats(body, 3), np.concatenate([w, turn[:3]]) if len(turn) else None)

    def as_bytes(self) -> tuple[Bytes, ...]:
        """The content of the message."""
        if self.quaternion is None:
            return (as_floats(self.place_mm),)
        w, *xyz = self.quaternion
        return (as_floats([*self.place_mm, *xyz, *([] if np.isnan(w) else [w])]),)


@dataclass(frozen=True, eq=False)
class Tool:
    """One tool of many that a tracker reports together.

    Attributes:
        name: at most 20 bytes.
        matrix: (4, 4), mm.
        freedom: 1 of a tracker, 2 of a tool of six degrees of freedom, 3 of a place alone, 4 of five degrees.
    """

    size: ClassVar[int] = 70
    name: str
    matrix: Array
    freedom: int = 2

    __repr__ = brief

    @classmethod
    def from_bytes(cls, body: Bytes) -> Self:
        """Decoded from its part of a message."""
        return cls(name_of(body[:20]), _matrix(body[22:]), body[20])

    def as_bytes(self) -> bytes:
        """Its part of the message."""
        return _tool_head(self.name, self.freedom) + _columns(self.matrix)


@dataclass(frozen=True, eq=False)
class QuaternionTool:
    """The same as a place (3,) in mm and a quaternion (4,) as w, x, y, z."""

    size: ClassVar[int] = 50
    name: str
    place_mm: Array
    quaternion: Array
    freedom: int = 2

    __repr__ = brief

    @classmethod
    def from_bytes(cls, body: Bytes) -> Self:
        """Decoded from its part of a message."""
        numbers = floats(body, 7, 22)
        return cls(name_of(body[:20]), numbers[:3], numbers[[6, 3, 4, 5]], body[20])

    def as_bytes(self) -> bytes:
        """Its part of the message."""
        w, *xyz = self.quaternion
        return _tool_head(self.name, self.freedom) + as_floats([*self.place_mm, *xyz, w])


@dataclass(frozen=True)
class Tools:
    """All tools of a tracker at one time."""

    kind: ClassVar[str] = "TDATA"
    tools: tuple[Tool, ...]

    __repr__ = brief

    @classmethod
    def from_bytes(cls, body: Bytes, where: str) -> Self:
        """Decoded from the content of a message."""
        return cls(tuple(Tool.from_bytes(part) for part in _parts(body, Tool.size, where)))

    def as_bytes(self) -> tuple[Bytes, ...]:
        """The content of the message."""
        return (b"".join(tool.as_bytes() for tool in self.tools),)


@dataclass(frozen=True)
class QuaternionTools:
    """All tools of a tracker at one time, as places and quaternions."""

    kind: ClassVar[str] = "QTDATA"
    tools: tuple[QuaternionTool, ...]

    __repr__ = brief

    @classmethod
    def from_bytes(cls, body: Bytes, where: str) -> Self:
        """Decoded from the content of a message."""
        parts = _parts(body, QuaternionTool.size, where)
        return cls(tuple(QuaternionTool.from_bytes(part) for part in parts))

    def as_bytes(self) -> tuple[Bytes, ...]:
        """The content of the message."""
        return (b"".join(tool.as_bytes() for tool in self.tools),)


def _exactly(body: Bytes, size: int, where: str) -> Bytes:
    if len(body) != size:
        raise FormatError(f"{where}: {size} bytes are due, {len(body)} arrived; see what sends it")
    return body


def _parts(body: Bytes, size: int, where: str) -> list[Bytes]:
    if len(body) > MOST_TOOLS * size:
        raise FormatError(
            f"{where}: {len(body) // size} tools are more than the {MOST_TOOLS} that sonocal takes; see what sends it"
        )
    if len(body) % size:
        raise FormatError(
            f"{where}: tools take {size} bytes each, {len(body)} bytes arrived; see what sends it"
        )
    return [body[at : at + size] for at in range(0, len(body), size)]


def _matrix(body: Bytes) -> Array:
    """(4, 4) of its four columns without their last entries."""
    matrix = np.eye(4)
    matrix[:3] = floats(body, 12).reshape(4, 3).T
    return matrix


def _columns(matrix: Array) -> bytes:
    array = np.asarray(matrix, dtype=float)
    if array.shape != (4, 4):
        raise InputError(f"a pose to send must have shape (4, 4); got {array.shape}")
    return as_floats(array[:3].T)


def _tool_head(name: str, freedom: int) -> bytes:
    return struct.pack(">20sBx", padded(name, 20, "a tool's name"), freedom)
