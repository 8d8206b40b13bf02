"""A calibration that finds where its targets are, too."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from sonocal.calibration.area import area_findings
from sonocal.calibration.evidence import set_up_findings
from sonocal.calibration.found_phantom import phantom_findings
from sonocal.calibration.found_targets import FoundTarget, found_target
from sonocal.calibration.held_out import held_out_errors, held_out_findings
from sonocal.calibration.mixed import mapped_of, target_distances
from sonocal.calibration.options import Options, kept_options
from sonocal.calibration.placed_findings import placed_findings
from sonocal.calibration.placed_phantom import phantom_among, with_phantom
from sonocal.calibration.placed_rows import PlacedRows, frames_of, full_poses, has_poses, placed_at
from sonocal.calibration.result import Calibration
from sonocal.calibration.rows import image_area, split_rows
from sonocal.calibration.statistics import ErrorStatistics
from sonocal.errors import InputError, SonocalError, UnsupportedError, require
from sonocal.findings import Findings
from sonocal.geometry import Array
from sonocal.observations import Observations
from sonocal.registration.noise import Noise
from sonocal.registration.uncertainty import quantile_95
from sonocal.registration.unplaced import Placed, register_unplaced
from sonocal.registration.unplaced_time import poses_later
from sonocal.targets import Target, Unplaced

__all__ = ["calibrate_with_places", "placed_by", "wants_places"]

# Where the noise would tell, and places are looked for.
THRESHOLD_MM = 5.0
# Random samples, of the search for a place, at the most.
MOST_SAMPLES = 2000


def wants_places(observations: Observations, asked: Options) -> bool:
    """Whether some target's place is to be found with the calibration."""
    return isinstance(observations, Observations) and (asked.targets is not None or has_poses(observations))


def calibrate_with_places(observations: Observations, asked: Options) -> Calibration:
    """Calibrate on targets whose place in their frame nobody knows, or knows roughly.

    Every point lies on its target, wherever that is in its frame, whose pose at the point's instant is known:

        A x_i on T_i G        T_i: the probe marker from the target's frame, G: where the target is in that

    The target's place is one more unknown of the same likelihood.

    Args:
        observations: rows with the pose of their target's frame; held-out ones, and ones of known places among them.
        asked: how, with the targets.

    Raises:
        InputError: a row's target is not given.
        DegenerateGeometryError: the motion does not tell the calibration from the place; which is missing.
        NoConsensusError: no calibration agrees with enough rows.
        UnsupportedError: an option that this has not.
    """
    rows, held_out = split_rows(observations, asked.fit_split, asked.test_split)
    _refuse_unsupported(rows, asked, held_out)
    used, targets = asked.resolved(THRESHOLD_MM), asked.targets or ()
    seen = PlacedRows.of(rows, targets)
    phantom = phantom_among(rows, seen, timed=asked.latency is not None)
    answer = _registered(rows, seen, used, trusted=phantom is not None)
    whole = None
    if phantom is not None:
        answer, whole = with_phantom(rows, seen, answer, phantom, used_mm(used))
    found = {name: _found(answer, *given) for name, given in seen.given.items() if _is_asked(given[0])}
    where = _spanning(seen, found)
    placed = placed_at(rows, _at_lag(rows, seen, answer.lag_s), where)
    held = None if held_out is None else placed_at(held_out, PlacedRows.of(held_out, targets).poses, where)
    calibration = replace(_calibration(placed, answer, (asked, used), found, held), phantom=whole)
    looks = (
        partial(placed_findings, calibration, answer),
        partial(phantom_findings, whole, calibration.fit),
        partial(area_findings, calibration, placed.points_px[answer.inlier]),
        partial(held_out_findings, calibration, held),
        lambda: set_up_findings(calibration, placed, mapped_of(calibration.probe_from_image, placed)),
    )
    return replace(calibration, diagnostics=Findings(looks=looks))


def placed_by(calibration: Calibration, observations: Observations) -> Observations:
    """The rows of a table with their targets where a calibration found them, under its lag.

    Args:
        calibration: of this table.
        observations: some rows of which say a pose only.
    """
    require("calibration", calibration, Calibration)
    require("observations", observations, Observations)
    seen = PlacedRows.of(observations, calibration.options.targets or ())
    lag = None if calibration.latency_interval_s is None else calibration.latency_s
    return placed_at(observations, _at_lag(observations, seen, lag), _spanning(seen, calibration.targets))


