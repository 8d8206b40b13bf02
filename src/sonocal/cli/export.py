"""``sonocal export``: a calibration for other software."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sonocal.cli.existing import choice_of, of_other_software, refuse_choice
from sonocal.cli.help import command
from sonocal.cli.options import FILE, WRITTEN, console
from sonocal.cli.outputs import OVERWRITE, reserve
from sonocal.cli.push import PUSH, PUSHED, SAVE_AS, YES, push_calibration
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
        "Into a running program": ("push", "save_as", "yes"),
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
    help="The software to export for; with --push plus unless told.",
)
@click.option("-o", "--output", type=WRITTEN, help="File to write.")
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
@PUSH
@SAVE_AS
@YES
def export(
    calibration: Path,
    form: str | None,
    output: Path | None,
    into: Path | None,
    *,
    scanned: bool,
    force: bool,
    overwrite: bool,
    push: str | None,
    save_as: str | None,
    yes: bool,
    **options: Any,
) -> None:
    """Write a calibration for other software: calibration.json, or a matrix of one program for another.

    \b
    plus    a device set (XML) whose ImageToProbe transform is the calibration; with --into, an existing device set that
            differs in it alone
    itk     an affine transform, .tfm or .h5, that maps pixels to mm as we do
    slicer  the same for 3D Slicer: in LPS, and the inverse, as its files are
    json    the calibration file, brought up to date

    With --push the calibration goes into a running PlusServer, which then saves its configuration, or as a transform
    into 3D Slicer; what changes is shown and asked about first.
    """  # noqa: D301 - click leaves the lines below the escape alone
    from sonocal.cli.formats import calibration_in
    from sonocal.export.content import which_images
    from sonocal.files import write_atomically

    form = _asked(form, output, into, push, save_as, yes=yes, scanned=scanned)
    loaded = calibration_in(calibration, choice_of(options))
    if output is not None:
        reserve(output)
    refuse_choice(loaded)
    remark = _remark(calibration, loaded, force=force)
    if scanned:
        loaded = as_scanned(loaded, calibration)
    frames = options["image"], options["probe"]
    content = None if output is None else _content(loaded, form, output, into, frames)
    if output is not None and content is not None:
        reserve(output)
        write_atomically(output, content)
    console().print(remark)
    if images := which_images(loaded):
        say(images)
    if output is not None:
        say(f"Wrote {output}")
    if push is not None:
        push_calibration(loaded, push, form, frames, yes=yes, save_as=save_as)


def _asked(
    form: str | None,
    output: Path | None,
    into: Path | None,
    push: str | None,
    save_as: str | None,
    *,
    yes: bool,
    scanned: bool,
) -> str:
    """The software to export for, once the options go together."""
    if output is None and push is None:
        raise click.UsageError("Missing option '-o' / '--output', or --push HOST:PORT")
    if form is None and push is None:
        raise click.UsageError("Missing option '--to'. Choose from: plus, itk, slicer, json")
    if push is None and (yes or save_as is not None):
        raise click.UsageError("--yes and --save-as are for --push")
    form = form or "plus"
    if push is not None and form not in PUSHED:
        raise click.UsageError(f"--push goes into PLUS or 3D Slicer: --to {' or '.join(PUSHED)}")
    if save_as is not None and form != "plus":
        raise click.UsageError("--save-as is for --to plus")
    if form != "plus" and into is not None:
        raise click.UsageError("--into is for --to plus")
    if into is not None and output is None:
        raise click.UsageError("--into needs a file to write, -o")
    if form == "json" and scanned:
        raise click.UsageError("--as-scanned is for other software; calibration.json holds both maps")
    return form


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
