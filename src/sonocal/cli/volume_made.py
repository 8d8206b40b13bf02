"""How ``reconstruct`` makes a volume of what was given, and what it says of it."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sonocal.cli.options import typed
from sonocal.errors import InputError

if TYPE_CHECKING:
    from sonocal.reconstruction import Volume
    from sonocal.recording import Recording

__all__ = [
    "OWN",
    "SHOWN",
    "as_plus",
    "own_volume",
    "refuse_lag",
    "refuse_name",
    "volume_record",
    "volume_sentence",
    "workers_of",
]

OWN = (
    *("spacing_mm", "bounds_mm", "reference", "interpolation", "compounding", "speckle", "longest_gap_mm"),
    *("noise_mm", "noise_deg", "smooth", "coverage", "error", "axes", "threads"),
)

SHOWN = tuple(name for name in OWN if name not in ("coverage", "error", "axes", "threads"))
"""Of the options, those that change the voxels: the page tells them."""


def workers_of(workers: int | None, scheduler: str | None) -> AbstractContextManager[Any]:
    """The workers of a cluster, as asked for; None: this process."""
    if workers is None and scheduler is None:
        return nullcontext()
    from sonocal.studies import cluster

    kept = "nothing was written"
    return cluster.local(workers, kept=kept) if workers else cluster.existing(scheduler or "", kept=kept)


def own_volume(
    sweep: Recording, loaded: Any, mask: Path | None, output: Path, options: dict[str, Any]
) -> Volume:
    """A volume by sonocal's own ways."""
    import numpy as np

    from sonocal.detection import read_mask
    from sonocal.reconstruction import reconstruct as make

    chosen = {name: options[name] for name in (*OWN, "probe", "on_invalid", "progress", "workers")}
    chosen["spacing_mm"] = np.squeeze(options["spacing_mm"])
    if options["bounds_mm"] is not None:
        chosen["bounds_mm"] = np.reshape(options["bounds_mm"], (2, 3))
    deep = sweep.image is not None and sweep.image.dimension == 3
    drawn = (
        None if mask is None else read_mask(mask, sweep.frames.shape[1:3] if deep else sweep.frames.shape[:2])
    )
    return make(sweep, loaded, output, mask=drawn, **chosen)


def as_plus(sweep: Recording, loaded: Any, device_set: Path, output: Path, options: dict[str, Any]) -> Volume:
    """A volume as PLUS makes it, written."""
    from sonocal.reconstruction import reconstruct_like_plus, write_array

    told = {name: options[name] for name in ("probe", "on_invalid", "progress")}
    volume = reconstruct_like_plus(sweep, loaded, device_set, **told)
    write_array(output, volume.values, volume.grid, volume.reference, options["axes"])
    return volume


def refuse_name(output: Path) -> None:
    """Raise where a name is of no format that volumes are written in."""
    from sonocal.reconstruction.files import SUFFIXES

    if output.suffix.lower() not in SUFFIXES:
        raise InputError(
            f"{output}: volumes are written as {' or '.join(SUFFIXES)}; choose one of these names"
        )


def refuse_lag(loaded: Any, path: Path, latency_s: float) -> None:
    """A calibration that undid a lag is for poses from which it is undone."""
    from sonocal.calibration import Calibration

    known = loaded.latency_s if isinstance(loaded, Calibration) else None
    if known and not latency_s and not typed(("latency_s",)):
        raise InputError(
            f"{path}: undid a lag of {known:.3f} s between tracker and images; say what this recording has, --latency "
            f"{known:.4g} where it is of the same set-up, or --latency 0"
        )


def volume_sentence(volume: Volume) -> str:
    """A volume in a sentence."""
    size = " x ".join(map(str, volume.grid.size))
    spacing = " x ".join(f"{s:g}" for s in volume.grid.spacing_mm)
    left = f", {volume.left_out} without a valid pose left out" if volume.left_out else ""
    return (
        f"{volume.images} images{left}: {size} voxels of {spacing} mm in {volume.reference}, "
        f"{volume.filled_share:.0%} of them filled"
    )


def volume_record(volume: Volume, output: Path) -> dict[str, Any]:
    """A volume for programs."""
    return {
        "volume": str(output),
        "size": volume.grid.size,
        "spacing_mm": volume.grid.spacing_mm,
        "origin_mm": volume.grid.origin_mm,
        "reference": volume.reference,
        "images": volume.images,
        "left_out": volume.left_out,
        "filled_share": volume.filled_share,
    }
