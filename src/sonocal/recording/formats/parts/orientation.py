"""Image orientations, brought to one: u right, v down, which PLUS calls MF.

PLUS names where each stored axis points, seen from the transducer: M(arked) or U(nmarked) side, F(ar)
from it or N(ear), A(scending) or D(escending) elevation. Two letters describe an image, three a volume;
the third is often given for images too. Flips are the first cause of calibration errors above 5 mm:
nothing is flipped silently, `image_from_file` says what was done.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sonocal.errors import FormatError
from sonocal.geometry import Array
from sonocal.recording.frames import Frames, Image, MappedFrames

__all__ = ["Orientation", "image_from_file", "oriented"]

# letter: (axis of the MFA image that the stored axis runs along, direction)
AXES = {"M": (0, 1), "U": (0, -1), "F": (1, 1), "N": (1, -1), "A": (2, 1), "D": (2, -1)}
UNKNOWN = ("", "XX", "XXX")


@dataclass(frozen=True)
class Orientation:
    """Where the stored axes of an image point.

    Attributes:
        code: as the file spells it.
        axes: for each stored axis (fastest first) the MFA axis it runs along.
        signs: for each stored axis +1, or -1 where it runs against the MFA axis.
        known: False when the file does not say; the image is then taken as it is stored.
    """

    code: str
    axes: tuple[int, int, int] = (0, 1, 2)
    signs: tuple[int, int, int] = (1, 1, 1)
    known: bool = True

    @classmethod
    def parse(cls, code: str, dimension: int, name: str) -> Orientation:
        """The orientation of a code such as MF, UFA or XX.

        Args:
            code: the letters.
            dimension: 2 for images, 3 for volumes.
            name: of the file, for messages.

        Raises:
            FormatError: the letters name no orientation, or one that an image cannot have.
        """
        letters = code.strip().upper()
        if letters in UNKNOWN:
            return cls(code=letters, known=False)
        if len(letters) not in (2, 3) or any(c not in AXES for c in letters):
            raise _refusal(name, code)
        axes = [AXES[c] for c in letters]
        if len(axes) == 2:
            axes.append(_third(axes))
        order = tuple(axis for axis, _ in axes)
        if sorted(order) != [0, 1, 2] or (dimension == 2 and order[2] != 2):
            raise _refusal(name, code)
        return cls(letters, order, tuple(sign for _, sign in axes))  # type: ignore[arg-type]

    def changes(self, dimension: int) -> bool:
        """Whether pixels move on the way to MF."""
        return self.axes[:dimension] != (0, 1, 2)[:dimension] or -1 in self.signs[:dimension]

    def reorder(self, values: Sequence[float]) -> tuple[float, ...]:
        """Values of the stored axes (sizes, spacings), in the order of the MF axes."""
        return tuple(values[self.axes.index(k)] for k in range(len(values)))


def image_from_file(orientation: Orientation, size_px: Sequence[int]) -> Array:
    """(4, 4): pixels of the MF image from pixels as stored.

    Args:
        orientation: of the stored image.
        size_px: (2,) or (3,), of the MF image.
    """
    matrix = np.zeros((4, 4))
    matrix[3, 3] = 1.0
    for stored, (axis, sign) in enumerate(zip(orientation.axes, orientation.signs, strict=True)):
        if stored >= len(size_px):  # an image has no extent out of its plane to be mirrored in
            matrix[axis, stored] = 1.0
            continue
        matrix[axis, stored] = sign
        matrix[axis, 3] = size_px[axis] - 1 if sign < 0 else 0
    return matrix


def oriented(frames: Frames, orientation: Orientation, dimension: int) -> Frames:
    """The frames with their axes brought to MF."""
    if not orientation.changes(dimension):
        return frames

    def turn(frame: Image) -> Image:
        # Array axes run slowest first: stored axis k is array axis dimension - 1 - k.
        flips = tuple(dimension - 1 - k for k in range(dimension) if orientation.signs[k] < 0)
        order = [dimension - 1 - orientation.axes.index(dimension - 1 - k) for k in range(dimension)]
        return np.flip(frame, flips).transpose(*order, *range(dimension, frame.ndim))

    stored = frames.shape[:dimension][::-1]
    shape = tuple(int(n) for n in orientation.reorder(stored)[::-1]) + frames.shape[dimension:]
    return MappedFrames(frames, turn, shape)


def _third(axes: Sequence[tuple[int, int]]) -> tuple[int, int]:
    """The third axis of two letters: the one that makes a right-handed frame, as PLUS defines it."""
    first, second = (np.eye(3)[axis] * sign for axis, sign in axes)
    normal = np.cross(first, second)
    axis = int(np.argmax(np.abs(normal)))
    return axis, int(np.sign(normal[axis]))


def _refusal(name: str, code: str) -> FormatError:
    return FormatError(
        f"{name}: image orientation {code!r} is none; it has one letter of M/U, one of F/N and perhaps one of "
        "A/D, such as MF or UFA, or is XX where it is not known"
    )
