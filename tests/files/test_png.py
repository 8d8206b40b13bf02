"""Pillow reads our pictures as we made them."""

import io

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonocal.files.png import png


@given(rows=st.integers(1, 20), columns=st.integers(1, 20), colour=st.booleans(), seed=st.integers(0, 2**32))
def test_pillow_reads_every_pixel(rows, columns, colour, seed):
    pillow = pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    shape = (rows, columns, 3) if colour else (rows, columns)
    pixels = np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)
    with pillow.open(io.BytesIO(png(pixels))) as image:
        assert image.mode == ("RGB" if colour else "L")
        np.testing.assert_array_equal(np.asarray(image), pixels)
