"""What a simulated tank holds: its floor and walls, threads that cross, threads alone."""

from __future__ import annotations

import numpy as np

from sonocal.errors import InputError
from sonocal.targets import Line, Plane, Point, Target

__all__ = ["ROOM", "SCENES", "scene_of"]

ROOM = "Tracker"
TANK_MM = 200.0
THREAD_MM = 120.0
SCENES = ("wall", "walls", "cross-wire", "cross-wires", "wires")


def scene_of(name: str) -> tuple[Target, ...]:
    """Targets of a scene: one wall, a floor and four walls, one cross-wire, four of them, or nine wires.

    Raises:
        InputError: there is no such scene.
    """
    if name in ("wall", "walls"):
        sides = [("floor", 2, -1), ("left", 0, -1), ("right", 0, 1), ("front", 1, -1), ("back", 1, 1)]
        return tuple(_wall(*side) for side in sides[: 1 if name == "wall" else 5])
    if name in ("cross-wire", "cross-wires"):
        places = np.array([[0.0, 0, 0], [40, 10, -15], [-35, 20, 10], [5, -40, -8]])
        count = 1 if name == "cross-wire" else 4
        return tuple(Point(f"cross {i + 1}", ROOM, place) for i, place in enumerate(places[:count]))
    if name == "wires":
        return tuple(_wire(i) for i in range(9))
    raise InputError(f"there is no scene {name!r}; there are {', '.join(SCENES)}")


def _wall(name: str, axis: int, side: int) -> Plane:
    """A side of the tank, seen from within."""
    middle = 0.5 * TANK_MM * side * np.eye(3)[axis]
    across = np.roll(np.eye(3), -axis, axis=0)[1:]
    corners = 2 * np.pi / 3 * np.arange(3)
    reach = 0.25 * TANK_MM * np.column_stack([np.cos(corners), np.sin(corners)])
    return Plane(name, ROOM, middle + reach @ across)


def _wire(index: int) -> Line:
    """Wires in three layers, of three directions."""
    layer, place = divmod(index, 3)
    angle = layer * np.pi / 3
    along, aside = (
        np.array([np.cos(angle), np.sin(angle), 0.1]),
        np.array([-np.sin(angle), np.cos(angle), 0.0]),
    )
    middle = 25.0 * (place - 1) * aside + 12.0 * (layer - 1) * np.array([0, 0, 1.0])
    return Line(f"wire {index + 1}", ROOM, middle + 0.5 * THREAD_MM * np.array([-along, along]))
