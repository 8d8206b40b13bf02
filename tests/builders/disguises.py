"""A true matrix in each of the usual disguises: what its file holds, and how it is read."""

import numpy as np

from sonocal.existing.choice import Choice, chosen
from sonocal.existing.matrix import Matrices, checked

SIZE = (640, 480)
LPS = np.diag([-1.0, -1.0, 1.0, 1.0])
INVERSE = np.linalg.inv


def parts(linear=None, translation=1.0):
    """A disguise of the 3 x 3 part and of the translation, apart."""

    def changed(matrix):
        made = matrix.copy()
        made[:3, :3] = matrix[:3, :3] if linear is None else linear(matrix[:3, :3])
        made[:3, 3] *= translation
        return made

    return changed


def rows_by(factor):
    return lambda matrix: np.diag([factor] * 3 + [1.0]) @ matrix


def flipped(*axes):
    flip = np.eye(4)
    for axis in axes:
        flip[axis, axis], flip[axis, 3] = -1, SIZE[axis] - 1
    return lambda matrix: matrix @ flip


def rigid(matrix):
    return parts(lambda linear: linear / np.cbrt(np.linalg.det(linear)))(matrix)


# What a file holds of the true matrix, how it was read, what is said of it, and what programs are told.
DISGUISES = {
    "inverse": (INVERSE, "direct", "give --stored-as inverse", "inverse"),
    "direct, read as inverse": (lambda m: m, "inverse", "give --stored-as direct", "direct"),
    "slicer": (lambda m: INVERSE(LPS @ m @ LPS), "direct", "give --stored-as slicer", "slicer"),
    "slicer, read as inverse": (
        lambda m: INVERSE(LPS @ m @ LPS),
        "inverse",
        "give --stored-as slicer",
        "slicer",
    ),
    "direct, read as slicer": (lambda m: m, "slicer", "give --stored-as direct", "direct"),
    "inverse, read as slicer": (INVERSE, "slicer", "give --stored-as inverse", "inverse"),
    "LPS": (lambda m: LPS @ m @ LPS, "direct", "is in LPS axes instead of RAS, of image and marker", "lps"),
    "LPS, read as slicer": (lambda m: LPS @ m @ LPS, "slicer", "is in LPS axes instead of RAS", "lps"),
    "marker in LPS": (lambda m: LPS @ m, "direct", "has the marker's axes in LPS", "marker-lps"),
    "image in LPS": (lambda m: m @ LPS, "direct", "has the image's axes in LPS", "image-lps"),
    "inverse of the marker in LPS": (
        lambda m: INVERSE(LPS @ m),
        "direct",
        "give --stored-as inverse",
        "inverse+marker-lps",
    ),
    "metres": (rows_by(1e-3), "direct", "is in metres instead of mm", "metres"),
    "centimetres": (rows_by(1e-1), "direct", "is in centimetres instead of mm", "centimetres"),
    "inverse, in metres": (
        lambda m: INVERSE(rows_by(1e-3)(m)),
        "direct",
        "and is in metres",
        "inverse+metres",
    ),
    "translation in metres": (
        parts(translation=1e-3),
        "direct",
        "has its translation in metres",
        "translation-metres",
    ),
    "translation in cm": (
        parts(translation=1e-1),
        "direct",
        "has its translation in centimetres",
        "translation-centimetres",
    ),
    "rotation transposed": (
        parts(np.transpose),
        "direct",
        "has its rotation transposed",
        "rotation-transposed",
    ),
    "u and v exchanged": (lambda m: m[:, [1, 0, 2, 3]], "direct", "u and v are exchanged", "u-v-exchanged"),
    "u mirrored": (flipped(0), "direct", "mirrored along u", "u-mirrored"),
    "v mirrored": (flipped(1), "direct", "mirrored along v", "v-mirrored"),
    "half a turn": (flipped(0, 1), "direct", "turned by half a turn", "half-turn"),
    "px for mm": (rigid, "direct", "takes pixels for mm", "px-for-mm"),
    "px for mm, as Slicer stores it": (
        lambda m: INVERSE(LPS @ rigid(m) @ LPS),
        "direct",
        "give --stored-as slicer, and multiply",
        "slicer+px-for-mm",
    ),
}
# Those by which the matrix is for images that run otherwise.
OF_IMAGES = {"u and v exchanged", "u mirrored", "v mirrored", "half a turn"}


def as_read(content, form):
    """A file's matrix, read as somebody or its format says."""
    matrices = Matrices("a.txt", "4 x 4", (checked("a.txt", content),))
    return chosen(matrices, Choice(stored_as=form))
