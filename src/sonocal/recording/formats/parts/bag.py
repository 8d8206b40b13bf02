"""Open ROS bags: what topics they have and what messages, by rosbags, with every failure turned into one sentence.

Messages are decoded by the definitions that rosbags brings, not by those in the file: these would become code.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple, Self

from sonocal.errors import FormatError, InputError, SonocalError, UnsupportedError
from sonocal.files import file_size, read_at, reading
from sonocal.recording.formats.parts.bounded_file import BoundedFile, BoundedPath
from sonocal.recording.formats.parts.mcap import MCAP, check_mcap_chunks, check_mcap_summary
from sonocal.recording.formats.parts.packages import needed
from sonocal.recording.formats.parts.unpack import unpack

__all__ = ["METADATA", "STARTS", "Bag", "Message"]

METADATA = "metadata.yaml"
METADATA_LIMIT = 4 << 20
BAG1, SQLITE = b"#ROSBAG V", b"SQLite format 3\0"
STARTS = (BAG1, SQLITE, MCAP)
# A bag of version 1 is read once by its index, and then by its chunks.
INDEX_READS = 3
LONGEST_MESSAGE = 1 << 28
LAST_NS = (1 << 63) - 1
TF = "tf2_msgs/msg/TFMessage"
SAME_AS = {"tf/msg/tfMessage": TF}


class Message(NamedTuple):
    """A message of a bag.

    Attributes:
        topic: such as "/tf".
        received: ns, when it was recorded.
        content: with the fields of its type.
    """

    topic: str
    received: int
    content: Any


class Bag:
    """A bag that is open within a ``with``.

    Args:
        path: a bag of ROS 1, the folder of one of ROS 2, or a file of its storage (MCAP, SQLite).

    Raises:
        FormatError: it is none, or is damaged.
        UnsupportedError: rosbags is not installed, or the bag is of a kind that is not read.
    """

    def __init__(self, path: Path) -> None:
        self._path, self.name = path, path.resolve().name
        self._folder = path.is_dir()
        self._start = b"" if self._folder else read_at(path, 0, 16)
        needed("rosbags", path, "ROS bags need rosbags")
        self._packed = False

    def __enter__(self) -> Self:
        with self._guarded():
            self._reader = self._opened()
        return self

    def __exit__(self, *_: object) -> None:
        with self._guarded():
            self._reader.close()

    @property
    def topics(self) -> dict[str, str]:
        """The types of the messages by topic that has any, such as ``{"/tf": "tf2_msgs/msg/TFMessage"}``."""
        return {
            str(one.topic): SAME_AS.get(one.msgtype, str(one.msgtype))
            for one in self._reader.connections
            if one.msgcount
        }

    def messages(self, topics: Sequence[str], start: int | None = None) -> Iterator[Message]:
        """The messages of some topics in the order they were recorded, one at a time.

        Args:
            topics: which.
            start: ns: none that was recorded before.

        Raises:
            FormatError: the bag is damaged, or a message is not of its topic's type.
        """
        chosen = [one for one in self._reader.connections if one.topic in topics]
        if not chosen:
            return
        kinds = {topic: kind for topic, kind in self.topics.items() if topic in topics}
        with self._guarded():
            for connection, received, data in self._reader.messages(chosen, start):
                self._check_kind(connection, kinds)
                content = self._decoded(bytes(data), connection.msgtype)
                yield Message(connection.topic, min(received, LAST_NS), content)

    def _check_kind(self, connection: Any, kinds: dict[str, str]) -> None:
        """Refuse messages with the fields of another type: an index may list a topic twice, or another's messages."""
        if kinds.get(connection.topic) != SAME_AS.get(connection.msgtype, connection.msgtype):
            raise FormatError(
                f"{self.name}: {connection.topic[:80]} holds messages of two types; it is damaged, copy it again"
            )

    def _decoded(self, data: bytes, kind: str) -> Any:
        store = _definitions(self._start.startswith(BAG1))
        if self._packed:
            data = unpack(self.name, "zstd", data, LONGEST_MESSAGE)
        decode = store.deserialize_ros1 if self._start.startswith(BAG1) else store.deserialize_cdr
        return decode(data, SAME_AS.get(kind, kind))

    def _opened(self) -> Any:
        if self._start.startswith(BAG1):
            return _opened_1(self._path)
        from rosbags.rosbag2 import Reader

        plugins = Reader.STORAGE_PLUGINS
        if self._folder:
            self._packed, chunks = _check_folder(self._path, self.name)
            return _opened_folder(plugins["dir"], self._path, chunks)
        if self._start.startswith(MCAP):
            return _opened_mcap(plugins[".mcap"], self._path)
        if self._start.startswith(SQLITE):
            return _opened_sqlite(plugins[".db3"], self._path)
        raise FormatError(f"{self.name}: does not start as a ROS bag does; record or copy it again")

    @contextmanager
    def _guarded(self) -> Iterator[None]:
        try:
            yield
        except SonocalError:
            raise
        except Exception as error:  # rosbags raises many kinds for damaged files
            reason = " ".join(str(error).replace(str(self._path), self.name).split())[:100]
            raise FormatError(
                f"{self.name}: cannot be read as a ROS bag ({reason or type(error).__name__}); "
                "copy it again, or mend it with ros2 bag reindex or rosbag reindex"
            ) from None


