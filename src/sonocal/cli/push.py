"""A calibration into a running program: what changes is shown, and asked about, first."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING

import click

from sonocal.cli.screen.plain import say
from sonocal.errors import InputError

if TYPE_CHECKING:
    from sonocal.calibration import Calibration
    from sonocal.existing import Existing
    from sonocal.export.content import Content
    from sonocal.geometry import Array
    from sonocal.igtl import Client, HeldTransform, PlusServer

__all__ = ["PUSH", "PUSHED", "SAVE_AS", "YES", "push_calibration"]

PUSHED = ("plus", "slicer")
TAKEN_S = 0.5
"""So long Slicer has to read before the connection ends."""

PUSH = click.option(
    "--push",
    metavar="HOST:PORT",
    help="Put it into a running PlusServer or, with --to slicer, into 3D Slicer's OpenIGTLinkIF.",
)
SAVE_AS = click.option(
    "--save-as",
    metavar="NAME",
    help="plus: the file on the server's machine that it saves its configuration to; its own unless told.",
)
YES = click.option("--yes", is_flag=True, help="Do not ask.")


def push_calibration(
    found: Calibration | Existing,
    address: str,
    form: str,
    frames: tuple[str, str],
    *,
    yes: bool,
    save_as: str | None = None,
    err: bool = False,
) -> None:
    """Put a calibration into a running PlusServer or 3D Slicer.

    Args:
        found: what to put there.
        address: HOST:PORT.
        form: "plus" or "slicer".
        frames: what the program calls the image's frame and that of the probe's marker.
        yes: do not ask.
        save_as: of PLUS's configuration; None: over its own.
        err: say what becomes of it on stderr, where stdout is for programs.

    Raises:
        InputError: nobody listens there, it does not take the calibration, or nobody can be asked.
        click.Abort: the answer is no.
    """
    from sonocal.export.content import content_of
    from sonocal.igtl import Client, PlusServer
    from sonocal.igtl import address as parts

    written, name = content_of(found), "{}To{}".format(*frames)
    host, port = parts(address)
    with Client(host, port) as client:
        where = f"{host}:{port}"
        if form == "plus":
            area_px = getattr(found, "area_px", None)
            _into_plus(
                PlusServer(client, where),
                where,
                name,
                written,
                area_px=area_px,
                save_as=save_as,
                yes=yes,
                err=err,
            )
        else:
            say(f"{where}: is sent {name}, replacing a transform of that name if it has one:", err=err)
            say(_rows(written.matrix), err=err)
            _ask(yes=yes, err=err)
            _into_slicer(client, name, written.matrix)
            say(f"Sent {name} to {where}; Slicer gives no answer: see its transform {name}", err=err)


def _into_plus(
    server: PlusServer,
    where: str,
    name: str,
    written: Content,
    *,
    area_px: Array | None,
    save_as: str | None,
    yes: bool,
    err: bool,
) -> None:
    from sonocal.targets.device_set_edit import transform_values

    matrix, error_mm = written.matrix, written.error_mm
    say(_change(where, name, server.transform(name), matrix, area_px), err=err)
    file = "over its own file" if save_as is None else f"as {save_as}"
    say(f"PlusServer then saves its configuration {file}.", err=err)
    _ask(yes=yes, err=err)
    date = transform_values(matrix, error_mm)["Date"]
    server.update_transform(name, matrix, error_mm=error_mm, date=date)
    say(f"Put {name} into {where}", err=err)
    server.save_config(save_as)
    say(f"{where} saved its configuration", err=err)


def _into_slicer(client: Client, name: str, matrix: Array) -> None:
    """A TRANSFORM, which Slicer takes as its transform to parent as it is."""
    from sonocal.igtl import Message, Transform, stamp_of

    client.send(Message(Transform(matrix), name, stamp_of(time.time())))
    client.take(TAKEN_S)


def _change(where: str, name: str, held: HeldTransform | None, matrix: Array, area_px: Array | None) -> str:
    if held is None:
        return f"{where}: has no {name}; it gets\n{_rows(matrix)}"
    of = f" of {held.date}" if held.date else ""
    error = "" if held.error_mm is None else f" (error {held.error_mm:.3g} mm)"
    moves = (
        ""
        if area_px is None
        else f"\nCorners of the image move by up to {_moved(held, matrix, area_px):.2g} mm."
    )
    return f"{where}: has {name}{of}{error}\n{_rows(held.matrix)}\nwhich becomes\n{_rows(matrix)}{moves}"


def _moved(held: HeldTransform, matrix: Array, area_px: Array) -> float:
    import numpy as np

    from sonocal.geometry import area_places, homogeneous_points

    corners = homogeneous_points(area_places(area_px))
    apart = (matrix - held.matrix)[:3]
    return float(np.linalg.norm(corners @ apart[:, :3].T + apart[:, 3], axis=1).max())


def _rows(matrix: Array) -> str:
    return "\n".join("  " + " ".join(f"{x:11.5f}" for x in row) for row in matrix)


def _ask(*, yes: bool, err: bool) -> None:
    if yes:
        return
    if not sys.stdin.isatty():
        raise InputError("nobody is there to be asked whether to put it there; say --yes")
    click.confirm("Put it there?", abort=True, err=err)
