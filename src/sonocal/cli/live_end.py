"""The end of ``sonocal live``: what ``sonocal calibrate`` makes of the recording, with what was seen on the way."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from sonocal.cli.calibrate import calibrate
from sonocal.cli.live_begin import as_recorded
from sonocal.cli.options import console, typed
from sonocal.cli.outputs import write_results
from sonocal.cli.reading import ESTIMATE
from sonocal.cli.refusal import refusing
from sonocal.cli.report import json_with_verdict
from sonocal.cli.results import results
from sonocal.cli.screen.plain import say_json

if TYPE_CHECKING:
    from sonocal.calibration import Calibration
    from sonocal.live import Live

__all__ = ["calibrated"]

HANDED_ON = ("count", "centre", "probe", "scanner_mm_per_px", "tolerance_mm")


def calibrated(running: Live, output: Path, lines: Path, options: dict[str, Any], name: str) -> Calibration:
    """Calibrate the recording as its own command would, write what that writes, and print what it prints.

    Returns:
        The calibration.
    """
    from sonocal.cli.screen.calibration import print_calibration

    seen = running.detections()
    words = _words(running, output / name, lines, output, options)
    as_json = bool(options["as_json"])
    with calibrate.make_context("calibrate", words) as context, refusing(as_json=as_json):
        how = dict(context.params)
        for left in ("source", "output", "overwrite", "as_json"):
            how.pop(left)
        how["latency"] = ESTIMATE if how["latency_s"] == ESTIMATE else None
        asked = {key: how.pop(key) for key in ("lines", "expected", "accept_units", "report")}
        found, files, _ = results(
            output / name,
            asked.pop("lines"),
            output,
            **asked,
            options=how,
            seen=seen,
        )
        write_results(output, files)
    if as_json:
        say_json(json_with_verdict(found, files["calibration.json"]))
        return found
    print_calibration(console(), found)
    said = ", ".join(str(output / one) for one in (name, *files))
    console().print(f"Wrote {said}", soft_wrap=True)
    return found


def _words(running: Live, recording: Path, lines: Path, output: Path, options: dict[str, Any]) -> list[str]:
    """The command line that calibrates the recording to the same."""
    words = [str(recording), "--lines", str(lines), "-o", str(output), *as_recorded(running, options)]
    for option in calibrate.params:
        if option.name in HANDED_ON and typed((option.name,)):
            words += [option.opts[0], _word(options[option.name])]
    words += ["--overwrite"] * bool(options["overwrite"]) + ["--no-report"] * (not options["report"])
    return words


def _word(value: Any) -> str:
    return ",".join(map(str, value)) if isinstance(value, tuple) else str(value)
