"""A phantom's place from lines and planes of it that a stylus was dragged along, beside landmarks that it touched.

Drags are found by themselves (`find_drags`), touches as ever; which is of what follows from the phantom's shape
(`match_features`), and the place from all of them (`fit_features`). A motion of the phantom that none of them holds is
named, and refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sonocal.errors import InputError, require
from sonocal.findings import warnings_first
from sonocal.geometry import Array
from sonocal.recording import Recording
from sonocal.recording.poses import OnInvalid
from sonocal.targets import Line, Plane, Point, Target, check_lines
from sonocal.targets.unplaced import kind_of
from sonocal.tools.calibrate import Stylus
from sonocal.tools.drags import Drag, dragged_primitive, find_drags, with_shared_errors
from sonocal.tools.feature_fit import FeatureMotion, Measured, fit_features, measured_of
from sonocal.tools.feature_match import FeatureMatch, Seen
from sonocal.tools.feature_search import features_told_apart, in_listed_order, refuse_free
from sonocal.tools.features import Feature, features_of
from sonocal.tools.landmark_findings import landmark_findings
from sonocal.tools.landmark_result import FeatureFit, LandmarkFit, PhantomRegistration
from sonocal.tools.landmarks import refuse_tip, target_errors
from sonocal.tools.rests import Rest, find_rests
from sonocal.tools.tip_check import tip_doubt
from sonocal.tools.tip_path import TipPath

__all__ = ["register_features"]

# Of the same feature, found again once the phantom's place is known.
NEAR_MM = 1.5
LEAST_KEPT = 0.5


def register_features(
    recording: Recording,
    landmarks: Sequence[Point],
    dragged: Sequence[Line | Plane],
    stylus: Stylus,
    *,
    reference: str | None = None,
    targets: Sequence[Target] = (),
    in_order: bool = False,
    on_invalid: OnInvalid = "raise",
) -> PhantomRegistration:
    """Where a phantom is, from a recording in which the stylus was dragged along lines and planes of it.

    Args:
        recording: poses of the stylus, and of the reference where there is one.
        landmarks: of the phantom, in its frame, mm: touched, any or none of them.
        dragged: lines and planes of it, likewise: each dragged along for some seconds, a plane to and fro.
        stylus: its marker's name and its tip.
        reference: marker that the phantom is fixed to; default: "Reference" where it was tracked, else the tracker.
        targets: wires and planes of the phantom, in its frame, whose errors are told.
        in_order: landmarks were touched, and lines and planes dragged along, each in the order listed.
        on_invalid: what to do with poses marked valid that are not rigid.

    Raises:
        InputError: nothing to drag along, no such tool, no drag, a phantom that is not in mm.
        DegenerateGeometryError: what was touched and dragged along leaves a motion of the phantom free
            ("phantom-free"), or fits the phantom in several ways ("landmarks-ambiguous").
        NoConsensusError: too little fits, or it fits the mirrored phantom.
    """
    require("recording", recording, Recording)
    require("stylus", stylus, Stylus)
    features = _features(landmarks, dragged, targets)
    path = TipPath.of(recording, stylus, reference, on_invalid)
    rests, drags = find_rests(path.places_mm, path.times_s), find_drags(path.places_mm, path.times_s)
    if not drags:
        raise InputError(
            f"{recording.name}: the tip of {stylus.name} went along nothing straight or flat for two seconds or more; "
            "drag it along each line, and to and fro over each plane, for three seconds, and check that --stylus-tip "
            "is the tip of this stylus"
        )
    # A pause in a drag is no touch.
    touches = rests if landmarks else []
    parts: list[Rest | Drag] = sorted([*touches, *drags], key=lambda one: one.first)
    seen = [Seen(one, path.shaft(one.rows)) for one in parts]
    match = features_told_apart(recording.name, seen, features, in_order=in_order)
    measured = _measured(path, seen, features, match)
    fit = fit_features([one.what for one in measured.values()], match.matrix)
    found = _result(path, (landmarks, dragged), rests, measured, fit)
    found = replace(
        found, target_errors=target_errors(found, targets), as_listed=in_listed_order(match, features)
    )
    doubt = tip_doubt(path.matrices, path.tip_mm, touches, stylus.name)
    refuse_tip(recording.name, doubt, path.tip_mm)
    findings = (*path.repeats, *landmark_findings(found, (), doubt))
    return replace(found, diagnostics=warnings_first(findings))


def _features(
    landmarks: Sequence[Point], dragged: Sequence[Line | Plane], targets: Sequence[Target]
) -> tuple[Feature, ...]:
    """The phantom; refuses one that is free to move whatever is touched."""
    for name, given in (("landmarks", landmarks), ("dragged", dragged), ("targets", targets)):
        require(name, given, Sequence, "a list of points, lines and planes")
    for point in landmarks:
        require("landmarks", point, Point, "a list of points")
    for one in dragged:
        if not isinstance(one, (Line, Plane)):
            raise InputError(f"the stylus is dragged along lines and planes; got {str(one)[:80]}")
    if not dragged:
        raise InputError(
            "nothing is named that the stylus was dragged along; name lines or planes of the phantom"
        )
    if other := next((one for one in (*landmarks, *dragged) if one.frame != dragged[0].frame), None):
        raise InputError(
            f"the phantom's landmarks, lines and planes are in the frames {dragged[0].frame} and {other.frame} "
            f"({other.name}); a phantom has one"
        )
    check_lines("the phantom", [*landmarks, *dragged], "of what is touched")
    features = features_of(landmarks, dragged, targets)
    refuse_free("the phantom", features)
    return features


class _Of(NamedTuple):
    """What was seen of a feature, together and in its parts."""

    what: Measured
    parts: list[Rest | Drag]


def _measured(
    path: TipPath, seen: Sequence[Seen], features: Sequence[Feature], match: FeatureMatch
) -> dict[int, _Of]:
    """What was seen of each feature, by its number; drags with the items that are on it, now that it has a place."""
    of: dict[int, list[Rest | Drag]] = {}
    for one, k in zip(seen, match.of, strict=True):
        if k >= 0:
            of.setdefault(k, []).append(one.what)
    drags = [(k, one) for k, parts in of.items() for one in parts if isinstance(one, Drag)]
    trimmed = [_trimmed(one, features[k], match.matrix, path) for k, one in drags]
    shared = with_shared_errors(trimmed, path.places_mm, path.times_s)
    for (k, before), after in zip(drags, shared, strict=True):
        of[k][[one is before for one in of[k]].index(True)] = after
    return {k: _Of(measured_of(features[k], of[k]), of[k]) for k in sorted(of)}


def _trimmed(drag: Drag, feature: Feature, matrix: Array, path: TipPath) -> Drag:
    """A drag with the items alone that are on its feature: the way up from an edge may lie in a plane with it."""
    normals = Measured(feature, np.zeros((1, 3)), 0.0).normals
    places = (path.places_mm[drag.rows] - matrix[:3, 3]) @ matrix[:3, :3] - feature.spanning_mm[0]
    off = places @ normals.T
    near = np.linalg.norm(off - np.median(off, axis=0), axis=1) <= NEAR_MM
    rows: NDArray[np.int64] = drag.rows[near] if near.mean() > LEAST_KEPT else drag.rows
    return dragged_primitive(drag.kind, rows, path.places_mm)


def _result(
    path: TipPath,
    phantom: tuple[Sequence[Point], Sequence[Line | Plane]],
    rests: Sequence[Rest],
    measured: dict[int, _Of],
    fit: FeatureMotion,
) -> PhantomRegistration:
    landmarks, dragged = phantom
    used = dict(zip(measured, fit.used.tolist(), strict=True))
    touched = [_touched(point, measured.get(k), fit, used.get(k, False)) for k, point in enumerate(landmarks)]
    along = [
        _along(one, measured.get(k), fit, used.get(k, False)) for k, one in enumerate(dragged, len(landmarks))
    ]
    off = [measured[k].what.distance_mm(fit.matrix) for k in measured if used[k]]
    drags = [part for one in measured.values() for part in one.parts if isinstance(part, Drag)]
    return PhantomRegistration(
        phantom=dragged[0].frame,
        reference=path.frame,
        reference_from_phantom=fit.matrix,
        covariance=fit.covariance,
        freedom=fit.freedom,
        landmarks=tuple(touched),
        rests=tuple(rest for rest in rests if not _inside(rest, drags)),
        rms_mm=float(np.sqrt(np.mean(np.square(off)))),
        size_ratio=fit.scale,
        size_ratio_deviation=fit.scale_deviation,
        as_listed=True,
        target_errors=(),
        diagnostics=(),
        features=tuple(along),
    )


def _touched(point: Point, of: _Of | None, fit: FeatureMotion, used: bool) -> LandmarkFit:
    if of is None:
        return LandmarkFit(point.name, point.place_mm, None, None, (), False)
    spans = tuple((part.first, part.last) for part in of.parts)
    place, off = of.what.places_mm[0], of.what.distance_mm(fit.matrix)
    return LandmarkFit(point.name, point.place_mm, place, off, spans, used)


def _along(one: Line | Plane, of: _Of | None, fit: FeatureMotion, used: bool) -> FeatureFit:
    kind = kind_of(one)
    if of is None:
        return FeatureFit(one.name, kind, None, None, (), False)
    spans = tuple((part.first, part.last) for part in of.parts)
    spread = max(part.variance_mm2 for part in of.parts if isinstance(part, Drag)) ** 0.5
    return FeatureFit(one.name, kind, of.what.distance_mm(fit.matrix), spread, spans, used)


def _inside(rest: Rest, drags: Sequence[Drag]) -> bool:
    return any(np.isin(rest.rows, drag.rows).mean() > 0.5 for drag in drags)
