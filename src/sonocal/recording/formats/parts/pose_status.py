"""Columns that say of each pose of a table whether it holds: ``Probe_status``, ``Probe_valid``, ``Probe_lost``."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

import numpy as np

from sonocal.errors import InputError
from sonocal.files.tables import Table
from sonocal.recording.poses import Poses

__all__ = ["status_columns", "with_status"]

# What a column's name ends with. PLUS's own, of a matrix in a cell, knows one word that holds; others have many.
ENDS = re.compile(
    r"(?P<of>.*?)_?(?:is_?)?(?P<word>status|(?<!in)valid|(?<!in)visible|(?<!un)tracked|invalid|invisible|untracked|lost|occluded)"
)
# Of these a pose holds where the column says no.
DENIALS = ("invalid", "invisible", "untracked", "lost", "occluded")
NO, YES = {"", "0", "0.0", "false", "no"}, {"1", "1.0", "true", "yes"}
PLUS_S = "transformstatus"
GOOD = {"ok", "1", "1.0", "true", "valid", "tracked", "visible", "yes", "good"}
BAD = {
    *("", "0", "0.0", "false", "no", "none", "nan", "na", "n/a", "invalid", "missing", "lost", "occluded"),
    *(
        "not valid",
        "not visible",
        "not tracked",
        "invisible",
        "untracked",
        "out_of_view",
        "out of view",
        "bad",
    ),
    *("out of volume", "disabled"),
}
# Longer names are no column's of a status.
LONGEST = 120


def status_columns(header: Iterable[str]) -> dict[str, str]:
    """The columns of status, by the plain name of what they are of."""
    found: dict[str, str] = {}
    for name in header:
        plain = _plain(name)
        if len(plain) <= LONGEST and (match := ENDS.fullmatch(plain)):
            found.setdefault(match["of"], name)
    return found


def with_status(
    table: Table, statuses: Mapping[str, str], poses: Poses, of: str, alone: bool = False
) -> Poses:
    """Poses, of which those hold that their column of status says so of.

    Args:
        table: that they are from.
        statuses: see `status_columns`.
        poses: of one tool.
        of: what the tool's columns, or its one column, are called by.
        alone: whether the table holds no other tool, so that a column of nobody is of this one.

    Raises:
        InputError: of no pose it says that it holds, in words that are not known to say the contrary.
    """
    column = statuses.get(_plain(of), statuses.get("") if alone else None)
    if column is None:
        return poses
    status = tuple(map(str, table.text(column)))
    words = [text.lower() for text in status]
    denies = _plain(column).endswith(DENIALS)
    good = np.array([word in (NO if denies else GOOD) for word in words])
    if denies or (not good.any() and not _plain(column).endswith(PLUS_S)):
        known = NO | YES if denies else BAD
        row = next((row for row, word in enumerate(words) if word not in known), None)
        if row is not None:
            raise InputError(
                f"{table.name}, line {table.lines[row]}, column {column}: {status[row][:40]!r} does not say whether a "
                f"pose holds; write {'0 or false' if denies else 'OK, 1 or true'} where it does, or rename the column"
            )
    return Poses(poses.source, poses.target, poses.matrices, poses.valid & good, status)


def _plain(name: str) -> str:
    return re.sub(r"[ ._:/-]", "_", name).strip("_").lower()
