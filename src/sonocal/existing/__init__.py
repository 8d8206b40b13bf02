"""Calibrations that others made: a matrix from whatever holds one, what it means, and what it is worth on a sweep.

The counterpart of `sonocal.export`. A new format is a file here that ends with its `FORMAT`, and a line in
`formats.FORMATS`. What a matrix is worth is in `sonocal.existing.worth`, which is imported where it is asked for.
"""

from sonocal.existing.choice import Choice
from sonocal.existing.formats import matrices_in, read_existing
from sonocal.existing.matrix import Existing, Matrices, Stored
from sonocal.existing.meaning import Meaning, meaning_of

__all__ = [
    "Choice",
    "Existing",
    "Matrices",
    "Meaning",
    "Stored",
    "matrices_in",
    "meaning_of",
    "read_existing",
]
