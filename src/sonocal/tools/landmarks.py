"""A phantom's place from one recording in which a stylus touched its landmarks, in whatever order.

Touches are found by themselves (`find_rests`), told apart (`told_apart`) and fitted (`fit_phantom`). A small residual
does not mean that the wires are where they should be: what they are off by follows from how far they are from the
landmarks (Fitzpatrick, West and Maurer 1998), and is told for each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sonocal.errors import DegenerateGeometryError, InputError, require
from sonocal.findings import warnings_first
from sonocal.geometry import Array
from sonocal.recording import Recording
from sonocal.recording.poses import OnInvalid
from sonocal.targets import Point, Target, check_lines
from sonocal.tools.calibrate import Stylus
from sonocal.tools.landmark_findings import landmark_findings
from sonocal.tools.landmark_fit import fit_phantom
from sonocal.tools.landmark_match import LEAST_WIDTH_MM, Match, width_mm
from sonocal.tools.landmark_result import LandmarkFit, PhantomRegistration, TargetError
from sonocal.tools.landmark_search import Search, told_apart
from sonocal.tools.rests import Rest, find_rests
from sonocal.tools.tip_check import TipDoubt, tip_doubt
from sonocal.tools.tip_path import TipPath

__all__ = ["refuse_tip", "register_landmarks", "target_errors"]

# Of landmarks in unknown order: three of them fit somewhere by chance.
FEWEST, FEWEST_IN_ORDER = 4, 3
# Of a tip: a warning up to there, for sensors whose place depends on their angle look like two millimetres of it.
REFUSED_MM = 4.0


def register_landmarks(
    recording: Recording,
    landmarks: Sequence[Point],
    stylus: Stylus,
    *,
    reference: str | None = None,
    targets: Sequence[Target] = (),
    in_order: bool = False,
    on_invalid: OnInvalid = "raise",
    seed: int = 0,
) -> PhantomRegistration:
    """Where a phantom is, from a recording in which the stylus touched its landmarks.

    Args:
        recording: poses of the stylus, and of the reference where there is one.
        landmarks: of the phantom, in its frame, mm.
        stylus: its marker's name and its tip.
        reference: marker that the phantom is fixed to; default: "Reference" where it was tracked, else the tracker.
        targets: wires and planes of the phantom, in its frame, whose errors are told.
        in_order: the landmarks were touched in the order listed.
        on_invalid: what to do with poses marked valid that are not rigid.
        seed: of the triples of landmarks that are tried, where these are very many.

    Raises:
        InputError: fewer than three landmarks, no such tool, too few touches, landmarks that are not in mm, a tip that
            is off by `REFUSED_MM` or more.
        DegenerateGeometryError: the landmarks lie on one line ("points-on-one-line"), or the touches fit them in
            several ways ("landmarks-ambiguous").
        NoConsensusError: too few touches fit landmarks, or they fit the mirrored phantom.
    """
    require("recording", recording, Recording)
    require("stylus", stylus, Stylus)
    places = _places(landmarks)
    path = TipPath.of(recording, stylus, reference, on_invalid)
    rests = find_rests(path.places_mm, path.times_s)
    fewest = FEWEST_IN_ORDER if in_order else FEWEST
    if len(rests) < fewest:
        raise InputError(
            f"{recording.name}: the tip of {stylus.name} rested at {len(rests)} places, and {fewest} landmarks are "
            "needed; hold it on each for a second or more, and check that --stylus-tip is the tip of this stylus"
        )
    doubt = tip_doubt(path.matrices, path.tip_mm, rests, stylus.name)
    search = Search(recording.name, places, tuple(one.name for one in landmarks), fewest, in_order, seed)
    match, rivals = told_apart(search, rests, doubt)
    found = _registration(landmarks, path.frame, rests, match, targets)
    if doubt is not None:
        doubt = _if_it_mends(doubt, path.matrices, found, landmarks, match)
        refuse_tip(recording.name, doubt, path.tip_mm)
    findings = (*path.repeats, *landmark_findings(found, rivals, doubt))
    return replace(found, diagnostics=warnings_first(findings))


def _places(landmarks: Sequence[Point]) -> Array:
    """(L, 3): the landmarks; refuses those that tell no place."""
    require("landmarks", landmarks, Sequence, "a list of points")
    for point in landmarks:
        require("landmarks", point, Point, "a list of points")
    check_lines("the phantom", landmarks, "landmarks")
    places = np.array([point.place_mm for point in landmarks]).reshape(-1, 3)
    if len(places) < FEWEST_IN_ORDER:
        raise InputError(
            f"a phantom is registered by three landmarks or more, better six; got {len(places)}: give each a "
            "<Landmark> in the device set, or a [[point]]"
        )
    # In metres it is a thousandth, and still no line: what it is against its own length.
    length = float(np.linalg.norm(places - places.mean(axis=0), axis=1).max())
    if length == 0 or width_mm(places) < min(LEAST_WIDTH_MM, 0.02 * length):
        raise DegenerateGeometryError(
            f"the phantom's {len(places)} landmarks lie on one line, about which it may turn; touch one beside it, too",
            "points-on-one-line",
        )
    return places


def _registration(
    landmarks: Sequence[Point], frame: str, rests: Sequence[Rest], match: Match, targets: Sequence[Target]
) -> PhantomRegistration:
    touched = np.unique(match.landmark[match.landmark >= 0])
    of = {
        int(k): [rest for rest, one in zip(rests, match.landmark, strict=True) if one == k] for k in touched
    }
    means = [_mean(of[int(k)]) for k in touched]
    places = np.array([landmarks[int(k)].place_mm for k in touched])
    fit = fit_phantom(places, np.array([mean for mean, _ in means]), np.array([v for _, v in means]))
    at = {int(k): i for i, k in enumerate(touched)}
    off = np.linalg.norm(fit.residuals_mm, axis=1)
    shown = tuple(
        LandmarkFit(
            point.name,
            point.place_mm,
            means[at[k]][0] if k in at else None,
            float(off[at[k]]) if k in at else None,
            tuple((rest.first, rest.last) for rest in of.get(k, ())),
            k in at and bool(fit.used[at[k]]),
        )
        for k, point in enumerate(landmarks)
    )
    found = PhantomRegistration(
        phantom=landmarks[0].frame,
        reference=frame,
        reference_from_phantom=fit.matrix,
        covariance=fit.covariance,
        freedom=fit.freedom,
        landmarks=shown,
        rests=tuple(rests),
        rms_mm=float(np.sqrt(np.mean(off[fit.used] ** 2))),
        size_ratio=fit.scale,
        size_ratio_deviation=fit.scale_deviation,
        as_listed=bool((np.diff(match.landmark[match.landmark >= 0]) >= 0).all()),
        target_errors=(),
        diagnostics=(),
    )
    return replace(found, target_errors=target_errors(found, targets))


def _if_it_mends(
    doubt: TipDoubt, matrices: Array, found: PhantomRegistration, landmarks: Sequence[Point], match: Match
) -> TipDoubt | None:
    """The doubt, where touches with the tip corrected are no further from their landmarks."""
    moved = [
        replace(
            rest, point_mm=rest.point_mm + matrices[rest.rows, :3, :3].mean(axis=0) @ doubt.tip_correction_mm
        )
        for rest in found.rests
    ]
    return doubt if _registration(landmarks, "", moved, match, ()).rms_mm <= found.rms_mm else None


def refuse_tip(source: str, doubt: TipDoubt | None, tip_mm: Array) -> None:
    """A tip that is off by more than sensors and hands make of a right one: every landmark is off by as much."""
    if doubt is not None and doubt.off_mm >= REFUSED_MM:
        place = ",".join(f"{x:.1f}" for x in tip_mm + doubt.tip_correction_mm)
        raise InputError(
            f"{source}: the tip of {doubt.stylus} is off by {doubt.off_mm:.1f} mm, as its turns at rest show, and "
            f"every landmark with it; pivot the stylus and give that tip (from these touches it is nearer to {place})"
        )


def _mean(rests: Sequence[Rest]) -> tuple[Array, float]:
    """Of the touches of one landmark: their place, and its variance a coordinate."""
    places = np.mean([rest.point_mm for rest in rests], axis=0)
    return places, float(np.mean([np.trace(rest.covariance) / 3 for rest in rests]) / len(rests))


def target_errors(found: PhantomRegistration, targets: Sequence[Target]) -> tuple[TargetError, ...]:
    """What the registration moves targets by, worst first."""
    errors = [TargetError(one.name, float(found.within_95_mm(one.spanning_mm).max())) for one in targets]
    return tuple(sorted(errors, key=lambda one: -one.within_95_mm))
