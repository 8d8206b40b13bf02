"""Tables of poses in which a row is of one tool, and a column says of which."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sonocal.errors import InputError
from sonocal.files.tables import Table
from sonocal.geometry import Array
from sonocal.recording.formats.parts.at_times import at_times
from sonocal.recording.poses import Poses

__all__ = ["joined_in_time", "rows_by_tool"]

NAMES = {
    *(
        "tool",
        "tool_name",
        "toolname",
        "tool_id",
        "name",
        "body",
        "rigid_body",
        "rigidbody",
        "object",
        "marker",
    ),
    *(
        "sensor",
        "sensor_id",
        "device",
        "port",
        "handle",
        "frame_id",
        "child_frame_id",
        "target",
        "source",
        "id",
    ),
}
# Of tools in a file.
MOST = 100


def rows_by_tool(table: Table) -> dict[str, Table]:
    """The rows of each tool, by its name; nothing where no column names them.

    A column whose cells differ from row to row counts the rows, and one whose cells are all alike names one tool.

    Raises:
        InputError: there are more tools than anybody tracks.
    """
    for column in table.header:
        if column.strip().lower().replace(" ", "_") not in NAMES:
            continue
        rows: dict[str, list[int]] = {}
        for row, cell in enumerate(table.columns[column]):
            rows.setdefault(cell.strip(), []).append(row)
        if "" in rows or not 1 < len(rows) <= len(table) / 2:
            continue
        if len(rows) > MOST:
            raise InputError(
                f"{table.name}, column {column}: names {len(rows)} tools, more than the {MOST} that are read; rename "
                "it if it names none"
            )
        return {name: _some(table, those) for name, those in rows.items()}
    return {}


def joined_in_time(name: str, poses: Sequence[Poses], stamps: Sequence[Array]) -> tuple[list[Poses], Array]:
    """The poses of several tools at the times of the first, and these.

    Raises:
        InputError: there are no times, or those of a tool do not increase.
    """
    times = stamps[0]
    if len(poses) > 1 and not all(np.isfinite(one).all() for one in stamps):
        raise InputError(
            f"{name}: its rows are of several tools and have no times; give them times, or each tool columns of its own"
        )
    return [at_times(one, at, times, name) for one, at in zip(poses, stamps, strict=True)], times


def _some(table: Table, rows: Sequence[int]) -> Table:
    columns = {name: tuple(cells[row] for row in rows) for name, cells in table.columns.items()}
    return Table(table.name, table.header, columns, tuple(table.lines[row] for row in rows), table.separator)
