"""``sonocal export``: a calibration for other software."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sonocal.cli.existing import choice_of, of_other_software, refuse_choice
from sonocal.cli.help import command
from sonocal.cli.options import FILE, WRITTEN, console
from sonocal.cli.outputs import OVERWRITE, reserve
from sonocal.cli.screen.plain import say
from sonocal.cli.sound import AS_SCANNED, as_scanned
from sonocal.errors import InputError

if TYPE_CHECKING:
    from rich.console import RenderableType

    from sonocal.calibration import Calibration
    from sonocal.existing import Existing

__all__ = ["export"]


@command(
    "Write a calibration for PLUS, ITK or 3D Slicer.",
    groups={
        "What is read": ("transform", "stored_as"),
        "What is written": ("form", "output", "into", "image", "probe", "scanned", "force", "overwrite"),
    },
    examples=(
        "sonocal export calibration.json --to plus -o plus.xml",
        "sonocal export calibration.json --to plus --into devices.xml -o calibrated.xml",
        "sonocal export calibration.json --to slicer -o ImageToProbe.h5",
        "sonocal export plus.xml --to itk -o ImageToProbe.tfm",
    ),
)
@click.argument("calibration", metavar="CALIBRATION", type=FILE)
@click.option(
    "--to",
    "form",
    type=click.Choice(["plus", "itk", "slicer", "json"]),
    required=True,
    help="The software to export for.",
)
@click.option("-o", "--output", type=WRITTEN, required=True, help="File to write.")
@click.option("--into", type=FILE, help="plus: a device set (XML) to put the matrix into; the rest stays.")
@click.option(
    "--image", default="Image", show_default=True, help="plus: what the device set calls the image's frame."
)
@click.option(
    "--probe", default="Probe", show_default=True, help="plus: what the device set calls the probe's marker."
)
@AS_SCANNED
@of_other_software
@click.option("--force", is_flag=True, help="Export what the verdict says not to use, too.")
@OVERWRITE
def export(
    calibration: Path,
    form: str,
    output: Path,
    into: Path | None,
    *,
    scanned: bool,
    force: bool,
    overwrite: bool,
    **options: Any,
) -> None:
    """Write a calibration for other software: calibration.json, or a matrix of one program for another.

    \b
    plus    a device set (XML) whose ImageToProbe transform is the calibration; with --into, an existing device set that
            differs in it alone
    itk     an affine transform, .tfm or .h5, that maps pixels to mm as we do
    slicer  the same for 3D Slicer: in LPS, and the inverse, as its files are
    json    the calibration file, brought up to date
    """  # noqa: D301 - click leaves the lines below the escape alone
    from sonocal.cli.formats import calibration_in
    from sonocal.export.content import which_images
    from sonocal.files import write_atomically

    if form != "plus" and into is not None:
        raise click.UsageError("--into is for --to plus")
    if form == "json" and scanned:
        raise click.UsageError("--as-scanned is for other software; calibration.json holds both maps")
    loaded = calibration_in(calibration, choice_of(options))
    reserve(output)
    refuse_choice(loaded)
    remark = _remark(calibration, loaded, force=force)
    if scanned:
        loaded = as_scanned(loaded, calibration)
    content = _content(loaded, form, output, into, (options["image"], options["probe"]))
    reserve(output)
    write_atomically(output, content)
    console().print(remark)
    if images := which_images(loaded):
        say(images)
    say(f"Wrote {output}")


def _remark(path: Path, found: Calibration | Existing, *, force: bool) -> RenderableType:
    """The verdict, or what is odd about a matrix; refuses what must not be used unless told to go on."""
    from sonocal.calibration import Calibration
    from sonocal.cli.screen.existing import remarks
    from sonocal.cli.screen.parts import verdict_text
    from sonocal.existing.meaning import UNUSABLE, matrix_findings
    from sonocal.validation import give_verdict

    if not isinstance(found, Calibration):
        wrong = next((one for one in matrix_findings(found) if one.code in UNUSABLE), None)
        if wrong is not None and not force:
            raise InputError(
                f"{path}: is not exported: {wrong.message}; {wrong.advice}, or export it all the same with --force"
            )
        return remarks(found)
    verdict = give_verdict(found)
    if verdict.level == "stop" and not force:
        raise InputError(
            f"{path}: is not exported, since its verdict is {verdict.headline!r} ({', '.join(verdict.codes)}; "
            "sonocal info says more); mend what it names and calibrate again, or export it all the same with --force"
        )
    return verdict_text(verdict)


def _content(
    found: Calibration | Existing, form: str, output: Path, into: Path | None, frames: tuple[str, str]
) -> bytes:
    if form == "json":
        return _json(found)
    if form == "plus":
        from sonocal.export.plus import plus_xml, put_into_device_set
        from sonocal.files.xml import read_xml

        if into is None:
            return plus_xml(found, *frames)
        return put_into_device_set(found, read_xml(into), into.name, *frames)
    return _transform(found, form, output)


def _json(found: Calibration | Existing) -> bytes:
    from sonocal.calibration import Calibration, calibration_json

    if isinstance(found, Calibration):
        return calibration_json(found)
    raise InputError(
        f"{found.file}: is a matrix alone, and calibration.json holds what a calibration rests on, too; export it "
        "--to plus, itk or slicer, or make a calibration with sonocal calibrate"
    )


def _transform(calibration: Calibration | Existing, form: str, output: Path) -> bytes:
    from sonocal.export import itk, slicer

    writers = {
        ("itk", ".tfm"): itk.itk_tfm,
        ("itk", ".h5"): itk.itk_h5,
        ("slicer", ".tfm"): slicer.slicer_tfm,
        ("slicer", ".h5"): slicer.slicer_h5,
    }
    write = writers.get((form, output.suffix.lower()))
    if write is None:
        raise InputError(f"{output}: transforms are written as .tfm or .h5; choose one of these names")
    return write(calibration)
