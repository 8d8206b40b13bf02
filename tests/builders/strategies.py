"""Recordings as hypothesis draws them: ordinary ones, and ones whose names and numbers are hostile."""

import numpy as np
from hypothesis import strategies as st

from sonocal.recording import ArrayFrames, ImageGeometry, Poses, Recording
from tests.builders.recordings import random_pixels

TYPES = ("uint8", "int8", "uint16", "int16", "uint32", "int32", "uint64", "int64", "float32", "float64")
SIZES = (None, (1, 1), (7, 4), (5, 4, 3), (2, 1, 2))
WORDS = st.from_regex(r"[A-Za-z][A-Za-z0-9_]{0,11}", fullmatch=True)
# Neither "To" nor "Status", which mean something in names of fields.
FRAMES = st.from_regex(r"[A-SU-Z][a-np-z0-9]{0,5}", fullmatch=True)
LINES = st.text(st.characters(codec="utf-8", exclude_characters="\r\n\0"), max_size=12)
SPECIAL = (
    *(
        "=",
        ":",
        "#note",
        "a=b",
        "a:b",
        " ends ",
        "NDims",
        "type",
        "Seq_Frame0000_x",
        "Timestamp",
    ),
    *(
        "two\nlines",
        "a\rb",
        "a\0b",
        "\udcff",
        "",
        "ultrasound image orientation",
        "ToToTracker",
        "ImageStatus",
    ),
    *("XToYTransform", "XToYTransformStatus", "kinds", "ElementDataFile", "\u2028", "\x85x", "ß", "1st", "-"),
)
HOSTILE = st.one_of(st.sampled_from(SPECIAL), st.text(max_size=6), LINES)
NUMBERS = st.one_of(
    st.floats(allow_nan=False, allow_infinity=False), st.sampled_from([0.0, -0.0, 5e-324, 1e308, 0.1])
)


@st.composite
def poses(draw, n, source, target):
    """One tool: seen, marked invalid, or absent, in any order."""
    states = draw(st.lists(st.sampled_from(["OK", "INVALID", "absent", "partly"]), min_size=n, max_size=n))
    matrices = np.array(draw(st.lists(NUMBERS, min_size=16 * n, max_size=16 * n))).reshape(n, 4, 4)
    for i, state in enumerate(states):
        if state in ("absent", "partly"):
            matrices[i, : 4 if state == "absent" else 1] = np.nan
    valid = np.array([state == "OK" for state in states])
    status = tuple("OK" if ok else "INVALID" for ok in valid)
    return Poses(source, target, matrices, valid, status if draw(st.booleans()) else None)


@st.composite
def recordings(draw, names=WORDS, frames=FRAMES, text=LINES):
    """A recording of 1 to 4 items; names of fields, names of frames and texts come from what is given."""
    n, size, channels = draw(st.integers(1, 4)), draw(st.sampled_from(SIZES)), draw(st.sampled_from([1, 3]))
    made = [draw(poses(n, draw(frames), draw(frames))) for _ in range(draw(st.integers(0, 2)))]
    images, geometry = ArrayFrames(np.empty((0, 0, 0), np.uint8)), None
    if size is not None:
        rng = np.random.default_rng(draw(st.integers(0, 2**32)))
        shape = (n, *size[::-1], *((channels,) if channels > 1 else ()))
        images = ArrayFrames(random_pixels(rng, shape, draw(st.sampled_from(TYPES))))
        geometry = ImageGeometry.of(
            images, len(size), draw(st.sampled_from(["MFA", "MF", "XX"][2 * (len(size) == 3) :]))
        )
    vouched = st.lists(st.booleans(), min_size=n, max_size=n)
    columns = st.lists(st.one_of(st.none(), text), min_size=n, max_size=n).map(tuple)
    return Recording(
        times=np.array(draw(st.lists(NUMBERS, min_size=n, max_size=n)))
        if draw(st.booleans())
        else np.full(n, np.nan),
        frames=images,
        poses={one.name: one for one in made},
        image=geometry,
        image_valid=np.array(draw(vouched)) & (size is not None),
        fields=draw(st.dictionaries(names, text, max_size=2)),
        item_fields=draw(st.dictionaries(names, columns, max_size=2)),
    )
