"""What happens to files: bytes changed, parts cut, repeated or exchanged, numbers replaced by extreme ones."""

import re

from hypothesis import strategies as st

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
