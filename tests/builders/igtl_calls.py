"""Damaged messages of OpenIGTLink, for `scripts/fuzz_calls.py`: each is decoded, or refused in a sentence."""

from __future__ import annotations

import random
from functools import lru_cache
from typing import Any

import sonocal as sc
from sonocal import igtl
from tests.builders.damage import KINDS
from tests.builders.messages import REFERENCES, as_sent, messages, with_crc

STEPS = (1, 1, 1, 2, 2, 4, 8)
# How many of a hundred get the length and checksum that their damaged body should have: others end at the door.
MENDED = 90


@lru_cache
def sound() -> dict[str, list[bytes]]:
    """Sound messages by type, those of the reference among them where they are there."""
    found: dict[str, list[bytes]] = {}
    references = [path.read_bytes() for path in sorted(REFERENCES.glob("*.bin"))]
    for data in [*map(as_sent, messages()), *references]:
        found.setdefault(igtl.decode(data).kind, []).append(data)
    return found


CALLS = sound()


def call(_: Any, seed: int, number: int, name: str) -> bool:
    """Decode one damaged message; whether it was answered. What is answered can be sent again."""
    try:
        message = igtl.decode(content_of(name, random.Random(f"{seed} {number} {name}")))
    except sc.SonocalError as error:
        assert str(error).strip(), f"message {number} of {name} is refused without a word"
        assert "\n" not in str(error), f"message {number} of {name}: {error}"
        return False
    _ = message.valid, message.stamp_s, repr(message)
    sent_again(message)
    return True


def content_of(name: str, chance: random.Random) -> bytes:
    """A sound message, damaged in a few places."""
    content = chance.choice(sound()[name])
    for _ in range(chance.choice(STEPS)):
        if content:
            content = chance.choice(KINDS)(content, chance.randrange(10**6), chance.randrange(10**6))
    return with_crc(content) if chance.randrange(100) < MENDED else content


def sent_again(message: igtl.Message) -> None:
    """What was decoded is encoded, and decoded to the same bytes again; texts that were no texts may be refused."""
    try:
        data = as_sent(message)
    except sc.InputError:
        return
    assert as_sent(igtl.decode(data)) == data


def missing(_: Any) -> set[str]:
    """Nothing: the types are those of `messages`."""
    return set()
