"""What a file is that was given in another's place: told by its first bytes, without the readers of either."""

from __future__ import annotations

import re
from pathlib import Path

from sonocal.errors import FormatError
from sonocal.files.kinds import Head, Kind

__all__ = [
    "NAMES",
    "USES",
    "is_checks",
    "is_known_points",
    "is_observations",
    "is_own_page",
    "is_points",
    "is_study",
    "is_truth",
    "refuse_other_kind",
]

NAMES: dict[Kind, str] = {
    "calibration": "a JSON file",
    "checks": "a log of checks of a calibration",
    "device set": "a device set of PLUS",
    "known points": "a table of points whose place is known",
    "matrix": "a matrix, such as a calibration of other software",
    "observations": "a table of sightings",
    "page": "a page to read that sonocal wrote",
    "points": "a table of points found in images",
    "recording": "a recording",
    "study": "what a study found",
    "targets": "a file of needles, wires or points",
    "truth": "the truth of a simulated sweep",
}
USES: dict[Kind, str] = {
    "calibration": "a calibration is read by sonocal.load, and by sonocal info, validate and export",
    "checks": "give it to sonocal info (in Python: validation.read_check_log)",
    "device set": "give it with --lines (in Python: targets.read_lines)",
    "known points": "give it to sonocal validate (in Python: validation.read_point_sightings)",
    "matrix": "give it to sonocal info, validate or export (in Python: existing.read_existing)",
    "observations": "give it to sonocal calibrate alone, it has its lines in it (in Python: read_observations)",
    "page": "open it in a browser, or give it to sonocal info",
    "points": "give it to sonocal calibrate with --points, beside its recording (in Python: detection.read_detections)",
    "study": "give it to sonocal info",
    "recording": "give it to sonocal calibrate with --lines (in Python: read_recording)",
    "targets": "give it with --lines (in Python: targets.read_lines)",
    "truth": "give it to sonocal info; its recording and needle lie beside it",
}
# Ends of a line that was seen: with a unit as they should have, or with another or none.
END = re.compile(r"[xyz][01](_\w*)?|probe_from_target_\d\d")


def is_observations(head: Head) -> bool:
    """Whether it is a table of sightings, be it one whose columns are misnamed."""
    return any(END.fullmatch(column) for column in head.columns)


def is_points(head: Head) -> bool:
    """Whether it is a table of points found in images."""
    return _has_points(head) and not _has_known_place(head)


def is_known_points(head: Head) -> bool:
    """Whether it is a table of points whose place is known."""
    return _has_points(head) and _has_known_place(head)


def is_truth(head: Head) -> bool:
    """Whether it is the truth of a simulated sweep."""
    return head.text.startswith(b"{") and b'"sonocal-truth"' in head.text[:200]


def is_checks(head: Head) -> bool:
    """Whether it is a log of checks."""
    return head.text.startswith(b"{") and b'"sonocal-check"' in head.text[:4000]


def is_study(head: Head) -> bool:
    """Whether it is what a study found: a folder of results, or one of the files that are for people and programs."""
    if head.path.is_dir():
        manifest = head.path / "manifest.json"
        return manifest.is_file() and is_study(Head.of(manifest))
    if head.text.startswith(b"{"):
        return b'"sonocal-study"' in head.text[:200] or re.match(rb'\{\s*"study"\s*:', head.text) is not None
    return {"method", "stage", "quantity", "failed"} <= set(head.columns)


def is_own_page(head: Head) -> bool:
    """Whether it is a page that sonocal wrote."""
    return head.is_page and b'name="generator" content="sonocal"' in head.content


def refuse_other_kind(path: Path, *wanted: Kind) -> None:
    """Raise if a file is plainly of another kind than its reader reads; what is damaged is left to the reader.

    Args:
        path: a file; of a directory its reader speaks.
        *wanted: what the reader reads.

    Raises:
        FormatError: it is of another kind; the sentence says which, and who takes it.
        InputError: it cannot be read.
    """
    kind = None if path.is_dir() else _plain_kind(Head.of(path))
    if kind is not None and kind not in wanted:
        raise FormatError(f"{path.name}: is {NAMES[kind]}; {USES[kind]}")


def _plain_kind(head: Head) -> Kind | None:
    signs: dict[Kind, bool] = {
        "observations": is_observations(head),
        "known points": is_known_points(head),
        "points": is_points(head),
        "targets": head.suffix == ".toml" and head.text.startswith((b"[", b"#")),
        "calibration": head.text.startswith(b"{"),
        "device set": b"<PlusConfiguration" in head.text,
        "matrix": "TransformGroup" in head.hdf5_names,
        "recording": head.text.startswith((b"NRRD0", b"ObjectType", b"NDims")),
    }
    return next((kind for kind, shown in signs.items() if shown), None)


def _has_points(head: Head) -> bool:
    return "u_px" in head.columns and not is_observations(head)


def _has_known_place(head: Head) -> bool:
    return not {"x_mm", "probe_00"}.isdisjoint(head.columns)
