"""``sonocal check``: whether yesterday's calibration still holds, by a short sweep."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from sonocal.cli.help import DETECTING, command
from sonocal.cli.options import (
    ANGLES,
    CENTRE,
    COUNT,
    FILE,
    INVALID,
    JSON,
    LINES,
    MARKERS,
    MASK,
    NO_REPORT,
    POSES,
    PROBE,
    WRITTEN,
    console,
    progress,
    typed,
)
from sonocal.cli.outputs import reserve
from sonocal.cli.screen.plain import say, say_json
from sonocal.cli.told import ACCEPT_UNITS
from sonocal.errors import InputError, SonocalError, UnsupportedError

if TYPE_CHECKING:
    from sonocal.calibration import Calibration
    from sonocal.observations import Observations

__all__ = ["check"]

OF_RECORDINGS = ("poses", "angles", "markers", "probe", "latency_s", "on_invalid", *DETECTING, "accept_units")


class _Swept(NamedTuple):
    rows: Observations
    by_itself: Calibration | None


@command(
    "Tell by a 10-second sweep whether a calibration still holds.",
    groups={
        "What is swept": ("lines", "poses", "angles", "markers", "probe", "latency_s", "on_invalid"),
        "How the needle is found in images": DETECTING,
        "What matters": ("tolerance_mm", "accept_units"),
        "What is written and shown": ("log", "logged", "report", "as_json"),
    },
    examples=(
        "sonocal check calibration.json sweep.igs.mha --lines needle.toml",
        "sonocal check calibration.json needle.csv --tolerance 0.5 --no-log",
    ),
)
@click.argument("calibration", metavar="CALIBRATION", type=FILE)
@click.argument("sweep", metavar="SWEEP", type=FILE)
@LINES
@POSES
@ANGLES
@MARKERS
@PROBE
@click.option(
    "--latency",
    "latency_s",
    type=float,
    help="How much later the tracker stamps an instant than the images do, s.  [default: the calibration's]",
)
@INVALID
@COUNT
@CENTRE
@MASK
@click.option(
    "--tolerance",
    "tolerance_mm",
    type=click.FloatRange(0, min_open=True),
    default=1.0,
    show_default=True,
    help="The change of the image's place that matters, mm rms.",
)
@ACCEPT_UNITS
@click.option("--log", type=WRITTEN, help="Log to add the check to.  [default: CALIBRATION's, .checks.jsonl]")
@click.option("--no-log", "logged", is_flag=True, flag_value=False, default=True, help="Add it to no log.")
@NO_REPORT
@JSON
def check(
    calibration: Path,
    sweep: Path,
    *,
    lines: Path | None,
    tolerance_mm: float,
    log: Path | None,
    logged: bool,
    report: bool,
    as_json: bool,
    **recorded: Any,
) -> None:
    """Does a calibration still hold, or was the marker knocked or the depth changed?

    \b
    SWEEP is ten seconds of what can be calibrated with:
    a recording    of the needle, of the phantom, or of a thread (place = "unknown"), with --lines
    a table        of sightings (CSV)

    The answer is that it holds, that it changed, or that this sweep cannot tell; with the share of knocks of 1 mm that
    such a sweep shows. Every check is added to the log beside CALIBRATION, of which nothing is ever removed; the page
    beside it shows all of them over time.
    """  # noqa: D301 - click leaves the lines below the escape alone
    from sonocal.cli.formats import own_calibration_in
    from sonocal.cli.screen.check import check_record, print_check
    from sonocal.validation import check_calibration
    from sonocal.validation.check_log import CheckRecord, append_check, check_log_path

    if log is not None and not logged:
        raise click.UsageError("--log and --no-log contradict one another; leave one out")
    found = own_calibration_in(calibration)
    to = (log or check_log_path(calibration)) if logged else None
    if to is not None:
        _refuse_other_file(to, calibration, sweep, lines)
    swept = _swept(found, sweep, lines, recorded)
    done = check_calibration(
        found, swept.rows, swept.by_itself, tolerance_mm=tolerance_mm, same_rows=_made_of(found, sweep)
    )
    if to is not None:
        append_check(to, CheckRecord.of(done, **_origin(calibration, sweep)))
    say_json(check_record(done)) if as_json else print_check(console(), done)
    if to is not None:
        _told(to, report=report, quiet=as_json)


def _refuse_other_file(log: Path, *read: Path | None) -> None:
    """A log is a log: lines are added to no other file."""
    from sonocal.validation.check_log import read_check_log

    reserve(log, replaced=True, read=[str(one) for one in read if one is not None])
    if log.exists() and log.stat().st_size:
        read_check_log(log)


def _told(log: Path, *, report: bool, quiet: bool) -> None:
    """Say where the check was added, and draw the log."""
    from sonocal.cli.formats import kind_of
    from sonocal.files import write_atomically
    from sonocal.report.checks import checks_html
    from sonocal.validation.check_log import read_check_log

    say(f"Added to {log}", err=quiet)
    if not report:
        return
    page = log.with_suffix(".html")
    try:
        content = checks_html(read_check_log(log))
    except UnsupportedError as error:
        say(f"Note: {error}", err=True)
        return
    if page.exists() and kind_of(page) != "page":
        raise InputError(
            f"{page}: is no page of sonocal's and would be replaced; move it, or say --no-report"
        )
    write_atomically(page, content)
    say(f"Wrote {page}", err=quiet)


def _origin(calibration: Path, sweep: Path) -> dict[str, str]:
    from sonocal.files import digest

    named = {"calibration": calibration, "sweep": sweep}
    names = {name: path.name for name, path in named.items()}
    return names | {f"{name}_sha256": digest(path) for name, path in named.items() if path.is_file()}


def _made_of(found: Calibration, sweep: Path) -> bool:
    """Whether a recording is the one that the calibration was made of."""
    from sonocal.files import digest

    recorded = found.provenance.get("recorded", {}).get("recording", {})
    return sweep.is_file() and recorded.get("sha256") == digest(sweep)


def _swept(found: Calibration, sweep: Path, lines: Path | None, recorded: dict[str, Any]) -> _Swept:
    """The sightings of the sweep, and its own calibration where there is one."""
    from sonocal.cli.formats import kind_of, require_kind
    from sonocal.observations import read_observations

    if lines is not None:
        return _recorded(found, sweep, lines, recorded)
    if names := typed(OF_RECORDINGS):
        raise click.UsageError(f"{names[0]} is for recordings; give their needle or wires with --lines")
    if sweep.is_dir() or kind_of(sweep) == "recording":
        raise InputError(
            f"{sweep.name}: is a recording; say with --lines which needle or wires were swept in it"
        )
    require_kind(sweep, ("observations",), "give a table of sightings (CSV), or a recording with --lines")
    return _Swept(read_observations(sweep), None)


def _recorded(found: Calibration, sweep: Path, lines: Path, recorded: dict[str, Any]) -> _Swept:
    """As a calibration would choose among what is seen; where it finds none, what is near the one in doubt."""
    from sonocal.calibration import placed_by
    from sonocal.cli.from_recording import given_recording
    from sonocal.sweep import Sweep, sweep_of
    from sonocal.sweep.near import sightings_near

    latency = recorded["latency_s"]
    how = recorded | {"points": None, "latency_s": found.latency_s or 0.0 if latency is None else latency}
    options: dict[str, Any] = {"model": found.model}
    if found.model == "rigid":
        options["scale_mm_per_px"] = found.options.scale_mm_per_px
    read = given_recording(sweep, lines, how, options)
    seeing = sweep_of(read.recording, read.targets, **read.looking)
    with progress("detecting") as shown:
        seen = seeing.detect(shown)
    try:
        own = seeing.calibrate(seen, found.probe_from_image)  # type: ignore[arg-type]
    except SonocalError:
        if not isinstance(seeing, Sweep):
            raise
        return _Swept(sightings_near(seeing, seen, found), None)  # type: ignore[arg-type]
    if own.calibration.targets:
        return _Swept(placed_by(own.calibration, own.observations), own.calibration)
    return _Swept(own.observations, own.calibration)
