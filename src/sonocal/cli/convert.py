"""``sonocal convert``: a recording in another format."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sonocal.cli.help import command
from sonocal.cli.options import ANGLES, FILE, INVALID, LATENCY, MARKERS, POSES, WRITTEN, progress
from sonocal.cli.outputs import OVERWRITE, reserve
from sonocal.cli.reading import read_given
from sonocal.cli.screen.plain import say

if TYPE_CHECKING:
    from sonocal.recording import Recording

__all__ = ["convert"]


@command(
    "Write a recording in another format.",
    groups={
        "What is read": ("poses", "angles", "markers", "latency_s", "on_invalid"),
        "What is written": ("output", "without_images", "raw", "overwrite"),
    },
    examples=(
        "sonocal convert sweep.igs.mha -o sweep.nrrd",
        "sonocal convert sweep.igs.mha --without-images -o poses.csv",
    ),
)
@click.argument("recording", metavar="RECORDING", type=FILE)
@click.option(
    "-o",
    "--output",
    type=WRITTEN,
    required=True,
    help="File to write: .mha, .mhd, .nrrd, .csv of poses, or .mkv.",
)
@click.option(
    "--without-images", is_flag=True, help="Leave the images out: a recording of the tracker alone."
)
@click.option("--raw", is_flag=True, help="Do not compress: larger, and read faster.")
@POSES
@ANGLES
@MARKERS
@LATENCY
@INVALID
@OVERWRITE
def convert(
    recording: Path, output: Path, *, without_images: bool, raw: bool, overwrite: bool, **options: Any
) -> None:
    """Write a recording (RECORDING) in another format, by the name of the output.

    \b
    .mha, .mhd, .nrrd  a PLUS sequence: images, poses, stamps, statuses and fields, to the last bit
    .csv               a table of poses, of a tracker or --without-images
    .mkv               a video without loss, and the table of poses of the same name beside it; 8 bits, stamps to the ms
    """  # noqa: D301 - click leaves the lines below the escape alone
    from sonocal.recording.formats import write_recording
    from sonocal.recording.formats.registry import files_written

    files = files_written(output)
    reserve(*files)
    loaded = read_given(recording, options)
    if without_images:
        loaded = _tracker_alone(loaded)
    reserve(*files, read=loaded.provenance.paths)
    with progress("writing") as report:
        write_recording(_watched(loaded, report), output, not raw)
    made = " and ".join(str(path) for path in files if path.exists())
    say(f"Wrote {len(loaded)} item{'s' * (len(loaded) != 1)} to {made}")
    if lost := ", ".join(_lost(loaded, output.suffix.lower())):
        say(f"Not in it, for which the format has no place: {lost}")


def _tracker_alone(recording: Recording) -> Recording:
    import numpy as np

    from sonocal.recording.formats.parts.sequence_fields import IMAGE_STATUS
    from sonocal.recording.frames import no_frames

    none = np.zeros(len(recording), dtype=bool)
    fields = {key: text for key, text in recording.item_fields.items() if key not in IMAGE_STATUS}
    return replace(recording, frames=no_frames(), image=None, image_valid=none, item_fields=fields)


def _watched(recording: Recording, report: Callable[[int, int], None]) -> Recording:
    """The recording, which reports how many of its images were asked for."""
    from sonocal.recording.frames import MappedFrames

    if recording.image is None:
        return recording
    done, total = iter(range(1, len(recording) + 1)), len(recording)

    def told(image: Any) -> Any:
        report(next(done, total), total)
        return image

    return replace(recording, frames=MappedFrames(recording.frames, told, recording.frames.shape))


def _lost(recording: Recording, suffix: str) -> Iterator[str]:
    """What a format does not keep of a recording, in words."""
    from sonocal.recording.formats.parts.sequence_fields import IMAGE_STATUS
    from sonocal.recording.formats.parts.written import METAIO_GEOMETRY, NRRD_GEOMETRY

    if recording.latency_s:
        yield f"that poses were moved by {recording.latency_s:g} s"
    if suffix not in (".csv", ".mkv"):
        return
    said_otherwise = {*METAIO_GEOMETRY, *NRRD_GEOMETRY, *IMAGE_STATUS}
    if names := [name for name in (*recording.fields, *recording.item_fields) if name not in said_otherwise]:
        yield f"fields such as {', '.join(names)[:60]}"
    if suffix == ".mkv" and not recording.image_valid.all():
        yield f"which {int((~recording.image_valid).sum())} images are marked invalid"
    if suffix == ".mkv" and recording.image is not None and recording.image.orientation not in ("", "XX"):
        yield "that the images lie as MF, u right and v down"
    if suffix == ".mkv" and recording.image is not None and recording.image.spacing_mm is not None:
        yield "mm/px"
