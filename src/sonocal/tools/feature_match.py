"""Which touch is which landmark, and which drag along which line or plane: the largest sets that may stand together.

A touch and a drag, two drags, two touches have distances and angles that no motion changes: pairs of (what was seen,
feature) that agree in these are joined, and sets of which all are joined with all are tried, the largest first, by a
registration of known scale (`feature_poses`), all of whose answers are looked at. What a stylus cannot reach is none: a
face is touched from outside, a line between its ends.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sonocal.geometry import Array
from sonocal.geometry.shown import brief
from sonocal.tools.cliques import largest_cliques
from sonocal.tools.drags import Drag
from sonocal.tools.feature_fit import measured_of
from sonocal.tools.feature_pose import feature_poses
from sonocal.tools.features import Feature
from sonocal.tools.rests import Rest

__all__ = ["FeatureMatch", "Matches", "Seen", "match_features"]

# How far pairs may be from what the phantom's shape says: mm, and more the further apart, and rad.
APART_MM, APART_SHARE, ANGLE_RAD = 3.0, 0.03, np.deg2rad(4.0)
PARALLEL_RAD = np.deg2rad(8.0)
# Beyond a line's ends a stylus may slide by as much.
BEYOND_MM = 10.0
# A stylus leans from a face by more than that where its side is told: the cosine.
LEANS = 0.15
TRIED = 60
# Two drags that share more than this part of the shorter one are not of two features.
SHARED = 0.1
# Of numbers that are left of features beyond six: with fewer a set stands together by chance.
LEAST_SPARE = 2


@dataclass(frozen=True, eq=False)
class Seen:
    """A touch or a drag, and to which side of it the stylus was.

    Attributes:
        what: it.
        shaft: (3,): unit, from the tip towards the stylus' marker, on average.
    """

    what: Rest | Drag
    shaft: Array

    __repr__ = brief

    @property
    def kind(self) -> str:
        """Of the feature that it may be."""
        return self.what.kind if isinstance(self.what, Drag) else "point"

    @property
    def middle_mm(self) -> Array:
        """(3,): of where the tip was."""
        return self.what.middle_mm if isinstance(self.what, Drag) else self.what.point_mm

    @property
    def direction(self) -> Array:
        """(3,): along a line; of a plane to the side of the stylus; any of a touch."""
        if not isinstance(self.what, Drag):
            return np.zeros(3)
        axis = self.what.axes[0 if self.kind == "line" else 2]
        return np.asarray(axis if self.kind == "line" or axis @ self.shaft > 0 else -axis)

    @property
    def sided(self) -> bool:
        """Whether the stylus leaned enough to tell the side of a plane."""
        return self.kind == "plane" and bool(self.direction @ self.shaft > LEANS)


@dataclass(frozen=True, eq=False)
class FeatureMatch:
    """A way in which what was seen is features.

    Attributes:
        of: of each thing seen its feature's number; -1 of those that are none.
        matrix: (4, 4): frame of what was seen from that of the features.
        covered: how many features.
        squares: sum of squared distances, mm^2.
        numbers: how many distances they are of.
    """

    of: tuple[int, ...]
    matrix: Array
    covered: int
    squares: float
    numbers: int

    __repr__ = brief


class Matches(NamedTuple):
    """Ways in which what was seen fits features.

    Attributes:
        ways: most features first, of these the closest first.
        together: the most features that may stand together, whether they hold the phantom or not.
    """

    ways: list[FeatureMatch]
    together: tuple[int, ...]


def match_features(
    seen: Sequence[Seen], features: Sequence[Feature], within_mm: float, *, in_order: bool = False
) -> Matches:
    """The ways in which what was seen fits the features: most features first, of these the closest first.

    Args:
        seen: touches and drags, in the order recorded.
        features: of the phantom, in the order listed.
        within_mm: how far any may be from its feature.
        in_order: points were touched, and lines and planes dragged along, each in the order listed.
    """
    nodes = [(i, k) for i, one in enumerate(seen) for k, f in enumerate(features) if one.kind == f.kind]
    joined = np.zeros((len(nodes), len(nodes)), dtype=bool)
    for a in range(len(nodes)):
        for b in range(a):
            joined[a, b] = joined[b, a] = _agree(nodes[a], nodes[b], seen, features, in_order=in_order)
    found: dict[tuple[int, ...], FeatureMatch] = {}
    best = 0
    together: tuple[int, ...] = ()
    for clique in largest_cliques(joined, [k for _, k in nodes], TRIED):
        mine = tuple(sorted({nodes[n][1] for n in clique}))
        together = together or mine
        if len(mine) < best:
            break
        for match in _registered([nodes[n] for n in clique], seen, features, within_mm):
            found.setdefault(match.of, match)
            best = max(best, match.covered)
    ranked = sorted(found.values(), key=lambda one: (-one.covered, one.squares / max(one.numbers, 1)))
    return Matches([one for one in ranked if one.covered == best], together)


def _agree(
    first: tuple[int, int],
    second: tuple[int, int],
    seen: Sequence[Seen],
    features: Sequence[Feature],
    *,
    in_order: bool,
) -> bool:
    """Whether two pairs of (what was seen, feature) may stand together."""
    (i, k), (j, m) = first, second
    if i == j:
        return False
    same_sort = (features[k].kind == "point") == (features[m].kind == "point")
    if in_order and same_sort and (i < j) != (k < m) and k != m:
        return False
    one, other = seen[i], seen[j]
    if isinstance(one.what, Drag) and isinstance(other.what, Drag):
        both = np.intersect1d(one.what.rows, other.what.rows, assume_unique=True)
        if len(both) > SHARED * min(len(one.what.rows), len(other.what.rows)):
            return False
    there = (features[k], features[m])
    apart = float(np.linalg.norm(one.middle_mm - other.middle_mm))
    within = APART_MM + APART_SHARE * apart
    if one.kind == other.kind == "point":
        told = np.linalg.norm(there[0].spanning_mm[0] - there[1].spanning_mm[0])
        return bool(abs(apart - told) <= within)
    if "point" in (one.kind, other.kind):
        point, wide, place, feature = (
            (one, other, *there) if one.kind == "point" else (other, one, *there[::-1])
        )
        return _point_agrees(point, wide, place, feature, within)
    return _angles_agree(one, other, *there, within)


def _point_agrees(point: Seen, wide: Seen, place: Feature, feature: Feature, within: float) -> bool:
    """Of a touch and a drag: the distance from the line or plane, from a face with its sign."""
    here = _off(point.middle_mm - wide.middle_mm, wide.direction, wide.kind)
    told = _off(place.spanning_mm[0] - feature.spanning_mm[0], feature.direction, feature.kind)
    if wide.kind == "plane" and not (wide.sided and feature.outward is not None):
        here, told = abs(here), abs(told)
    return bool(abs(here - told) <= within)


def _off(step: Array, direction: Array, kind: str) -> float:
    along = float(step @ direction)
    return along if kind == "plane" else float(np.linalg.norm(step - along * direction))


def _angles_agree(one: Seen, other: Seen, first: Feature, second: Feature, within: float) -> bool:
    """Of two drags: the angle; of parallel ones how far they are apart, of lines in general, too."""
    cosine, told = float(one.direction @ other.direction), float(first.direction @ second.direction)
    signed = one.sided and other.sided and first.outward is not None and second.outward is not None
    if not signed:
        cosine, told = abs(cosine), abs(told)
    angle, angle_told = (float(np.arccos(np.clip(x, -1, 1))) for x in (cosine, told))
    if abs(angle - angle_told) > ANGLE_RAD:
        return False
    step, step_told = other.middle_mm - one.middle_mm, second.spanning_mm[0] - first.spanning_mm[0]
    if one.kind == other.kind == "line":
        return abs(_between(step, one, other) - _between(step_told, first, second)) <= within
    crossed = min(angle_told, np.pi - angle_told)
    if one.kind == other.kind and crossed < PARALLEL_RAD:
        here, there = float(step @ one.direction), float(step_told @ first.direction)
        return abs(here - there if signed else abs(here) - abs(there)) <= within
    if one.kind != other.kind and crossed > np.pi / 2 - PARALLEL_RAD:
        plane, plane_told = (one, first) if one.kind == "plane" else (other, second)
        return bool(abs(abs(step @ plane.direction) - abs(step_told @ plane_told.direction)) <= within)
    return True


def _between(step: Array, one: Seen | Feature, other: Seen | Feature) -> float:
    """The distance of two lines."""
    across = np.cross(one.direction, other.direction)
    size = float(np.linalg.norm(across))
    if size < np.sin(PARALLEL_RAD):
        return float(np.linalg.norm(step - (step @ one.direction) * one.direction))
    return float(abs(step @ across) / size)


def _registered(
    pairs: Sequence[tuple[int, int]],
    seen: Sequence[Seen],
    features: Sequence[Feature],
    within_mm: float,
) -> Iterator[FeatureMatch]:
    """The places of the phantom that bring a set of pairs together, with every pair that then stands."""
    measured = {k: measured_of(features[k], [seen[i].what for i, m in pairs if m == k]) for _, k in pairs}
    numbers = sum(len(one.rows.told) for one in measured.values())
    if numbers < 6 + LEAST_SPARE:
        return
    of = dict(pairs)
    wide = {k: seen[i] for i, k in pairs}
    directions = [(wide[k].direction, wide[k].sided and features[k].outward is not None) for k in measured]
    for matrix in feature_poses(list(measured.values()), directions):
        if not all(_stands(seen[i], features[k], matrix, within_mm) for i, k in pairs):
            continue
        squares = sum(float(np.sum(one.rows.residuals(matrix) ** 2)) for one in measured.values())
        named = tuple(of.get(i, -1) for i in range(len(seen)))
        yield FeatureMatch(named, matrix, len(measured), squares, numbers)


def _stands(one: Seen, feature: Feature, matrix: Array, within_mm: float) -> bool:
    """Whether what was seen is on its feature: near enough, from outside, between its ends."""
    measured = measured_of(feature, [one.what])
    if measured.distance_mm(matrix) > within_mm:
        return False
    if feature.outward is not None and one.sided:
        return bool(matrix[:3, :3] @ feature.outward @ one.direction > 0)
    if feature.kind == "line" and isinstance(one.what, Drag):
        at = (one.middle_mm - matrix[:3, 3]) @ matrix[:3, :3]
        length = float(np.linalg.norm(feature.spanning_mm[1] - feature.spanning_mm[0]))
        along = float((at - feature.spanning_mm[0]) @ feature.direction)
        # To and fro, the ends of a drag are 1.7 rms from its middle.
        reach = 1.7 * float(one.what.reach_mm[0])
        return bool(along - reach > -BEYOND_MM and along + reach < length + BEYOND_MM)
    return True
