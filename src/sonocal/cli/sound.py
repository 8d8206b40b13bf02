"""What a user says of a curved probe and of the speed of sound on the command line; the map of images as scanned."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sonocal.cli.options import NumberOr
from sonocal.errors import InputError

if TYPE_CHECKING:
    from sonocal.calibration import Calibration
    from sonocal.existing import Existing

__all__ = ["AS_SCANNED", "OF_SOUND", "as_scanned", "of_sound"]

OF_SOUND = ("probe_radius_mm", "sound_speed_m_s", "assumed_sound_speed_m_s", "probe_face_px")
AS_SCANNED = click.option(
    "--as-scanned",
    "scanned",
    is_flag=True,
    help="The map that is best for images in which sound runs as it did in those calibrated on.",
)


class Place(click.ParamType[tuple[float, ...]]):
    """A place in the image, px."""

    name = "U,V[,W]"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...]:
        """Its numbers."""
        try:
            place = tuple(float(part) for part in str(value).replace(",", " ").split())
        except ValueError:
            place = ()
        if len(place) not in (2, 3):
            self.fail(f"{value!r} is not a place such as 320,12", param, ctx)
        return place


def of_sound(command: Callable[..., None]) -> Callable[..., None]:
    """The options of a curved probe and of the speed of sound."""
    for option in (
        click.option(
            "--probe-face-px",
            type=Place(),
            metavar="U,V[,W]",
            help="The middle of the transducer's face in the image.  [default: of the image's top row]",
        ),
        click.option(
            "--assumed-sound-speed",
            "assumed_sound_speed_m_s",
            type=float,
            default=1540.0,
            show_default=True,
            help="What the scanner assumes, m/s.",
        ),
        click.option(
            "--sound-speed",
            "sound_speed_m_s",
            type=NumberOr("estimate", "m/s", "M/S|estimate"),
            metavar="M/S|estimate",
            help="In what was scanned, m/s (water at 20 C: 1482); or estimate, from 1400 to 1650, which "
            "--scanner-mm-per-px in all its digits makes surer.  [default: as the scanner assumes]",
        ),
        click.option(
            "--probe-radius-mm",
            type=float,
            help="Radius of a curved probe's face, from its data sheet; with --sound-speed.",
        ),
    ):
        command = option(command)
    return command


def as_scanned(found: Calibration | Existing, path: Path) -> Calibration:
    """The calibration with the map of images as they were scanned.

    Raises:
        InputError: it knows of no other speed of sound, and has one map.
    """
    from sonocal.calibration import Calibration
    from sonocal.geometry import Similarity

    if not isinstance(found, Calibration) or found.sound is None:
        raise InputError(
            f"{path}: has one map for all images; --as-scanned is for calibrations made with --sound-speed"
        )
    return replace(found, probe_from_image=Similarity.from_matrix(found.sound.as_scanned))
