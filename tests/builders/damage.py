"""What happens to files: bytes changed, parts cut, repeated or exchanged, numbers replaced by extreme ones."""

import re
import struct

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
    b"1e300",
    b"-1e-300",
    b"",
]
BINARY = [
    *(struct.pack(form, x) for form in ("<f", "<d", ">f", ">d") for x in (float("nan"), float("inf"), -1.0)),
    *(struct.pack(form, 1e300) for form in ("<d", ">d")),
    *(bytes([x]) * size for x in (0, 255) for size in (1, 2, 4, 8)),
    *(b"\x7f" + b"\xff" * (size - 1) for size in (2, 4, 8)),
    *(b"\xff" * (size - 1) + b"\x7f" for size in (2, 4, 8)),
    *(
        (1 << shift).to_bytes(size, order)
        for size in (2, 4, 8)
        for shift in (0, 8 * size - 9)
        for order in ("little", "big")
    ),
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


def binary_number(data, a, b):
    """A number as programs store it, at a place of its size."""
    number = BINARY[b % len(BINARY)]
    i = a % len(data) // len(number) * len(number)
    return data[:i] + number + data[i + len(number) :]


def exchange(data, a, b):
    """Two pieces of one length stand in each other's place: tags of DICOM, columns of a table."""
    size = 1 + (a ^ b) % 12
    i, j = sorted((a % len(data), b % len(data)))
    if i + size > j or j + size > len(data):
        return data
    return data[:i] + data[j : j + size] + data[i + size : j] + data[i : i + size] + data[j + size :]


def exchange_words(data, a, b):
    """Two words stand in each other's place: names of columns, keys, tags of XML."""
    places = [m.span() for m in re.finditer(rb"[A-Za-z_]\w+", data[:4000])]
    if not places:
        return data
    (i, i_end), (j, j_end) = sorted((places[a % len(places)], places[b % len(places)]))
    if i == j:
        return data
    return data[:i] + data[j:j_end] + data[i_end:j] + data[i:i_end] + data[j_end:]


KINDS = [
    flip,
    cut,
    drop,
    repeat_line,
    drop_line,
    extreme_number,
    extreme_number,
    empty_value,
    binary_number,
    binary_number,
    exchange,
    exchange_words,
]
