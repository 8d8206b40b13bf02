"""Where targets are that nobody placed, by the best candidates: of one with a calibration, then of the others."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sonocal.detection import Detections
from sonocal.errors import DegenerateGeometryError, NoConsensusError, SonocalError
from sonocal.geometry import AxisScaled
from sonocal.geometry.shown import brief
from sonocal.recording import Recording, with_latency
from sonocal.sweep.first_place import FirstPlace, first_place
from sonocal.sweep.further_places import Seen, further_place
from sonocal.sweep.options import PointsOptions
from sonocal.sweep.own_places import placed_at, target_at, threshold_of
from sonocal.targets import Target, Unplaced
from sonocal.targets.unplaced import kind_of

__all__ = ["FirstPlaces", "first_places", "of_its_kind"]


@dataclass(frozen=True, eq=False)
class FirstPlaces:
    """What the best-ranked candidates say.

    Attributes:
        targets: every one, where it is known or was found.
        transform: roughly the calibration.
        recording: with its poses where a lag that was found leads.
    """

    targets: tuple[Target, ...]
    transform: AxisScaled
    recording: Recording

    __repr__ = brief


class _Rough(NamedTuple):
    """A calibration, the places that it came with, and the lag."""

    transform: AxisScaled
    places: dict[str, Target]
    latency_s: float | None


def first_places(
    recording: Recording,
    targets: Sequence[Target | Unplaced],
    detections: Sequence[Detections],
    options: PointsOptions,
    start: AxisScaled | None = None,
) -> FirstPlaces:
    """The places of targets by the best-ranked candidates.

    Several of one kind and frame take their names in the order in which they are found: which is which, nobody said.

    Args:
        recording: with its poses as they are stamped.
        targets: some of which have no place.
        detections: of one kind each.
        options: how.
        start: a calibration by those targets whose place is known; None where there is none.

    Raises:
        NoConsensusError: no calibration and no place agree with enough images.
        DegenerateGeometryError: the motion does not tell the one from the other.
        InputError: no detection is in a frame with a valid pose.
    """
    known = {one.name: one for one in targets if not isinstance(one, Unplaced)}
    if start is None:
        found = _first(recording, targets, detections, options)
        place = target_at(found.target, found.calibration)
        lag = found.calibration.latency_s if options.latency else None
        rough = _Rough(found.calibration.probe_from_image, known | {place.name: place}, lag)
    else:
        rough = _Rough(start, known, None)
    if rough.latency_s is not None:
        recording = with_latency(recording, rough.latency_s, on_invalid=options.on_invalid)
    places = _with_others(recording, targets, detections, rough, options)
    return FirstPlaces(tuple(places[one.name] for one in targets), rough.transform, recording)


def of_its_kind(detections: Sequence[Detections], target: Target | Unplaced) -> Detections:
    """Those that may be a target: walls have as many points as images have axes."""
    planes = kind_of(target) == "plane"
    return next(one for one in detections if (one.points_each == one.dimension) == planes)


def _first(
    recording: Recording,
    targets: Sequence[Target | Unplaced],
    detections: Sequence[Detections],
    options: PointsOptions,
) -> FirstPlace:
    """That target's which most images beyond chance agree on."""
    found: list[FirstPlace] = []
    refusal: SonocalError | None = None
    for one in _unlike(targets):
        try:
            found.append(first_place(recording, one, of_its_kind(detections, one), options))
        except (NoConsensusError, DegenerateGeometryError) as error:
            refusal = refusal or error
    if not found:
        assert refusal is not None
        raise refusal
    return max(found, key=lambda one: one.beyond_chance)


def _unlike(targets: Sequence[Target | Unplaced]) -> Iterator[Unplaced]:
    """Of targets without a place that nothing but their names tells apart, the first."""
    seen = set()
    for one in targets:
        if isinstance(one, Unplaced):
            looks = (
                one.kind,
                one.frame.lower(),
                None if one.spanning_mm is None else one.spanning_mm.tobytes(),
            )
            if looks not in seen:
                seen.add(looks)
                yield one


def _with_others(
    recording: Recording,
    targets: Sequence[Target | Unplaced],
    detections: Sequence[Detections],
    rough: _Rough,
    options: PointsOptions,
) -> dict[str, Target]:
    """Every target's place, by its name; what is seen of one is not looked at for the next."""
    places = dict(rough.places)
    left = {(one.points_each == one.dimension): one for one in detections}
    for place in rough.places.values():
        planes = kind_of(place) == "plane"
        seen = Seen.of(recording, place, left[planes], rough.transform, options)
        mine = seen.nearest(place.spanning_mm, threshold_of(options))
        left[planes] = _without(left[planes], seen.number[mine])
    for one in targets:
        if isinstance(one, Unplaced) and one.name not in places:
            planes = one.kind == "plane"
            spanning, numbers = further_place(recording, one, left[planes], rough.transform, options)
            places[one.name] = placed_at(one, spanning)
            left[planes] = _without(left[planes], numbers)
    return places


def _without(detections: Detections, numbers: NDArray[np.int64]) -> Detections:
    kept = np.ones(len(detections), dtype=bool)
    kept[numbers] = False
    return detections.select(kept)
