"""What is looked at in an MCAP file before a library trusts it: its records, chunks and summary."""

from __future__ import annotations

from collections import deque
from pathlib import Path
from typing import Any, BinaryIO

from sonocal.errors import FormatError, UnsupportedError
from sonocal.recording.formats.parts.bounded_file import BoundedFile
from sonocal.recording.formats.parts.unpack import PIECE_LIMIT, pieces

__all__ = ["MCAP", "check_mcap_chunks", "check_mcap_summary"]

MCAP = b"\x89MCAP0\r\n"
CHUNK, CHUNK_FIXED = 0x06, 40
ROS2 = "ros2"


def check_mcap_chunks(path: Path) -> set[int]:
    """Look through an MCAP file before a library trusts what it states, and decompress every chunk once.

    Returns:
        Where its chunks lie.

    Raises:
        FormatError: it was cut short, or a chunk is not what it states.
        UnsupportedError: its messages are not those of ROS 2.
    """
    chunks = set()
    with BoundedFile(path) as file:
        end = file.seek(0, 2)
        _check_profile(path.name, file)
        place = file.seek(len(MCAP))
        while place < end - len(MCAP):
            head = file.read(9)
            size = int.from_bytes(head[1:], "little")
            if len(head) < 9 or size > end - file.tell():
                raise FormatError(
                    f"{path.name}: ends within a record at byte {place}: it was cut short, or its recorder was "
                    "stopped; mend it with mcap recover"
                )
            if head[0] == CHUNK:
                chunks.add(place)
                _check_chunk(path.name, file, size)
            place = file.seek(place + 9 + size)
    return chunks


def _check_profile(name: str, file: BinaryIO) -> None:
    """Refuse messages that are not those of ROS 2, as the first record says."""
    file.seek(len(MCAP) + 9)
    letters = min(int.from_bytes(file.read(4), "little"), 64)
    profile = file.read(letters).decode("latin-1")
    if profile != ROS2:
        raise UnsupportedError(
            f"{name}: is MCAP of the profile {profile!r}; {ROS2!r} is read, such as rosbags-convert writes it"
        )


def _check_chunk(name: str, file: BinaryIO, size: int) -> None:
    fixed = file.read(32)
    stated, letters = int.from_bytes(fixed[16:24], "little"), int.from_bytes(fixed[28:32], "little")
    if size < CHUNK_FIXED or letters > min(size - CHUNK_FIXED, 64) or stated > PIECE_LIMIT:
        raise FormatError(
            f"{name}: a chunk states {stated} bytes; those of recorders have less than {PIECE_LIMIT}"
        )
    compression = file.read(letters).decode("latin-1")
    length = int.from_bytes(file.read(8), "little")
    if length > size - CHUNK_FIXED - letters:
        raise FormatError(f"{name}: a chunk states more bytes than it has; copy it again")
    if compression:
        deque(pieces(name, compression, file.read(length), stated), maxlen=0)  # and none of it is kept


def check_mcap_summary(storage: Any, chunks: set[int]) -> None:
    """Refuse a summary that names other chunks than those looked at, or ones that would all be held at once.

    Messages come in the order of time: chunks whose times overlap are unpacked together.

    Args:
        storage: of rosbags, open; those of other files pass.
        chunks: where the chunks lie.

    Raises:
        FormatError: it does.
    """
    stated = list(getattr(storage, "chunks", ()))
    places = {chunk.chunk_start_offset for chunk in stated}
    if len(places) < len(stated) or not places <= chunks:
        raise FormatError(
            f"{storage.path.name}: its summary names chunks that are not there; mend it with mcap recover"
        )
    starts = [(chunk.message_start_time, chunk.uncompressed_size) for chunk in stated]
    ends = [(chunk.message_end_time + 1, -chunk.uncompressed_size) for chunk in stated]
    held = 0
    for _, size in sorted(starts + ends):
        held += size
        if held > PIECE_LIMIT:
            raise FormatError(
                f"{storage.path.name}: its chunks overlap in time by more than {PIECE_LIMIT} bytes; write it in the "
                "order of time with mcap sort"
            )
