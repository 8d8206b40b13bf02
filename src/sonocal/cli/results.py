"""What a calibration of a table or of a recording ends in, for every command that makes one."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from sonocal.cli.existing import choice_of, refuse_choice
from sonocal.cli.from_recording import OF_DETECTION, Result, at_lag, at_places, from_recording
from sonocal.cli.others import misread_records
from sonocal.cli.reading import OF_READING
from sonocal.cli.report import pictured
from sonocal.cli.told import refuse_units, rotation_of, unit_doubts
from sonocal.errors import SonocalError

if TYPE_CHECKING:
    from sonocal.calibration import Calibration
    from sonocal.existing import Choice, Existing

__all__ = ["OF_RECORDINGS", "Results", "is_table", "parted", "results"]

OF_RECORDINGS = ("points", "probe", *OF_READING, *OF_DETECTION)


class Results(NamedTuple):
    """What a calibration ends in.

    Attributes:
        calibration: what was found.
        files: what is written of it, by name.
        rereadings: how what --expected names is right, where it was misread.
    """

    calibration: Calibration
    files: dict[str, bytes]
    rereadings: list[dict[str, Any]]


def results(
    source: Path,
    lines: Path | None,
    output: Path | None,
    *,
    expected: Path | None,
    accept_units: bool,
    report: bool,
    options: dict[str, Any],
    seen: Any = None,
) -> Results:
    """Calibrate, and make the files that are written of it.

    Args:
        source: a table or a recording.
        lines: what is scanned, of a recording.
        output: where the contact sheet stays if no calibration is found; nowhere if None.
        expected: another calibration, whose rotation is expected.
        accept_units: that implausible units are meant.
        report: whether the page is among the files.
        options: the others of the command line.
        seen: what was detected in the images, where that is known.
    """
    from sonocal.calibration import calibration_json
    from sonocal.cli.report import report_files

    options, recorded, choice = parted(options, accept_units=accept_units)
    expectation = _expected(expected, choice)
    options["expected_rotation"] = None if expectation is None else rotation_of(expectation)
    result = (
        from_recording(source, lines, output, recorded, options, seen=seen)
        if lines is not None and not is_table(source)
        else _from_table(source, lines, options, accept_units=accept_units)
    )
    found = result.calibration if expectation is None else _against(result.calibration, expectation)
    refuse_units(source.name, found.diagnostics, accepted=accept_units)
    files = {"calibration.json": calibration_json(found), **result.files}
    if report:
        files |= report_files(found, result.rows, **pictured(result))
    return Results(found, files, misread_records(expectation, found))


def parted(options: dict[str, Any], *, accept_units: bool) -> tuple[dict[str, Any], dict[str, Any], Choice]:
    """The options of `sonocal.calibrate`, those of recordings, and which matrix of another file is meant."""
    options = dict(options)
    recorded = {name: options.pop(name) for name in OF_RECORDINGS} | {"accept_units": accept_units}
    return options, recorded, choice_of(options)


def _expected(path: Path | None, choice: Choice) -> Calibration | Existing | None:
    from sonocal.cli.formats import calibration_in

    found = None if path is None else calibration_in(path, choice)
    refuse_choice(found)
    return found


def _against(found: Calibration, expected: Calibration | Existing) -> Calibration:
    from sonocal.existing.expected import against_expected

    return against_expected(found, expected)


def _from_table(source: Path, targets: Path | None, options: dict[str, Any], *, accept_units: bool) -> Result:
    import sonocal
    from sonocal.cli.formats import targets_in

    rows = sonocal.read_observations(source)
    if targets is not None:
        options |= {"targets": targets_in(targets)[0]}
    try:
        found = sonocal.calibrate(rows, **options)
        if found.targets:
            return at_places(rows, found)
        return Result(rows, found, {}) if found.latency_s is None else at_lag(rows, found)
    except SonocalError:
        refuse_units(source.name, unit_doubts(rows=rows), accepted=accept_units)
        raise


def is_table(source: Path) -> bool:
    """Whether a file is a table of sightings."""
    from sonocal.cli.formats import kind_of

    return source.exists() and not source.is_dir() and kind_of(source) == "observations"
