"""What is scanned: points, lines and planes, from their own file or a PLUS device set.

A new format of targets is a file here that ends with its `FORMAT`, and a line in `formats.FORMATS`.
"""

from sonocal.targets.device_set import DeviceSet, Stated, read_device_set
from sonocal.targets.formats import read_lines, read_targets_and_fixed, read_unplaced
from sonocal.targets.lines import Line, Plane, Point, Target, check_lines, require_lines
from sonocal.targets.phantom import Phantom
from sonocal.targets.toml_file import (
    Targets,
    in_phantom,
    lines_toml,
    read_points_toml,
    read_targets,
    write_lines,
)
from sonocal.targets.unplaced import Unplaced

__all__ = [
    "DeviceSet",
    "Line",
    "Phantom",
    "Plane",
    "Point",
    "Stated",
    "Target",
    "Targets",
    "Unplaced",
    "check_lines",
    "in_phantom",
    "lines_toml",
    "read_device_set",
    "read_lines",
    "read_points_toml",
    "read_targets",
    "read_targets_and_fixed",
    "read_unplaced",
    "require_lines",
    "write_lines",
]
