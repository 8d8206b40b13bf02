"""What of a phantom a stylus can touch or be dragged along: points, lines and planes, and what these leave free."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sonocal.geometry import Array
from sonocal.geometry.shown import brief
from sonocal.targets import Line, Plane, Point, Target
from sonocal.targets.unplaced import kind_of

__all__ = ["Feature", "features_of", "free_motions"]

# Of a face that nothing of the phantom is in front of by more than the first, and something behind by the second, mm.
LEVEL_MM, BEHIND_MM = 1.0, 3.0
# Of the largest singular value: below it a motion changes nothing. Files round to so much.
FREE = 1e-3


@dataclass(frozen=True, eq=False)
class Feature:
    """A point, a line or a plane of a phantom, in its frame.

    Attributes:
        name: of it.
        kind: "point", "line" or "plane".
        spanning_mm: (1, 3), (2, 3) or (3, 3).
        outward: (3,): the unit normal of a plane that all of the phantom is behind; None of others.
    """

    name: str
    kind: str
    spanning_mm: Array
    outward: Array | None = None

    __repr__ = brief

    @property
    def direction(self) -> Array:
        """(3,): along a line, or at right angles to a plane: outward, where that is known."""
        if self.kind == "line":
            along = self.spanning_mm[1] - self.spanning_mm[0]
            return np.asarray(along / np.linalg.norm(along))
        return _normal(self.spanning_mm) if self.outward is None else self.outward

    @property
    def normals(self) -> Array:
        """(M, 3): along which it is held."""
        if self.kind == "point":
            return np.eye(3)
        across = self.direction[None]
        return np.asarray(np.linalg.svd(across)[2][1:]) if self.kind == "line" else across

    def scaled(self, factors: Array) -> Feature:
        """With the places multiplied along the axes of the frame."""
        outward = None if self.outward is None else self.outward / factors
        return Feature(
            self.name,
            self.kind,
            self.spanning_mm * factors,
            None if outward is None else outward / np.linalg.norm(outward),
        )


def features_of(
    landmarks: Sequence[Point], dragged: Sequence[Target], others: Sequence[Target] = ()
) -> tuple[Feature, ...]:
    """The landmarks, then what the stylus is dragged along; a face that all else is behind knows its outside.

    Args:
        landmarks: points, to touch.
        dragged: lines and planes.
        others: more of the phantom, such as its wires.
    """
    solid = [one for one in (*landmarks, *dragged, *others) if isinstance(one, (Point, Line))]
    body = np.concatenate([one.spanning_mm for one in solid]) if solid else np.zeros((0, 3))
    made = [Feature(one.name, "point", one.spanning_mm) for one in landmarks]
    for one in dragged:
        outward = _outward(one.spanning_mm, body) if isinstance(one, Plane) else None
        made.append(Feature(one.name, kind_of(one), one.spanning_mm, outward))
    return tuple(made)


def free_motions(features: Sequence[Feature]) -> tuple[str, ...]:
    """Motions of a phantom that change nothing of these, in its frame: sentence parts; none if they hold it.

    n . (w x p + v) = 0        n: a direction that a feature is held along, at its spanning point p
    """
    places = np.concatenate([np.repeat(one.spanning_mm, len(one.normals), axis=0) for one in features])
    normals = np.concatenate([np.tile(one.normals, (len(one.spanning_mm), 1)) for one in features])
    arms = places - places.mean(axis=0)
    arms = arms / max(float(np.linalg.norm(arms, axis=1).max()), 1e-9)
    shifts = _null_space(normals)
    free = _null_space(np.hstack([np.cross(arms, normals), normals]))
    # What turns, once shifts alone are taken out.
    axes, sizes, _ = np.linalg.svd(free[:3])
    turns = axes[:, : int(np.sum(sizes > FREE))].T
    return (
        *(f"it may slide along {_text(along)}" for along in shifts.T),
        *(f"it may turn about {_text(axis)}" for axis in turns),
    )


def _null_space(rows: Array) -> Array:
    _, sizes, vt = np.linalg.svd(rows, full_matrices=True)
    return np.asarray(vt[int(np.sum(sizes > FREE * sizes[0])) :].T)


def _text(axis: Array) -> str:
    axis = axis * np.sign(axis[np.argmax(np.abs(axis))])
    return "(" + ", ".join(f"{x:.2f}" for x in np.round(axis, 2) + 0.0) + ")"


def _outward(spanning: Array, body: Array) -> Array | None:
    normal = _normal(spanning)
    heights = (body - spanning[0]) @ normal
    if not len(heights):
        return None
    if heights.max() <= LEVEL_MM and heights.min() < -BEHIND_MM:
        return normal
    return -normal if heights.min() >= -LEVEL_MM and heights.max() > BEHIND_MM else None


def _normal(spanning: Array) -> Array:
    across = np.cross(spanning[1] - spanning[0], spanning[2] - spanning[0])
    return np.asarray(across / np.linalg.norm(across))
