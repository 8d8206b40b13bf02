"""Compressed pieces of bags."""

import bz2
import struct
import tracemalloc
from importlib import import_module

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonocal import FormatError, SonocalError, UnsupportedError
from sonocal.recording.formats import read_recording
from sonocal.recording.formats.parts.unpack import DECODERS, unpack


def packed(compression, data):
    if compression == "bz2":
        return bz2.compress(data)
    if compression == "zstd":
        zstd = pytest.importorskip("rosbags.rosbag2.storage_mcap", reason="rosbags is not installed").zstd
        return zstd.compress(data)
    pytest.importorskip("lz4.frame", reason="lz4 is not installed")
    return import_module("lz4.frame").compress(data)


@pytest.mark.parametrize("compression", DECODERS)
@given(data=st.binary(min_size=1, max_size=3000), repeats=st.integers(1, 2000))
def test_a_piece_comes_back_whole_or_not_at_all(compression, data, repeats):
    whole = data * repeats
    content = packed(compression, whole)
    assert unpack("a.bag", compression, content) == whole
    for damaged in (content[: len(content) // 2], content + b"more", content[:-1]):
        with pytest.raises(FormatError, match=r"a\.bag: a compressed piece of it "):
            unpack("a.bag", compression, damaged)
    with pytest.raises(FormatError, match="holds more than the"):
        unpack("a.bag", compression, content, len(whole) - 1)


@pytest.mark.parametrize("compression", DECODERS)
def test_a_piece_that_grows_without_end_is_let_go(compression):
    content = packed(compression, bytes(200 << 20))
    tracemalloc.start()
    with pytest.raises(FormatError, match="holds more than the 1048576 bytes that it may have"):
        unpack("a.bag", compression, content, 1 << 20)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 8 << 20


def test_other_compressions_are_named():
    with pytest.raises(UnsupportedError, match="is compressed by 'xz'; bags have none, lz4, zstd or bz2"):
        unpack("a.bag", "xz", b"")


@pytest.mark.parametrize("stated", [10, 100 << 20, 1 << 40])
def test_a_chunk_that_is_not_what_it_states_is_refused_before_a_library_unpacks_it(tmp_path, stated):
    data = packed("zstd", bytes(200 << 20))
    magic = b"\x89MCAP0\r\n"
    chunk = struct.pack("<QQQII4sQ", 0, 0, stated, 0, 4, b"zstd", len(data)) + data
    header, footer = struct.pack("<I4sI", 4, b"ros2", 0), bytes(20)
    records = [(1, header), (6, chunk), (2, footer)]
    content = b"".join(struct.pack("<BQ", code, len(record)) + record for code, record in records)
    (tmp_path / "a.mcap").write_bytes(magic + content + magic)
    tracemalloc.start()
    with pytest.raises(SonocalError) as caught:
        read_recording(tmp_path / "a.mcap")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert "than" in str(caught.value)
    assert peak < 8 << 20
