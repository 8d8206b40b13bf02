"""What the studio opens and exports, by the very steps of ``sonocal calibrate``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sonocal.cli.calibrate import calibrate
from sonocal.cli.from_recording import given_recording
from sonocal.cli.reading import ESTIMATE
from sonocal.cli.results import parted, results
from sonocal.cli.tool import OF_OTHER_TOOLS, found_tool, tool
from sonocal.errors import InputError

if TYPE_CHECKING:
    from sonocal.existing import Choice
    from sonocal.observations import Observations
    from sonocal.studio.beside import Words
    from sonocal.studio.marks import Marks
    from sonocal.studio.needle import Asked
    from sonocal.studio.work import Work
    from sonocal.tools import ToolCalibration

__all__ = ["Openings"]

POINTS, TABLE = "points.csv", "observations.csv"
# Of the command's parameters, what is no option of a calibration.
OTHERS = ("source", "lines", "output", "overwrite", "as_json")


class Openings:
    """Opens recordings and tables for the studio."""

    def __init__(self, folder: Path, reading: Sequence[str], choice: Choice | None = None) -> None:
        """Begin.

        Args:
            folder: of the session.
            reading: further arguments of ``sonocal calibrate``.
            choice: which matrix of files of other software to compare with.
        """
        self._folder, self._reading, self._choice = folder, list(reading), choice

    def open(self, source: Path, lines: Path | None) -> Work:
        """A recording with its targets, or without any, or a table.

        Raises:
            SonocalError: as ``sonocal calibrate``.
        """
        from sonocal.cli.formats import kind_of

        kind = None if source.is_dir() else kind_of(source)
        if kind == "observations":
            return self._table(source)
        if lines is None:
            return self._bare(source)
        return self._recording(source, lines)

    def tool(self, asked: Asked) -> ToolCalibration:
        """What ``sonocal tool`` finds of a pivot and a spin.

        Raises:
            SonocalError: as that.
        """
        words = [*map(str, filter(None, [asked.pivot])), "--tool", asked.tool]
        words += ["--spin", str(asked.spin)] * (asked.spin is not None)
        words += ["--length", repr(asked.length_mm)] * (asked.length_mm is not None)
        with _parsed(words, tool) as context:
            options = {name: value for name, value in context.params.items() if name not in OF_OTHER_TOOLS}
            return found_tool(asked.pivot, options, accept_units=False)

    def other(self, path: Path) -> Words:
        """What ``sonocal validate --compare`` says of another calibration, ours or of other software.

        Raises:
            SonocalError: as that.
        """
        from sonocal.calibration import Calibration
        from sonocal.cli.formats import calibration_in

        other = calibration_in(path, self._choice)

        def words(found: Calibration) -> list[str]:
            from sonocal.existing.compared import compared
            from sonocal.validation import compare

            if isinstance(other, Calibration):
                return [compare(found, other).sentence]
            beside = compared(other, found)
            misread = [f"{other.said} {way.words}: {way.advice}." for way in beside.rereadings]
            misread = [sentence[0].upper() + sentence[1:] for sentence in misread]
            return [f"Ours and {other.said}: {beside.difference.sentence}", *misread]

        return words

    def _recording(self, source: Path, lines: Path) -> Work:
        from sonocal.detection import Detections
        from sonocal.studio.work import RecordingWork

        arguments = [str(source), "--lines", str(lines), *self._reading]
        with _parsed(arguments) as context:
            options, recorded, _ = parted(_options(context), accept_units=False)
            read = given_recording(source, lines, recorded, options | {"expected_rotation": None})

        def files(marks: Marks, seen: Detections | Sequence[Detections] | None) -> dict[str, bytes]:
            return (
                self._of_points(source, lines, arguments, marks)
                if seen is None
                else self._written(source, lines, arguments, seen)
            )

        return RecordingWork(
            read.recording,
            read.targets,
            _inputs(recording=source, targets=lines),
            looking=read.looking,
            fitting=read.fitting,
            files=files,
        )

    def _bare(self, source: Path) -> Work:
        from sonocal.cli.reading import read_given
        from sonocal.studio.work import BareWork

        with _parsed([str(source), "--lines", str(source), *self._reading]) as context:
            _, recorded, _ = parted(_options(context), accept_units=False)
            return BareWork(read_given(source, recorded), _inputs(recording=source))

    def _table(self, source: Path) -> Work:
        from sonocal.observations import read_observations
        from sonocal.studio.work import TableWork

        rows = read_observations(source)
        with _parsed([str(source)]) as context:
            options, _, _ = parted(_options(context), accept_units=False)
        return TableWork(
            rows, _inputs(table=source), fitting=options | {"expected_rotation": None}, files=self._of_rows
        )

    def _of_points(self, source: Path, lines: Path, arguments: list[str], marks: Marks) -> dict[str, bytes]:
        """Of points that somebody looked at: the file of them is what the command line reads."""
        from sonocal.studio.marks import points_csv

        content = points_csv(marks)
        path = self._kept(POINTS, content)
        written = self._written(source, lines, [*arguments, "--points", str(path)])
        return {POINTS: content, **written}

    def _of_rows(self, rows: Observations) -> dict[str, bytes]:
        from sonocal.observations.table_file import as_file

        content, _ = as_file(rows, TABLE)
        path = self._kept(TABLE, content)
        return {TABLE: content, **self._written(path, None, [str(path)])}

    def _written(
        self, source: Path, lines: Path | None, arguments: list[str], seen: Any = None
    ) -> dict[str, bytes]:
        """What ``sonocal calibrate`` with these arguments writes, and the exports of that."""
        with _parsed(arguments) as context:
            options = _options(context)
            files = results(
                source,
                lines,
                None,
                expected=None,
                accept_units=False,
                report=True,
                options=options,
                seen=seen,
            ).files
        return files | _exports(files["calibration.json"])

    def _kept(self, name: str, content: bytes) -> Path:
        from sonocal.files import make_folder, write_atomically
        from sonocal.studio.desk import EXPORTED

        make_folder(self._folder / EXPORTED)
        path = self._folder / EXPORTED / name
        write_atomically(path, content)
        return path


def _parsed(arguments: list[str], of: click.Command = calibrate) -> click.Context:
    """``sonocal calibrate``, or another command, with some arguments, as its options find them."""
    try:
        return of.make_context(str(of.name), list(arguments))
    except click.ClickException as error:
        raise InputError(error.format_message()) from None


def _options(context: click.Context) -> dict[str, Any]:
    options = {name: value for name, value in context.params.items() if name not in OTHERS}
    for name in ("expected", "accept_units", "report"):
        del options[name]
    return options | {"latency": ESTIMATE if options["latency_s"] == ESTIMATE else None}


def _exports(calibration: bytes) -> dict[str, bytes]:
    """The files for other software, as ``sonocal export`` writes them: none where the verdict is not to use it."""
    from sonocal.calibration import parse_calibration
    from sonocal.export.itk import itk_tfm
    from sonocal.export.plus import plus_xml
    from sonocal.export.slicer import slicer_tfm
    from sonocal.validation import give_verdict

    found = parse_calibration(calibration, "calibration.json")
    if give_verdict(found).level == "stop":
        return {}
    return {
        "plus.xml": plus_xml(found),
        "ImageToProbe-itk.tfm": itk_tfm(found),
        "ImageToProbe-slicer.tfm": slicer_tfm(found),
    }


def _inputs(**paths: Path) -> dict[str, Any]:
    """Names and digests of what is edited: a journal is of these alone."""
    from sonocal.files import digest

    return {
        name: {"input": path.name, "sha256": "" if path.is_dir() else digest(path)}
        for name, path in paths.items()
    }
