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
from tests.builders.damage import damage
from tests.builders.readers import (
    READERS,
    sound_files,
    whole,
)

MEMORY_LIMIT = 64 << 20
# Of numbers in one file: the first ones are of the header and of every kind of column.
MOST_PLACES = 12


@pytest.mark.parametrize("name", READERS)
@settings(max_examples=15)
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


@pytest.mark.parametrize("number", [b"1e300", b"-1e300", b"1e-300", b"1e155", b"1e306"])
@pytest.mark.parametrize("name", [name for name in READERS if name != "any"])
def test_numbers_of_any_size_end_in_a_sentence(tmp_path, name, number):
    path = tmp_path / f"input{READERS[name].suffix}"
    for content in sound_files(name):
        places = [found.span() for found in re.finditer(rb"(?<![\w.])-?\d+\.\d+", content)][:MOST_PLACES]
        for start, end in places:
            path.write_bytes(content[:start] + number + content[end:])
            try:
                READERS[name].read(path)
            except SonocalError as error:
                assert "\n" not in str(error)


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
