"""What is scanned: lines and points of tools, from their own file or a PLUS device set."""

from sonocal.targets.device_set import DeviceSet, read_device_set, read_lines
from sonocal.targets.lines import Line, Point, check_lines, lines_toml, read_points_toml, write_lines

__all__ = [
    "DeviceSet",
    "Line",
    "Point",
    "check_lines",
    "lines_toml",
    "read_device_set",
    "read_lines",
    "read_points_toml",
    "write_lines",
]