def _opened_1(path: Path) -> Any:
    from rosbags.rosbag1 import Reader
    from rosbags.rosbag1.reader import decompressors

    class Bounded(BoundedPath):
        def open(self, mode: str = "r", *_: Any, **__: Any) -> Any:
            return BoundedFile(self, INDEX_READS * file_size(self) + (1 << 16))

    reader = Reader(Bounded(path))
    reader.open()
    names = {function: name for name, function in decompressors.items()}
    for place, chunk in reader.chunks.items():
        bounded = partial(unpack, path.name, names[chunk.decompressor])
        reader.chunks[place] = chunk._replace(decompressor=bounded)
    if reader.bio is not None:
        reader.bio.allowance = None  # type: ignore[attr-defined]
    return reader


def _opened_folder(plugin: Any, path: Path, chunks: dict[str, set[int]]) -> Any:
    """A folder's reader that leaves its messages compressed: it would decompress them without bounds."""
    reader = plugin(BoundedPath(path))
    reader.open()
    reader.metadata = reader.metadata._replace(compression_mode=None)
    for storage in reader.storages:
        _bound(storage)
        check_mcap_summary(storage, chunks.get(storage.path.name, set()))
    return reader


def _opened_mcap(plugin: Any, path: Path) -> Any:
    chunks = check_mcap_chunks(path)
    reader = plugin(BoundedPath(path))
    reader.open()
    check_mcap_summary(reader, chunks)
    return reader


def _opened_sqlite(plugin: Any, path: Path) -> Any:
    if set("?#%") & set(str(path)):
        raise InputError(f"{path}: SQLite cannot open a name with ?, # or %; rename it")
    _check_sqlite(path)
    reader = plugin(path)
    reader.open()
    _bound(reader)
    return reader


def _check_sqlite(path: Path) -> None:
    """Refuse a database that is shorter than it says: SQLite tells only where it reads what is missing."""
    head = read_at(path, 0, 100)
    page, count = int.from_bytes(head[16:18], "big"), int.from_bytes(head[28:32], "big")
    counted = head[24:28] == head[92:96]  # by the program that wrote last
    stated = count * (1 << 16 if page == 1 else page)
    if len(head) < 100 or (counted and file_size(path) < stated):
        raise FormatError(
            f"{path.name}: holds {file_size(path)} bytes of the {stated} that it states: it was cut short"
        )


def _bound(storage: Any) -> None:
    """Hold the values that SQLite may give to what a message may have."""
    if (database := getattr(storage, "dbconn", None)) is not None:
        import apsw

        database.limit(apsw.SQLITE_LIMIT_LENGTH, LONGEST_MESSAGE)


def _check_folder(path: Path, name: str) -> tuple[bool, dict[str, set[int]]]:
    """Look through the files of a bag before rosbags opens them.

    Returns:
        Whether its messages are compressed, and where the chunks of each MCAP file lie.

    Raises:
        FormatError: one is damaged.
        UnsupportedError: whole files are compressed.
    """
    from ruamel.yaml import YAML

    about = path / METADATA
    if file_size(about) > METADATA_LIMIT:
        raise FormatError(f"{name}: its {METADATA} is larger than any recorder writes")
    with reading(about):
        stated = YAML(typ="safe").load(about.read_text(encoding="utf-8"))["rosbag2_bagfile_information"]
    mode = str(stated.get("compression_mode") or "none").lower()
    if mode not in ("none", "message"):
        raise UnsupportedError(
            f"{name}: its files are compressed whole; write it plain with ros2 bag convert"
        )
    files = [one for one in path.iterdir() if one.is_file()]
    for one in files:
        if read_at(one, 0, len(SQLITE)) == SQLITE:
            _check_sqlite(one)
    mcaps = [one for one in files if read_at(one, 0, len(MCAP)) == MCAP]
    return mode == "message", {one.name: check_mcap_chunks(one) for one in mcaps}


@lru_cache
def _definitions(ros1: bool) -> Any:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.LATEST)
    if ros1:
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF))
    return store
