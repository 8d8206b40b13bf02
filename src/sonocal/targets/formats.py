"""The formats that targets are read from, and what a calibration reads of any of them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from sonocal.errors import InputError
from sonocal.files import path_of
from sonocal.files.elsewhere import refuse_other_kind
from sonocal.files.kinds import Format, Head, recognise
from sonocal.geometry import Array
from sonocal.targets import device_set, toml_file
from sonocal.targets.lines import Line, Target, check_lines
from sonocal.targets.unplaced import Unplaced

__all__ = ["FORMATS", "read_lines", "read_targets_and_fixed", "read_unplaced"]

FORMATS: tuple[Format, ...] = (toml_file.FORMAT, device_set.FORMAT)


def read_lines(path: str | Path) -> tuple[tuple[Line, ...], Mapping[tuple[str, str], Array]]:
    """Needles and wires from a ``.toml`` or from a PLUS device set.

    Returns:
        The lines, and the constant transforms that come with them (none with a ``.toml``).

    Raises:
        InputError: the file holds no line.
    """
    path = path_of(path)
    refuse_other_kind(path, "targets", "device set")
    if recognise(Head.of(path), FORMATS) is not device_set.FORMAT:
        return toml_file.read_lines_toml(path), {}
    devices = device_set.read_device_set(path)
    if not devices.wires:
        raise InputError(
            f"{path.name}: describes no phantom wires; name a device set with a PhantomDefinition"
        )
    return devices.wires, devices.transforms


def read_targets_and_fixed(
    path: str | Path,
) -> tuple[tuple[Target, ...], Mapping[tuple[str, str], Array]]:
    """Points, lines and planes from a ``.toml``, or wires from a PLUS device set.

    Returns:
        The targets, and the constant transforms that come with them (none with a ``.toml``).

    Raises:
        InputError: the file holds no target, or two of one name.
    """
    path = path_of(path)
    if recognise(Head.of(path), FORMATS) is device_set.FORMAT:
        return read_lines(path)
    found = toml_file.read_targets(path)
    if found.unplaced and not (found.lines or found.points or found.planes):
        raise InputError(
            f"{path.name}: has no target whose place is known, and this needs one; say where one of them is"
        )
    targets: tuple[Target, ...] = (*found.lines, *found.points, *found.planes)
    check_lines(path.name, targets, "targets")
    return targets, {}


def read_unplaced(path: str | Path) -> tuple[Unplaced, ...]:
    """Targets whose place is unknown, or known roughly, from a ``.toml``; none, where the file has none of them.

    Raises:
        InputError: the file cannot be read, or two targets have one name.
    """
    path = path_of(path)
    refuse_other_kind(path, "targets", "device set")
    if recognise(Head.of(path), FORMATS) is device_set.FORMAT:
        return ()
    found = toml_file.read_targets(path)
    check_lines(path.name, (*found.lines, *found.points, *found.planes, *found.unplaced), "targets")
    return found.unplaced
