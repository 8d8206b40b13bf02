"""The one way in which touches and drags are a phantom's features; refused where there is none, or several."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sonocal.errors import DegenerateGeometryError, InputError, NoConsensusError
from sonocal.geometry import Array
from sonocal.geometry.units import UNITS
from sonocal.tools.feature_match import FeatureMatch, Matches, Seen, match_features
from sonocal.tools.features import Feature, free_motions

__all__ = ["features_told_apart", "in_listed_order", "refuse_free"]

# Edges are round, faces are printed: what is further from a feature is none of it.
WITHIN_MM = 3.0
# Another way is possible unless its residuals are larger than chance has them once in so many; rounding, mm.
RIVAL_CHANCE, FLOOR_MM = 1e-3, 0.05
# Numbers beyond six that hold a phantom of which some was not found: ways through the air may be of the rest.
SPARE = 5


def refuse_free(source: str, features: Sequence[Feature]) -> None:
    """Refuse features that leave a motion of the phantom free.

    Raises:
        DegenerateGeometryError: which ("phantom-free").
    """
    if motions := free_motions(features):
        names = ", ".join(one.name for one in features)
        raise DegenerateGeometryError(
            f"{source}: by {names} alone the phantom is free: {' and '.join(motions)} of its frame; touch landmarks, "
            "or drag the stylus along a line or plane that this would move",
            "phantom-free",
        )


def features_told_apart(
    source: str, seen: Sequence[Seen], features: Sequence[Feature], *, in_order: bool
) -> FeatureMatch:
    """The one way in which what was seen is the phantom.

    Of few features any order may be the one listed by chance: it decides only where it is said to have been kept.

    Raises:
        InputError: it fits in another unit of length.
        DegenerateGeometryError: it fits in several ways ("landmarks-ambiguous"), or leaves a motion free
            ("phantom-free").
        NoConsensusError: too little fits, or more of the mirrored phantom.
    """

    def matches(factors: Array) -> Matches:
        scaled = [one.scaled(factors) for one in features]
        return match_features(seen, scaled, WITHIN_MM, in_order=in_order)

    found = matches(np.ones(3))
    mirrored = matches(np.array([1.0, 1.0, -1.0]))
    best = found.ways[0].covered if found.ways else 0
    if mirrored.ways and best < mirrored.ways[0].covered >= len(found.together):
        raise NoConsensusError(
            f"{source}: what was touched fits {mirrored.ways[0].covered} landmarks, lines and planes of the mirrored "
            f"phantom and {best} as they are listed; turn the sign of one axis of the phantom, or check that the poses "
            "are of a right-handed frame",
            best,
        )
    rivals = [one for one in found.ways if _as_good(one, found.ways[0]) and _enough(one, features)]
    if len(rivals) == 1:
        return rivals[0]
    for unit, factor in UNITS.items():
        other = matches(np.full(3, factor)) if factor != 1 else found
        if other.ways and best < other.ways[0].covered >= len(found.together):
            raise InputError(
                f"{source}: what was touched fits {other.ways[0].covered} landmarks, lines and planes when these are "
                f"in {unit}; give the phantom in mm: multiply its places by {factor:g}"
            )
    if rivals:
        raise DegenerateGeometryError(_ambiguous(source, rivals, features), "landmarks-ambiguous")
    refuse_free(source, [features[k] for k in found.together])
    raise NoConsensusError(
        f"{source}: at most {len(found.together)} of {len(features)} landmarks, lines and planes fit what the stylus "
        "touched and was dragged along; drag it along each for three seconds or more, over a plane to and fro, and "
        "check that the phantom is the one that the file is of",
        len(found.together),
    )


def _enough(one: FeatureMatch, features: Sequence[Feature]) -> bool:
    """Whether half of what the stylus is said to have been dragged along is there: less may fit anything."""
    dragged = {k for k, feature in enumerate(features) if feature.kind != "point"}
    there = set(one.of) & dragged
    return there == dragged or (2 * len(there) >= len(dragged) and one.numbers >= 6 + SPARE)


def _as_good(one: FeatureMatch, best: FeatureMatch) -> bool:
    from scipy.special import fdtri

    freedom = max(best.numbers - 6, 1)
    limit = float(fdtri(freedom, freedom, 1 - RIVAL_CHANCE))
    floor = best.numbers * FLOOR_MM**2
    return one.squares + floor <= limit * (best.squares + floor)


def in_listed_order(match: FeatureMatch, features: Sequence[Feature]) -> bool:
    """Whether landmarks, and lines and planes, each come in the order listed."""
    of = np.array([k for k in match.of if k >= 0])
    points = np.array([features[k].kind == "point" for k in of])
    return all(bool((np.diff(part) >= 0).all()) for part in (of[points], of[~points]))


def _ambiguous(source: str, rivals: Sequence[FeatureMatch], features: Sequence[Feature]) -> str:
    orders = "; or ".join(", ".join(features[k].name for k in one.of if k >= 0) for one in rivals[:2])
    return (
        f"{source}: what was touched fits the phantom in {len(rivals)} ways ({orders}): one as symmetric as this tells "
        "no order; drag along lines and planes in the order in which they are named and say --in-order, or touch a "
        "landmark that breaks the symmetry"
    )
