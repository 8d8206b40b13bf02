"""The beginning of a live session, of a terminal's and of a page's: what is asked of it, and where it is kept."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sonocal.cli.options import given
from sonocal.cli.reading import ESTIMATE
from sonocal.errors import UnsupportedError

if TYPE_CHECKING:
    from sonocal.live import Live
    from sonocal.sweep import Session
    from sonocal.targets import Line, Target, Unplaced

__all__ = ["IMAGE", "IMAGES", "MOST_TILT", "RECORDING", "UNTIL", "as_recorded", "keep_in", "session_of"]

RECORDING, IMAGES = "recording.mhd", "recording.raw"
OF_SESSIONS = ("probe", "on_invalid", "scanner_mm_per_px", "tolerance_mm")


class Millimetres(click.ParamType[float]):
    """A length such as 0.5mm or 0.5."""

    name = "MM"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """The number."""
        try:
            number = float(str(value).strip().removesuffix("mm"))
        except ValueError:
            number = 0.0
        if not 0 < number < float("inf"):
            self.fail(f"{value!r} is not a length such as 0.5mm", param, ctx)
        return number


IMAGE = click.option(
    "--image", default="", metavar="NAME", help="Whose images to take.  [default: the first that come]"
)
UNTIL = click.option(
    "--until",
    "until_mm",
    type=Millimetres(),
    help="End once the predicted error (95 %) is below this everywhere in the image.  [default: a key or ctrl-C ends]",
)
MOST_TILT = click.option(
    "--most-tilt-deg",
    type=click.FloatRange(5, 80),
    default=60.0,
    show_default=True,
    help="The most that the needle can be tilted; poses to hold next are asked for up to that.",
)


def session_of(lines: Path, options: dict[str, Any]) -> Session:
    """A session of the needles and wires of a file; the tip of one, as ``sonocal tool`` writes it, is not looked for.

    Raises:
        UnsupportedError: it holds others, too.
    """
    from sonocal.cli.formats import targets_in
    from sonocal.sweep import Session
    from sonocal.targets import Line

    known, fixed = targets_in(lines)
    needles = [one for one in known if isinstance(one, Line)]
    if any(not isinstance(one, Line) and not _is_tip(one, needles) for one in known):
        raise UnsupportedError(
            f"{lines.name}: holds more than needles and wires, and sonocal live follows these alone; record, and name "
            "it to sonocal calibrate"
        )
    estimated = options["latency_s"] == ESTIMATE
    how = {name: options[name] for name in OF_SESSIONS if name in options}
    how |= given(("count", "centre"), options) | ({"latency": ESTIMATE} if estimated else {})
    return Session(needles, fixed=fixed, **how)


def _is_tip(one: Target | Unplaced, needles: Sequence[Line]) -> bool:
    """Whether a target is an end of a needle."""
    from sonocal.targets import Point

    return isinstance(one, Point) and any(
        one.frame == needle.frame and (one.place_mm == needle.segment_mm).all(axis=1).any()
        for needle in needles
    )


def keep_in(session: Session, output: Path) -> None:
    """Let what comes be kept in files of a folder."""
    from sonocal.files import make_folder, remove
    from sonocal.recording.formats import GrowingSequence

    make_folder(output)
    for name in (RECORDING, IMAGES):  # reserve() asked
        if (output / name).exists():
            remove(output / name)
    session.stream = GrowingSequence(output / RECORDING)


def as_recorded(running: Live, options: dict[str, Any]) -> list[str]:
    """The options that read the recording as it was followed."""
    words = ["--on-invalid", str(options["on_invalid"])]
    latency = options["latency_s"]
    if latency == ESTIMATE or not running.pairing.apart:  # else poses were taken where the images belong
        words += ["--latency", str(latency)]
    return words
