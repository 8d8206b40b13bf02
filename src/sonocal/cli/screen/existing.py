"""What the command line shows of a matrix that other software made: what it means, and what it is worth."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.padding import Padding
from rich.text import Text

from sonocal.cli.screen.parts import finding, print_findings, verdict_text
from sonocal.cli.screen.tables import MatrixRows, NumberTable
from sonocal.existing import Existing, Matrices, meaning_of
from sonocal.existing.difference import Difference
from sonocal.existing.meaning import matrix_findings
from sonocal.existing.worth import MATRIX_ALONE, Worth
from sonocal.findings import begun
from sonocal.geometry import Array, Similarity
from sonocal.validation import CANNOT_SHOW, Quantity, give_verdict

__all__ = [
    "OWN",
    "Section",
    "difference_section",
    "existing_record",
    "meaning_sentences",
    "print_difference",
    "print_existing",
    "print_worth",
    "quantities_in_turn",
    "remarks",
    "tip_sentences",
]

OWN = "Against our own calibration of the same rows"
# Of a rotation's entries: a tip that PLUS wrote may be turned, so that its x axis lies along the shaft.
UNTURNED = 1e-6


def print_existing(console: Console, existing: Existing, *, numbers: bool = True) -> None:
    """What is odd first, then the matrix, unless its numbers are on the screen already, and its meaning."""
    print_findings(console, matrix_findings(existing), "warning")
    console.print(_matrix(existing, numbers=numbers))
    print_findings(console, matrix_findings(existing), "info")


def print_worth(console: Console, worth: Worth, against: Mapping[str, Difference]) -> None:
    """The answer, the numbers, how far from ours and from others, what it means, what cannot be said."""
    console.print(Text(worth.sentence, style="bold"))
    if worth.own is not None:
        console.print(Text("Ours: ").append_text(verdict_text(give_verdict(worth.own))))
    console.print()
    if worth.quantities:
        console.print(_numbers(worth))
        console.print(Text("What they are:", style="bold"))
        for title, definition in _definitions(worth):
            console.print(_indented(f"{title}: {definition}."))
        console.print()
    if worth.difference is not None:  # whose sentence is part of the answer, unless it was misread
        print_difference(console, worth.difference, OWN, said_already=not worth.rereadings)
    if worth.scale_sentence:
        console.print(Text(worth.scale_sentence))
        console.print()
    for other, apart in against.items():
        print_difference(console, apart, f"Against {other}")
    console.print(_matrix(worth.reread or worth.existing, how=", read so" if worth.reread else ""))
    console.print(Text(f"{CANNOT_SHOW}:", style="bold"))
    console.print(_indented(MATRIX_ALONE))
    print_findings(console, worth.diagnostics)


def print_difference(console: Console, apart: Difference, title: str, *, said_already: bool = False) -> None:
    """How far apart at the corners, turned by how much, with which scales."""
    section = difference_section(title, apart)
    table = NumberTable(f"{title}, mm", *section.columns)
    for place, numbers in section.rows:
        table.add_row(f"at {place} px", *numbers)
    console.print(table)
    for sentence in section.sentences[said_already:]:
        console.print(Text(sentence))
    console.print()


def remarks(existing: Existing) -> RenderableType:
    """What is odd about a matrix that goes from one program to another, or its scale."""
    u, v, _ = meaning_of(existing.matrix).scales_mm_per_px
    said = Text(f"{begun(existing.said)}: {u:.5f} mm/px along u, {v:.5f} along v; no verdict is known of it.")
    return Group(said, *map(finding, matrix_findings(existing)))


def existing_record(existing: Existing) -> dict[str, Any]:
    """A matrix and its meaning, for programs."""
    meaning = meaning_of(existing.matrix)
    return {
        "file": existing.file,
        "format": existing.format,
        "transform": existing.transform,
        "probe_from_image": existing.matrix,
        "scale_mm_per_px": meaning.scales_mm_per_px,
        "rotation_wxyz": Similarity(meaning.rotation, meaning.offset_mm, 1.0).quaternion_wxyz,
        "translation_mm": meaning.offset_mm,
        "axes_deg": meaning.uv_deg,
        "stated_error_mm": existing.stated_error_mm,
        "date": existing.date,
    }


def tip_sentences(matrices: Matrices) -> list[str]:
    """What the transforms of tools' tips say, such as StylusTipToStylus of PLUS."""
    said = []
    for one in matrices:
        source, _, target = one.name.partition("To")
        if not source.lower().endswith("tip") or not target:
            continue
        place = ", ".join(f"{x:.2f}" for x in one.matrix[:3, 3])
        turned = np.abs(one.matrix[:3, :3] - np.eye(3)).max() > UNTURNED
        error = (
            ""
            if one.stated_error_mm is None
            else f"; the file states an error of {one.stated_error_mm:.3g} mm"
        )
        along = "; turned, so that its axes lie along the tool" if turned else ""
        said.append(f"{one.name} is a tool's tip: at ({place}) mm in the frame of {target}{along}{error}.")
    return said


