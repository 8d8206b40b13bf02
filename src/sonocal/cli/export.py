"""``sonocal export``: a calibration for other software."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from sonocal.cli.options import FILE, console
from sonocal.cli.outputs import OVERWRITE, reserve
from sonocal.cli.screen.plain import say
from sonocal.errors import InputError

if TYPE_CHECKING:
    from sonocal.calibration import Calibration

__all__ = ["export"]


@click.command(short_help="Write a calibration for PLUS, ITK or 3D Slicer.")
@click.argument("calibration", metavar="CALIBRATION", type=FILE)
@click.option(
    "--to",
    "form",
    type=click.Choice(["plus", "itk", "slicer", "json"]),
    required=True,
    help="The software to export for.",
)
@click.option("-o", "--output", type=FILE, required=True, help="File to write.")
@click.option("--into", type=FILE, help="plus: a device set (XML) to put the matrix into; the rest stays.")
@click.option(
    "--image", default="Image", show_default=True, help="plus: what the device set calls the image's frame."
)
@click.option(
    "--probe", default="Probe", show_default=True, help="plus: what the device set calls the probe's marker."
)
@click.option("--force", is_flag=True, help="Export what the verdict says not to use, too.")
@OVERWRITE
def export(
    calibration: Path,
    form: str,
    output: Path,
    into: Path | None,
    *,
    force: bool,
    overwrite: bool,
    **frames: str,
) -> None:
    """Write a calibration (calibration.json) for other software.

    \b
    plus    a device set (XML) whose ImageToProbe transform is the calibration;
            with --into, an existing device set that differs in it alone
    itk     an affine transform, .tfm or .h5, that maps pixels to mm as we do
    slicer  the same for 3D Slicer: in LPS, and the inverse, as its files are
    json    the calibration file, brought up to date
    """  # noqa: D301 - click leaves the lines below the escape alone
    from sonocal.cli.formats import calibration_in
    from sonocal.cli.screen.parts import verdict_text
    from sonocal.files import write_atomically
    from sonocal.validation import give_verdict

    if form != "plus" and into is not None:
        raise click.UsageError("--into is for --to plus")
    loaded = calibration_in(calibration)
    reserve(output)
    verdict = give_verdict(loaded)
    if verdict.level == "stop" and not force:
        raise InputError(
            f"{calibration}: is not exported, since its verdict is {verdict.headline!r} ({', '.join(verdict.codes)}; "
            "sonocal info says more); mend what it names and calibrate again, or export it all the same with --force"
        )
    content = _content(loaded, form, output, into, (frames["image"], frames["probe"]))
    reserve(output)
    write_atomically(output, content)
    console().print(verdict_text(verdict))
    say(f"Wrote {output}")


def _content(
    calibration: Calibration, form: str, output: Path, into: Path | None, frames: tuple[str, str]
) -> bytes:
    if form == "json":
        from sonocal.calibration import calibration_json

        return calibration_json(calibration)
    if form == "plus":
        from sonocal.export.plus import plus_xml, put_into_device_set
        from sonocal.files.xml import read_xml

        if into is None:
            return plus_xml(calibration, *frames)
        return put_into_device_set(calibration, read_xml(into), into.name, *frames)
    return _transform(calibration, form, output)


def _transform(calibration: Calibration, form: str, output: Path) -> bytes:
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
