"""Whatever is in a file, its reader gives a recording or a SonocalError, in bounded memory.

Sound small files of every format are damaged in the ways files get damaged (and attacked): bytes changed,
parts cut, repeated or exchanged, numbers replaced by extreme ones. Python cannot count the time and memory of
a single example portably, so the tests bound what a reader may allocate: no more than a little beside its file.
"""

import re
import tracemalloc

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sonocal import SonocalError
from tests.builders.readers import (
    READERS,
    sound_files,
    whole,
)

MEMORY_LIMIT = 64 << 20
NUMBERS = [
    b"0",
    b"-1",
    b"1e999",
    b"nan",
    b"99999999999999999999",
    b"4294967295",
    b"2147483648",
    b"0.5",
    b"1000000",
    b"\xff",
]


@st.composite
def damage(draw):
    """A function that damages bytes, a few times."""
    steps = draw(
        st.lists(
            st.tuples(st.sampled_from(KINDS), st.integers(0, 10**6), st.integers(0, 10**6)),
            min_size=1,
            max_size=4,
        )
    )

    def apply(data):
        for kind, a, b in steps:
            data = kind(data, a, b) if data else data
        return data

    return apply


def flip(data, a, b):
    i = a % len(data)
    return data[:i] + bytes([data[i] ^ (1 + b % 255)]) + data[i + 1 :]


def cut(data, a, b):
    return data[: a % len(data)]


def drop(data, a, b):
    i = a % len(data)
    return data[:i] + data[i + 1 + b % 40 :]


def repeat_line(data, a, b):
    lines = data.splitlines(keepends=True)
    i, j = a % len(lines), b % len(lines)
    return b"".join([*lines[:i], lines[j], *lines[i:]])


def drop_line(data, a, b):
    lines = data.splitlines(keepends=True)
    return b"".join(line for i, line in enumerate(lines) if i != a % len(lines))


def extreme_number(data, a, b):
    places = [m.span() for m in re.finditer(rb"-?\d+(?:\.\d+)?", data[:4000])]
    if not places:
        return data
    start, end = places[a % len(places)]
    return data[:start] + NUMBERS[b % len(NUMBERS)] + data[end:]


def empty_value(data, a, b):
    places = [m.span(1) for m in re.finditer(rb"[=:,](.*)$", data[:4000], flags=re.M)]
    if not places:
        return data
    start, end = places[a % len(places)]
    return data[:start] + data[end:]


KINDS = [flip, cut, drop, repeat_line, drop_line, extreme_number, extreme_number, empty_value]


@pytest.mark.parametrize("name", READERS)
@settings(max_examples=150)
@given(data=st.data(), change=damage())
def test_damaged_files_end_in_a_sentence(tmp_path_factory, name, data, change):
    content = data.draw(st.sampled_from(sound_files(name)))
    path = tmp_path_factory.mktemp("damaged") / f"input{READERS[name].suffix}"
    path.write_bytes(change(content))
    bounded(READERS[name].read, path)


@settings(max_examples=100)
@given(
    content=st.binary(max_size=300),
    name=st.sampled_from(sorted(READERS)),
    start=st.sampled_from(
        [
            b"",
            b"NRRD0005\n",
            b"ObjectType = Image\n",
            b"\0" * 128 + b"DICM",
            b"Format Version,1.2\n",
            b"\0\0\0 ftyp",
            b"\x89PNG\r\n\x1a\n",
        ]
    ),
)
def test_any_bytes_end_in_a_sentence(tmp_path_factory, content, name, start):
    path = tmp_path_factory.mktemp("any") / f"input{READERS[name].suffix}"
    path.write_bytes(start + content)
    for read in (READERS[name].read, whole):
        bounded(read, path)


def bounded(reader, path):
    tracemalloc.start()
    try:
        reader(path)
    except SonocalError as error:
        sentence = str(error)
        assert "\n" not in sentence
        assert sentence
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert peak < MEMORY_LIMIT
