"""The one way in which touches are landmarks; refused where there is none, or several that fit as well."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sonocal.errors import DegenerateGeometryError, InputError, NoConsensusError
from sonocal.geometry import Array
from sonocal.geometry.units import UNITS
from sonocal.tools.landmark_match import Match, match_landmarks
from sonocal.tools.rests import Rest
from sonocal.tools.tip_check import TipDoubt

__all__ = ["Search", "told_apart"]

# Divots are a millimetre or two wide and phantoms are printed: a touch further from its landmark is none of it.
TOLERANCE_MM, SHARE_OF_NEAREST = 3.0, 0.3
# Another order is possible unless its residuals are larger than chance has them once in so many.
RIVAL_CHANCE = 1e-3
# Below it residuals are rounding and tell nothing apart, mm.
FLOOR_MM = 0.05


@dataclass(frozen=True, eq=False)
class Search:
    """What touches are told apart by.

    Attributes:
        source: of the recording, for messages.
        places: (L, 3), of the landmarks in the order listed.
        names: of the landmarks.
        fewest: landmarks that must fit.
        in_order: they were touched in the order listed.
        seed: of the triples that are tried.
    """

    source: str
    places: Array
    names: tuple[str, ...]
    fewest: int
    in_order: bool
    seed: int

    def matches(self, touches: Array, places: Array | None = None) -> list[Match]:
        """The ways in which touches (K, 3) fit the landmarks, or the same at other places."""
        places = self.places if places is None else places
        apart = np.linalg.norm(places[:, None] - places[None], axis=2)
        nearest = float(apart[~np.eye(len(places), dtype=bool)].min())
        tolerance = min(TOLERANCE_MM, SHARE_OF_NEAREST * nearest)
        found = match_landmarks(touches, places, tolerance, in_order=self.in_order, seed=self.seed)
        return [one for one in found if one.touched >= self.fewest]


def told_apart(search: Search, rests: Sequence[Rest], doubt: TipDoubt | None) -> tuple[Match, list[Match]]:
    """The way in which touches are landmarks, and others that fit as well, of which it is the order listed.

    Raises:
        InputError: they fit in another unit of length.
        DegenerateGeometryError: they fit in several ways, none of which is the order listed ("landmarks-ambiguous").
        NoConsensusError: too few fit, or more of the mirrored phantom.
    """
    touches = np.array([rest.point_mm for rest in rests])
    found = search.matches(touches)
    mirrored = search.matches(touches, search.places * [1, 1, -1])
    best = found[0].touched if found else 0
    if mirrored and mirrored[0].touched > best:
        raise NoConsensusError(
            f"{search.source}: the touches fit {mirrored[0].touched} of {len(search.places)} landmarks of the mirrored "
            f"phantom and {best} as they are listed; turn the sign of one axis of the landmarks, or check that the "
            "poses are of a right-handed frame",
            best,
        )
    if not found:
        _refuse_units(search, touches)
        raise NoConsensusError(_none_fits(search, touches, doubt), 0)
    rivals = [one for one in found if _as_good(one, found[0])]
    if len(rivals) == 1:
        return found[0], []
    listed = [one for one in rivals if (np.diff(one.landmark[one.landmark >= 0]) >= 0).all()]
    if len(listed) != 1:
        raise DegenerateGeometryError(_ambiguous(search, rivals), "landmarks-ambiguous")
    return listed[0], [one for one in rivals if one is not listed[0]]


def _as_good(one: Match, best: Match) -> bool:
    """Whether a way fits as many landmarks, as closely as chance may have it."""
    from scipy.special import fdtri

    freedom = 3 * best.touched - 6
    limit = float(fdtri(freedom, freedom, 1 - RIVAL_CHANCE))
    floor = best.touches * FLOOR_MM**2
    return one.touched >= best.touched and one.squares + floor <= limit * (best.squares + floor)


def _refuse_units(search: Search, touches: Array) -> None:
    for unit, factor in UNITS.items():
        if factor != 1 and (found := search.matches(touches, search.places * factor)):
            raise InputError(
                f"{search.source}: the touches fit {found[0].touched} of {len(search.places)} landmarks when these are "
                f"in {unit}; give the phantom in mm: multiply its places by {factor:g}"
            )
        if factor != 1 and (found := search.matches(touches * factor)):
            raise InputError(
                f"{search.source}: the touches fit {found[0].touched} of {len(search.places)} landmarks when the poses "
                f"are in {unit}; give the recording in mm: multiply its places, and the tip, by {factor:g}"
            )


def _none_fits(search: Search, touches: Array, doubt: TipDoubt | None) -> str:
    three = match_landmarks(touches, search.places, TOLERANCE_MM, in_order=search.in_order, seed=search.seed)
    at_most = max((one.touched for one in three), default=0)
    hint = (
        "touch each for a second or more"
        if doubt is None
        else f"the tip of {doubt.stylus} is off by {doubt.off_mm:.1f} mm, as its turns at rest show: pivot it again"
    )
    return (
        f"{search.source}: at most {at_most} of {len(search.places)} landmarks fit the {len(touches)} places where the "
        f"tip rested, and {search.fewest} are needed; {hint}, and check that the landmarks are of this phantom"
    )


def _ambiguous(search: Search, rivals: Sequence[Match]) -> str:
    orders = "; or ".join(
        ", ".join(search.names[k] for k in one.landmark[one.landmark >= 0]) for one in rivals[:2]
    )
    return (
        f"{search.source}: the touches fit the landmarks in {len(rivals)} ways ({orders}): a phantom as symmetric as "
        "this one tells no order; touch the landmarks in the order listed and say --in-order, or touch one more that "
        "breaks the symmetry"
    )
