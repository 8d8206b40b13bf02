"""Random tables of sightings with every column that one can have, names as people write them."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

from sonocal import Observations

# Commas, quotes, line ends, other scripts: what spreadsheets put into cells. No blanks around, those are no part of
# a name; no NUL, which no text file holds.
NAMES = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=8).map(str.strip)
NAME_LISTS = st.lists(NAMES, min_size=1, max_size=4)
SPECIAL = np.array([0.1, -0.0, 1e-300, 5e-324, 999_999_999.9999999, 1 / 3, -999_999_999.0, 12345678.90123])


def random_table(seed, *, dimension=2, count=8, names=("needle",), splits=("",), sigmas=True, extra=None):
    """A table whose numbers have all their digits, some at the ends of what a double holds.

    Args:
        seed: of everything random.
        dimension: 2 or 3.
        count: rows.
        names: of targets, drawn from.
        splits: likewise.
        sigmas: whether it has the two columns of noise.
        extra: further columns: a name, and what its cells are drawn from.
    """
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(count, dimension)) * 10.0 ** rng.integers(-3, 4, (count, dimension))
    segments = rng.normal(size=(count, 2, 3)) * 100
    some = min(count, len(SPECIAL))
    points[:some, 0] = SPECIAL[:some]
    return Observations(
        points_px=points,
        segments_mm=segments,
        frame=rng.integers(-(2**62), 2**62, count),
        target=rng.choice(np.array(list(names), dtype=np.str_), count),
        split=rng.choice(np.array(splits, dtype=np.str_), count),
        sigma_px=rng.uniform(1e-3, 10, count) if sigmas else None,
        sigma_mm=rng.uniform(1e-3, 10, count) if sigmas else None,
        extra={
            name: np.array([cells[i] for i in rng.integers(len(cells), size=count)], dtype=np.str_)
            for name, cells in (extra or {}).items()
        },
        source="random.csv",
        lines=np.arange(count) + 2,
    )


NUMBERS = ("points_px", "segments_mm", "frame", "sigma_px", "sigma_mm")


def assert_same_table(one, other):
    """Two tables hold the same, numbers to the last bit."""
    for name in NUMBERS:
        a, b = getattr(one, name), getattr(other, name)
        assert (a is None) == (b is None), name
        if a is not None:
            assert a.tobytes() == b.tobytes(), name
    assert one.target.tolist() == other.target.tolist()
    assert one.split.tolist() == other.split.tolist()
    assert {k: v.tolist() for k, v in one.extra.items()} == {k: v.tolist() for k, v in other.extra.items()}
