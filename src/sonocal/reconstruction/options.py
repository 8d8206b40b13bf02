"""How to make a volume of a sweep: every option, checked before the first image is decoded."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal.errors import InputError
from sonocal.geometry.shown import brief
from sonocal.reconstruction.files import Axes
from sonocal.reconstruction.grid import given_spacing
from sonocal.recording.poses import OnInvalid

__all__ = ["Compounding", "Interpolation", "Options", "Speckle", "options_of"]

Interpolation = Literal["between", "nearest", "linear"]
Compounding = Literal["mean", "maximum", "latest"]
Speckle = Literal["kept", "averaged"]
CHOICES: dict[str, Any] = {
    "interpolation": Interpolation,
    "compounding": Compounding,
    "speckle": Speckle,
    "axes": Axes,
}
LENGTHS = ("longest_gap_mm", "noise_mm", "noise_deg")
MOST_THREADS = 64


@dataclass(frozen=True)
class Options:
    """How to make a volume of a sweep.

    Attributes:
        spacing_mm: of the voxels: one length, or three along x, y and z.
        bounds_mm: (2, 3), the lowest and the highest corner; None: around all images.
        interpolation: "between": a voxel between two images is seen from where the probe was in between; "nearest":
            each pixel goes to the nearest voxel; "linear": to the eight around it, by their distances.
        compounding: of several values of one voxel: their "mean", the "maximum" or the "latest".
        speckle: between frames: "averaged" over the size of a voxel, or "kept" as single pixels show it.
        longest_gap_mm: images further apart than this are not interpolated between.
        mask: (rows, columns): True where the images show ultrasound; None: found from them.
        probe: the tool that the probe's marker is called.
        reference: the frame of the volume; None: "Reference" where it is tracked, else that of the tracker.
        fixed: constant ``(target, source) -> (4, 4)``, such as a device set's.
        on_invalid: what to do with poses marked valid that are not rigid: "raise" or "skip".
        noise_mm, noise_deg: the tracker's own noise, rms along and about each axis, for `smooth` and `error`.
        smooth: take out of the poses what of that noise their steadiness shows.
        coverage: count the values of each voxel, too.
        error: predict how far off each voxel is (95 %), too.
        axes: of a file: how other programs are to read x, y, z: "lps", as PLUS writes them, or "ras".
        threads: that share the work; the volume is the same whatever their number.
    """

    spacing_mm: Any = 0.5
    bounds_mm: ArrayLike | None = field(default=None, compare=False)
    interpolation: Interpolation = "between"
    compounding: Compounding = "mean"
    speckle: Speckle = "averaged"
    longest_gap_mm: float = 10.0
    mask: NDArray[np.bool_] | None = field(default=None, compare=False)
    probe: str = "Probe"
    reference: str | None = None
    fixed: Any = field(default=None, compare=False)
    on_invalid: OnInvalid = "raise"
    noise_mm: float = 0.0
    noise_deg: float = 0.0
    smooth: bool = False
    coverage: bool = False
    error: bool = False
    axes: Axes = "lps"
    threads: int = 1

    __repr__ = brief

    def __post_init__(self) -> None:
        given_spacing(self.spacing_mm)
        for name, choice in CHOICES.items():
            if (value := getattr(self, name)) not in get_args(choice):
                known = ", ".join(get_args(choice))
                raise InputError(f"{name} must be one of {known}; got {value!r}"[:200])
        for name in LENGTHS:
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 <= value < np.inf:
                raise InputError(f"{name} must be a number that is not negative; got {value!r}"[:200])
        if (
            isinstance(self.threads, bool)
            or not isinstance(self.threads, int)
            or not 1 <= self.threads <= MOST_THREADS
        ):
            raise InputError(
                f"threads must be a whole number from 1 to {MOST_THREADS}; got {self.threads!r}"[:200]
            )
        if self.smooth and not (self.noise_mm or self.noise_deg):
            raise InputError("smooth must know the tracker's own noise; give noise_mm, noise_deg or both")
        if self.interpolation == "linear" and self.compounding != "mean":
            raise InputError(
                f"compounding must be mean with linear interpolation, which spreads a pixel over voxels; got "
                f"{self.compounding!r}, which takes nearest or between"
            )


def options_of(keywords: dict[str, Any]) -> Options:
    """The options of keywords.

    Raises:
        InputError: there is no such option, or its value cannot be used.
    """
    known = [one.name for one in fields(Options)]
    for name in keywords:
        if name not in known:
            raise InputError(f"{name!r} is no option of reconstruct; it has {', '.join(known)}")
    return Options(**keywords)
