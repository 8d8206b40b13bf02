"""Damaged files, each given to its reader: many of every format, small and made fast, for `scripts/fuzz_calls.py`."""

from __future__ import annotations

import random
import tempfile
import warnings
from functools import lru_cache
from pathlib import Path
from typing import Any

import sonocal as sc
from tests.builders.damage import KINDS
from tests.builders.readers import READERS, sound_files

CALLS = READERS
STEPS = (1, 1, 1, 2, 2, 4, 8)
# How many of a hundred files begin as one sound file and end as another.
SPLICED = 8


def call(_: Any, seed: int, number: int, name: str) -> bool:
    """Read one damaged file; whether it was answered. A sentence is one line; anything else raised is a fault."""
    path = home() / f"input{READERS[name].suffix}"
    path.write_bytes(content_of(name, random.Random(f"{seed} {number} {name}")))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # rosbags leaves a file that it refuses to the collector.
        warnings.simplefilter("ignore", ResourceWarning)
        try:
            READERS[name].read(path)
        except sc.SonocalError as error:
            assert str(error).strip(), f"file {number} of {name} is refused without a word"
            assert "\n" not in str(error), f"file {number} of {name}: {error}"
            return False
    return True


def content_of(name: str, chance: random.Random) -> bytes:
    """A sound file of a reader, damaged in a few places; now and then grown from two."""
    content = chance.choice(sound_files(name))
    if chance.randrange(100) < SPLICED:
        content = content[: chance.randrange(len(content) + 1)]
        other = chance.choice(sound_files(name))
        content += other[chance.randrange(len(other) + 1) :]
    for _ in range(chance.choice(STEPS)):
        if content:
            content = chance.choice(KINDS)(content, chance.randrange(10**6), chance.randrange(10**6))
    return content


@lru_cache
def home() -> Path:
    """A folder for the inputs of this process; whoever started it removes it."""
    return Path(tempfile.mkdtemp(prefix="files-"))


def missing(_: Any) -> set[str]:
    """Nothing: the formats that lack sound files are what the laws of formats find."""
    return set()