def _matrix(existing: Existing, *, numbers: bool = True, how: str = "") -> RenderableType:
    title = f"{begun(existing.said)} ({existing.format}){how}: mm in the probe marker's frame from px"
    return Group(
        Text(title, style="bold"),
        *([MatrixRows(existing.matrix)] if numbers else []),
        *(Text(sentence) for sentence in meaning_sentences(existing)),
        Text(),
    )


def meaning_sentences(existing: Existing) -> list[str]:
    """Scales, axes and origin of a matrix in words, and the error that its file states."""
    meaning = meaning_of(existing.matrix)
    u, v, w = meaning.scales_mm_per_px
    directions = [_direction(column) for column in meaning.rotation.T]
    place = ", ".join(f"{x:.2f}" for x in meaning.offset_mm)
    said = [
        f"Scale: {u:.5f} mm/px along u, {v:.5f} along v; third column {w:.5f}. The scale is inside the matrix.",
        f"Axes in the marker's frame: u along {directions[0]}, v along {directions[1]}, {meaning.uv_deg:.2f} deg "
        f"apart; their normal along {directions[2]}; turned by {meaning.rotation_deg:.1f} deg.",
        f"The centre of the first pixel is at ({place}) mm.",
    ]
    if existing.stated_error_mm is not None:
        date = f", of {existing.date}" if existing.date else ""
        said.append(
            f"The file states an error of {existing.stated_error_mm:.6g} mm{date}, computed as the program that made "
            "it does."
        )
    return said


def _direction(column: Array) -> str:
    return "(" + ", ".join(f"{x:.3f}" for x in column) + ")"


def _numbers(worth: Worth) -> NumberTable:
    table = NumberTable(f"Errors on {worth.source}, mm", "value", "95 % interval", "spread", "from")
    for q in quantities_in_turn(worth):
        interval = "unknown" if math.isnan(q.low_mm) else f"{q.low_mm:.2f} to {q.high_mm:.2f}"
        found = f"{q.count} in {q.units} {q.unit}"
        table.add_row(q.title, f"{q.value_mm:.3f}", interval, f"{q.spread_mm:.2f}", found)
    return table


def quantities_in_turn(worth: Worth) -> list[Quantity]:
    """Each number of the matrix, of the same read so where it was misread, and ours below it."""
    rest = list(worth.own_quantities)
    read_so = list(worth.reread_quantities)
    both = []
    for i, one in enumerate(worth.quantities):
        both += [one, *read_so[i : i + 1], *rest[i : i + 1]]
    return [*both, *rest[len(worth.quantities) :]]


def _definitions(worth: Worth) -> list[tuple[str, str]]:
    """One for each definition, whoever's the number is."""
    known = {q.definition: q.title for q in reversed(quantities_in_turn(worth))}
    return [(title, definition) for definition, title in reversed(known.items())]


class Section(NamedTuple):
    """What is shown of a difference, in the terminal and on a page.

    Attributes:
        title: of the table.
        columns: of its numbers, all in mm.
        rows: a place, px, and the numbers there.
        sentences: how far apart, then how turned and scaled.
    """

    title: str
    columns: tuple[str, ...]
    rows: list[tuple[str, list[str]]]
    sentences: list[str]


def difference_section(title: str, apart: Difference) -> Section:
    """How far apart two matrices are: of one that was misread as it was read, too, and in words only read so."""
    meant = apart.reread or apart
    columns, numbers = ["apart"], [[distance] for _, distance, _ in apart.rows]
    sentence = meant.sentence
    if apart.reread is not None:
        because = f"{begun(apart.because)}. " if apart.because else ""
        columns = ["apart as read", "read so"]
        sentence = f"{because}Read so, {sentence[0].lower()}{sentence[1:]}"
        numbers = [[*row, distance] for row, (_, distance, _) in zip(numbers, meant.rows, strict=True)]
    if meant.known_mm is not None:
        columns.append(f"{apart.other} known to (95 %, all at once)")
        numbers = [[*row, known] for row, known in zip(numbers, meant.known_mm.tolist(), strict=True)]
    rows = [(place, [f"{x:.2f}" for x in row]) for (place, *_), row in zip(meant.rows, numbers, strict=True)]
    return Section(title, tuple(columns), rows, [sentence, _turned_and_scaled(meant)])


def _turned_and_scaled(apart: Difference) -> str:
    parts = [
        f"{mine:.5f} against {other:.5f} mm/px along {axis} ({100 * ratio:+.2f} %)"
        for axis, mine, other, ratio in zip(
            "uvw", apart.scales_mm_per_px, apart.other_scales_mm_per_px, apart.scale_ratios, strict=False
        )
    ]
    return f"Turned by {apart.rotation_deg:.2f} deg; {', '.join(parts)}."


def _indented(text: str) -> RenderableType:
    return Padding(Text(text), (0, 0, 0, 2), expand=False)
