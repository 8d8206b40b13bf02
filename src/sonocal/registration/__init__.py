"""Similarity registration of points, lines and planes; knows no ultrasound.

::

    from sonocal import registration as reg

    found = reg.register(reg.rows(reg.line_line(a, b), reg.point_plane(x, planes)))
    found.target_from_source.matrix         # (4, 4)
    reg.solvers.four_points(points, lines)  # minimal and linear solvers, batched
"""

from sonocal.registration import solvers
from sonocal.registration.associate import associate
from sonocal.registration.association import Association, RivalLabels
from sonocal.registration.constraints import (
    FreeMotion,
    Rows,
    line_line,
    line_plane,
    plane_plane,
    planes_of_lines,
    point_line,
    point_plane,
    point_point,
    rank,
    rows,
)
from sonocal.registration.model_test import ModelTest
from sonocal.registration.register import Registration, register
from sonocal.registration.unplaced import Place, Placed, UnplacedTarget, register_unplaced

__all__ = [
    "Association",
    "FreeMotion",
    "ModelTest",
    "Place",
    "Placed",
    "Registration",
    "RivalLabels",
    "Rows",
    "UnplacedTarget",
    "associate",
    "line_line",
    "line_plane",
    "plane_plane",
    "planes_of_lines",
    "point_line",
    "point_plane",
    "point_point",
    "rank",
    "register",
    "register_unplaced",
    "rows",
    "solvers",
]
