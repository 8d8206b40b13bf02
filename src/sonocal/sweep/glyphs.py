"""Numbers and a few words drawn with pixels, for pictures that need no further package."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["written"]

# Five rows of three pixels each.
GLYPHS = {
    "0": "111101101101111",
    "1": "010110010010111",
    "2": "111001111100111",
    "3": "111001111001111",
    "4": "101101111001001",
    "5": "111100111001111",
    "6": "111100111101111",
    "7": "111001010010010",
    "8": "111101111101111",
    "9": "111101111001111",
    "B": "110101110101110",
    "C": "011100100100011",
    "E": "111100110100111",
    "H": "101101111101101",
    "N": "110101101101101",
    "O": "010101101101010",
    "R": "110101110101101",
    "S": "011100010001110",
    "T": "111010010010010",
}
GLYPH_PX = 2
"""How many pixels of the picture one of a glyph takes."""


def written(text: str) -> NDArray[np.bool_]:
    """Text as a mask (rows, columns), with a pixel of margin around."""
    glyphs = [np.array([*GLYPHS[letter]], dtype=np.uint8).reshape(5, 3) for letter in text]
    line = np.pad(np.hstack([np.pad(glyph, ((1, 1), (1, 0))) for glyph in glyphs]), ((0, 0), (0, 1)))
    return np.kron(line, np.ones((GLYPH_PX, GLYPH_PX), dtype=np.uint8)).astype(bool)