def _refuse_unsupported(rows: Observations, asked: Options, held_out: Observations | None) -> None:
    if not has_poses(rows):
        raise InputError(
            f"{rows.source}: says in every row where its target is, so that no place is asked for; leave out the "
            "targets"
        )
    why = {
        "a known scale": asked.model == "rigid",
        "weighting geometric": asked.weighting == "geometric",
        "a speed of sound": asked.sound_speed_m_s is not None,
        "held-out rows under an estimated latency": asked.latency is not None and held_out is not None,
    }
    if what := next((name for name, is_so in why.items() if is_so), None):
        raise UnsupportedError(
            f"{rows.source}: asks for places of targets, which are not found with {what}; leave that out, or give the "
            "targets' places"
        )
    if asked.latency is not None and rows.stamps_s() is None:
        raise InputError(f"{rows.source}: has no column time_s, which a latency shows by; add it, in seconds")


def _registered(rows: Observations, seen: PlacedRows, used: Options, *, trusted: bool) -> Placed:
    try:
        return register_unplaced(
            rows.points_px,
            full_poses(seen.poses),
            seen.targets,
            target=seen.target,
            frame=frames_of(rows),
            time_s=None if used.latency is None else rows.stamps_s(),
            model=used.model,
            threshold_mm=used_mm(used),
            sigma_px=used.sigma_px,
            sigma_mm=used.sigma_mm,
            max_samples=min(used.max_samples, MOST_SAMPLES),
            seed=used.seed,
            trusted=trusted,
        )
    except SonocalError as error:
        raise error.explained(error.diagnostics, f"{rows.source}: {error}") from None


def used_mm(used: Options) -> float:
    """The threshold, which "auto" is no longer."""
    assert used.threshold_mm != "auto"
    return used.threshold_mm


def _is_asked(target: Target | Unplaced) -> bool:
    return isinstance(target, Unplaced)


def _found(answer: Placed, target: Target | Unplaced, number: int) -> FoundTarget:
    place = answer.places[number]
    if isinstance(target, Unplaced) and target.spanning_mm is not None:
        return found_target(place, target.frame, target.spanning_mm, (target.sigma_mm, target.sigma_deg))
    return found_target(place, target.frame)


def _spanning(seen: PlacedRows, found: Mapping[str, FoundTarget]) -> dict[str, Array]:
    """(K, 3), of every target by its name: what spans it in its own frame."""
    return {
        name: np.array(found[name].spanning_mm) if isinstance(one, Unplaced) else one.spanning_mm
        for name, (one, _) in seen.given.items()
    }


def _at_lag(rows: Observations, seen: PlacedRows, lag_s: float | None) -> Array:
    """(N, 3, 4): the poses where a lag leads; where they are not known there, as they are stamped."""
    stamps = rows.stamps_s()
    if lag_s is None or stamps is None:
        return seen.poses
    return poses_later(full_poses(seen.poses), seen.target, stamps, lag_s)


def _calibration(
    placed: Observations,
    answer: Placed,
    options: tuple[Options, Options],
    found: dict[str, FoundTarget],
    held: Observations | None,
) -> Calibration:
    asked, used = options
    size, seen, area = image_area(placed, answer.inlier, used.image_size_px)
    residuals = target_distances(answer.marker_from_source, placed)
    agreeing = residuals[answer.inlier]
    kept = kept_options(asked, used) | ({} if answer.lag_s is None else {"latency_asked": "estimate"})
    return Calibration(
        probe_from_image=answer.marker_from_source,
        model=used.model,
        covariance=answer.covariance if answer.freedom > 0 else None,
        noise=_noise(answer, agreeing),
        area_px=area,
        image_size_px=size,
        seen_px=seen,
        fit=ErrorStatistics.of(agreeing, len(placed), len(agreeing)),
        test=held_out_errors(answer.marker_from_source, held, used_mm(used)),
        residuals_mm=residuals,
        inlier=answer.inlier,
        latency_s=answer.lag_s,
        latency_interval_s=_lag_interval(answer),
        targets=found,
        options=replace(used, latency=None),
        provenance={"input": placed.source, "sha256": placed.sha256, "options": kept},
    )


def _noise(answer: Placed, agreeing_mm: Array) -> Noise:
    freedom = max(answer.freedom, 0)
    row_mm = float(np.sqrt(np.sum(agreeing_mm**2) / freedom)) if freedom else np.nan
    return Noise(row_mm, answer.covariance, freedom, answer.sigma_px, answer.sigma_mm)


def _lag_interval(answer: Placed) -> tuple[float, float] | None:
    if answer.lag_s is None or answer.lag_sigma_s is None:
        return None
    half = quantile_95(max(answer.freedom, 1)) * answer.lag_sigma_s
    return answer.lag_s - half, answer.lag_s + half
