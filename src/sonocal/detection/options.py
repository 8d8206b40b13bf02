"""How to look for a needle in images: every option, checked once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from sonocal.errors import InputError
from sonocal.geometry.shown import brief

__all__ = ["CENTRES", "Centre", "DetectionOptions"]

Centre = Literal["head", "mass"]
CENTRES: tuple[Centre, ...] = ("head", "mass")
MOST = 10_000  # more candidates than an image has places for


@dataclass(frozen=True, eq=False)
class DetectionOptions:
    """What to look for, and where; None: what suits the recording.

    Attributes:
        count: detections an image at the most; default: 5, and 3 in a volume.
        mask: of images, (rows, columns): True where to look; default: found from the recording.
        centre: of a bright spot of an image: "head", its first echo without the tail (needles, the default), or
            "mass", all of it (wires, as PLUS does).

    Raises:
        InputError: an option means nothing.
    """

    count: int | None = None
    mask: NDArray[np.bool_] | None = None
    centre: Centre | None = None

    __repr__ = brief

    def __post_init__(self) -> None:
        check_detection_options(self.count, self.mask, self.centre)


def check_detection_options(count: Any, mask: Any, centre: Any) -> None:
    """Refuse options that mean nothing.

    Raises:
        InputError: one does; the sentence names it and says what arrived.
    """
    whole = isinstance(count, (int, np.integer)) and not isinstance(count, bool)
    if count is not None and not (whole and 1 <= count <= MOST):
        raise InputError(f"count must be a whole number of candidates, 1 or more; got {count!r}")
    if mask is not None:
        if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_ or mask.ndim != 2:
            arrived = f"{mask.dtype} of shape {mask.shape}" if isinstance(mask, np.ndarray) else repr(mask)
            raise InputError(
                f"mask must be an array (rows, columns) of booleans, True where to look; got {arrived}"
            )
        if not mask.any():
            raise InputError("the mask hides the whole image; give another one")
    if centre is not None and not (isinstance(centre, str) and centre in CENTRES):
        raise InputError(f"centre must be one of {', '.join(CENTRES)}; got {centre!r}")
