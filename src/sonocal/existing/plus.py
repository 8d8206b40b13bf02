"""PLUS: the transforms of a device set or of a result of fCal, whose ImageToProbe is the calibration.

How such a file is known and read is in `sonocal.targets.device_set`, since it holds the phantom's wires, too.
"""

from __future__ import annotations

from pathlib import Path

from sonocal.errors import InputError
from sonocal.existing.matrix import Matrices, Stored
from sonocal.targets import DeviceSet, Stated, read_device_set
from sonocal.targets.device_set import FORMAT

__all__ = ["matrices_of", "read_plus"]


def read_plus(path: Path) -> Matrices:
    """The transforms of a device set.

    Raises:
        FormatError, InputError: as `read_device_set`; or it has no transform.
    """
    return matrices_of(read_device_set(path))


def matrices_of(devices: DeviceSet) -> Matrices:
    """The transforms of a device set that was read.

    Raises:
        InputError: it has none.
    """
    if not devices.transforms:
        raise InputError(
            f"{devices.name}: has no Transform in its CoordinateDefinitions; name the device set, or the results file, "
            "that fCal wrote ImageToProbe into"
        )
    stored = []
    for (target, source), matrix in devices.transforms.items():
        said = devices.stated.get((target, source), Stated())
        stored.append(
            Stored(
                f"{source}To{target}",
                matrix,
                (source, target),
                stated_error_mm=said.error_mm,
                date=said.date,
            )
        )
    return Matrices(devices.name, FORMAT.name, tuple(stored))
