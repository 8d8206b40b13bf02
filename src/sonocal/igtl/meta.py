"""What a message of version 2 carries beside its content: an identity, and texts by key."""

from __future__ import annotations

import struct
from collections.abc import Mapping

from sonocal.errors import FormatError, InputError
from sonocal.igtl.fields import take, text_bytes, text_of

__all__ = ["extended", "split"]

_EXTENDED = struct.Struct(">HHII")
_ENTRY = struct.Struct(">HHI")
MOST_ENTRIES = (1 << 16) - 1
MOST_VALUE = (1 << 32) - 1


def split(body: memoryview, where: str) -> tuple[memoryview, dict[str, str], int]:
    """A body of version 2 as its content, its texts by key and its identity.

    Raises:
        FormatError: the lengths that it states do not add up.
    """
    begin, index_bytes, text_size, identity = take("HHII", body, where)
    end = len(body) - index_bytes - text_size
    if begin < _EXTENDED.size or end < begin:
        raise FormatError(
            f"{where}: an extended header of {begin} bytes and meta data of {index_bytes} + {text_size} bytes "
            f"do not fit into the body of {len(body)}; see what sends it"
        )
    index, texts = body[end : end + index_bytes], body[end + index_bytes :]
    return body[begin:end], _entries(index, texts, where), identity


def _entries(index: memoryview, texts: memoryview, where: str) -> dict[str, str]:
    if not len(index) and not len(texts):
        return {}
    (count,) = take("H", index, where)
    if len(index) != 2 + count * _ENTRY.size:
        raise FormatError(
            f"{where}: {count} entries of meta data take {2 + count * _ENTRY.size} bytes of index, "
            f"{len(index)} are there; see what sends it"
        )
    found, at = {}, 0
    for key_bytes, encoding, value_bytes in _ENTRY.iter_unpack(index[2:]):
        middle, end = at + key_bytes, at + key_bytes + value_bytes
        if end > len(texts):
            raise FormatError(
                f"{where}: meta data are {len(texts)} bytes, its index asks for {end}; see what sends it"
            )
        found[text_of(texts[at:middle], 0)] = text_of(texts[middle:end], encoding)
        at = end
    return found


def extended(meta: Mapping[str, str], identity: int) -> tuple[bytes, bytes]:
    """What stands before and behind the content in a body of version 2."""
    if len(meta) > MOST_ENTRIES:
        raise InputError(f"a message carries at most {MOST_ENTRIES} entries of meta data; got {len(meta)}")
    index, texts = [struct.pack(">H", len(meta))], []
    for key, value in meta.items():
        _, name = text_bytes(key, MOST_ENTRIES, "a key of meta data")
        encoding, field = text_bytes(value, MOST_VALUE, f"the meta data {key[:40]!r}")
        index.append(_ENTRY.pack(len(name), encoding, len(field)))
        texts += [name, field]
    sizes = sum(map(len, index)), sum(map(len, texts))
    return _EXTENDED.pack(_EXTENDED.size, *_fitting(*sizes), identity), b"".join(index + texts)


def _fitting(index_bytes: int, text_size: int) -> tuple[int, int]:
    if index_bytes > MOST_ENTRIES or text_size > MOST_VALUE:
        raise InputError(
            f"meta data of {index_bytes} + {text_size} bytes are more than a message can say; send fewer"
        )
    return index_bytes, text_size
