"""``sonocal reconstruct``: a volume of a calibrated sweep."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from sonocal.cli.existing import choice_of, of_other_software, refuse_choice
from sonocal.cli.help import command
from sonocal.cli.options import (
    ANGLES,
    FILE,
    INVALID,
    JSON,
    LATENCY,
    MARKERS,
    MASK,
    NO_REPORT,
    POSES,
    PROBE,
    WRITTEN,
    progress,
    typed,
)
from sonocal.cli.outputs import OVERWRITE, reserve
from sonocal.cli.reading import read_given
from sonocal.cli.screen.plain import say, say_json
from sonocal.cli.volume_made import (
    OWN,
    SHOWN,
    as_plus,
    own_volume,
    refuse_lag,
    refuse_name,
    volume_record,
    volume_sentence,
    workers_of,
)

__all__ = ["reconstruct"]


class _Numbers(click.ParamType[tuple[float, ...]]):
    """Numbers with commas between them."""

    def __init__(self, name: str, counts: tuple[int, ...]) -> None:
        self.name, self.counts = name, counts

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...]:
        """The numbers."""
        if isinstance(value, tuple):
            return value
        try:
            numbers = tuple(float(part) for part in str(value).split(","))
        except ValueError:
            numbers = ()
        if len(numbers) not in self.counts:
            wanted = " or ".join(map(str, self.counts))
            self.fail(f"{value!r} is not {wanted} numbers with commas between them", param, ctx)
        return numbers


@command(
    "Make a volume of a calibrated sweep.",
    groups={
        "What is read": (
            "poses",
            "angles",
            "markers",
            "probe",
            "latency_s",
            "on_invalid",
            "transform",
            "stored_as",
        ),
        "Where the voxels lie": ("spacing_mm", "bounds_mm", "reference"),
        "How images come to voxels": (
            *("interpolation", "compounding", "speckle", "longest_gap_mm", "mask", "like_plus"),
        ),
        "Who computes it": ("threads", "workers", "scheduler"),
        "What is known of the tracker": ("noise_mm", "noise_deg", "smooth"),
        "What is written and shown": (
            *("output", "coverage", "error", "axes", "report", "overwrite", "as_json"),
        ),
    },
    examples=(
        "sonocal reconstruct sweep.igs.mha calibration.json -o volume.mha",
        "sonocal reconstruct sweep.igs.mha calibration.json -o fine.nrrd --spacing 0.25 --threads 2",
        "sonocal reconstruct sweep.igs.mha plus.xml --like-plus plus-volume.xml -o as-plus.mha",
    ),
)
@click.argument("recording", metavar="RECORDING", type=FILE)
@click.argument("calibration", metavar="CALIBRATION", type=FILE)
@click.option("-o", "--output", type=WRITTEN, required=True, help="Volume to write: .mha or .nrrd.")
@click.option(
    "--spacing",
    "spacing_mm",
    type=_Numbers("MM[,MM,MM]", (1, 3)),
    default=(0.5,),
    help="Of the voxels, mm; or along x, y and z.  [default: 0.5]",
)
@click.option(
    "--bounds",
    "bounds_mm",
    type=_Numbers("X,Y,Z,X,Y,Z", (6,)),
    help="The lowest and the highest corner, mm.  [default: around all images]",
)
@click.option("--reference", help="Frame of the volume.  [default: Reference, else the tracker's]")
@click.option(
    "--interpolation",
    type=click.Choice(["between", "nearest", "linear"]),
    default="between",
    show_default=True,
    help="between: along the probe's path from image to image; nearest, linear: each pixel to the voxels about it.",
)
@click.option(
    "--compounding",
    type=click.Choice(["mean", "maximum", "latest"]),
    default="mean",
    show_default=True,
    help="Of several values of a voxel.",
)
@click.option(
    "--speckle",
    type=click.Choice(["averaged", "kept"]),
    default="averaged",
    show_default=True,
    help="between: averaged over a voxel, or kept as single pixels show it.",
)
@click.option(
    "--longest-gap",
    "longest_gap_mm",
    type=click.FloatRange(0),
    default=10.0,
    show_default=True,
    help="between: images further apart are not interpolated between, mm.",
)
@click.option(
    "--like-plus", type=FILE, metavar="DEVICESET", help="As PLUS makes it by this device set, to the voxel."
)
@click.option(
    "--threads", type=click.IntRange(1, 64), default=1, show_default=True, help="That share the work."
)
@click.option("--workers", type=click.IntRange(1), metavar="N", help="Dask worker processes, instead.")
@click.option("--scheduler", metavar="tcp://HOST:PORT", help="An existing Dask cluster, instead.")
@click.option(
    "--coverage", is_flag=True, help="Write how many values each voxel was given, too: VOLUME-coverage."
)
@click.option(
    "--error", is_flag=True, help="Write how far off each voxel is (95 %, micrometres), too: VOLUME-error-um."
)
@click.option(
    "--noise-mm", type=click.FloatRange(0), default=0.0, help="Of its poses, rms along each axis, mm."
)
@click.option(
    "--noise-deg", type=click.FloatRange(0), default=0.0, help="Of its poses, rms about each axis, degrees."
)
@click.option(
    "--smooth", is_flag=True, help="Take out of the poses what of that noise their steadiness shows."
)
@click.option(
    "--axes",
    type=click.Choice(["lps", "ras"]),
    default="lps",
    show_default=True,
    help="How other programs read x, y, z: as PLUS's files, or as 3D Slicer shows what a tracker streams.",
)
@POSES
@ANGLES
@MARKERS
@PROBE
@LATENCY
@INVALID
@MASK
@of_other_software
@NO_REPORT
@OVERWRITE
@JSON
def reconstruct(
    recording: Path,
    calibration: Path,
    output: Path,
    *,
    like_plus: Path | None,
    mask: Path | None,
    workers: int | None,
    scheduler: str | None,
    report: bool,
    overwrite: bool,
    as_json: bool,
    **options: Any,
) -> None:
    """Put the images of a tracked probe (RECORDING) into a volume, by its calibration (CALIBRATION).

    CALIBRATION is calibration.json, or a matrix of other software: a device set of PLUS (.xml), a transform of ITK or
    3D Slicer (.tfm, .h5), a 4 x 4 (text, .npy).
    """
    from sonocal.cli.formats import calibration_in
    from sonocal.cli.volume_report import page_beside, write_volume_page
    from sonocal.reconstruction.store import beside_volume

    if like_plus is not None and (wrong := typed((*OWN[:-2], "threads", "workers", "scheduler", "mask"))):
        raise click.UsageError(f"{wrong[0]} is not for --like-plus, whose device set says all of it")
    if len(given := typed(("threads", "workers", "scheduler"))) > 1:
        raise click.UsageError(f"give {given[0]} or {given[1]}, not both")
    channels = {"coverage": "coverage", "error": "error-um"}
    written = [output, *(beside_volume(output, name) for option, name in channels.items() if options[option])]
    refuse_name(output)
    pages = [page_beside(output)] if report else []
    reserve(*written, *pages)
    loaded = calibration_in(calibration, choice_of(options))
    refuse_choice(loaded)
    refuse_lag(loaded, calibration, options["latency_s"])
    sweep = read_given(recording, options)
    reserve(*written, *pages, read=sweep.provenance.paths)
    with progress("making the volume") as told:
        if like_plus is not None:
            volume = as_plus(sweep, loaded, like_plus, output, options | {"progress": told})
        else:
            with workers_of(workers, scheduler) as who:
                volume = own_volume(sweep, loaded, mask, output, options | {"progress": told, "workers": who})
    if report:
        sources = {"recording": recording, "calibration": calibration, "as PLUS by": like_plus, "mask": mask}
        chosen = {} if like_plus else {name: options[name] for name in SHOWN}
        written += write_volume_page(volume, output, options["axes"], sources | chosen)
    if as_json:
        say_json(volume_record(volume, output))
        return
    say(volume_sentence(volume))
    say(f"Wrote {' and '.join(map(str, written))}")
