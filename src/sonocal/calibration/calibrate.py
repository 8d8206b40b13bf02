"""From a table of sightings to a calibration that says how far to trust it: the main path."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Unpack

from sonocal.calibration.area import area_findings
from sonocal.calibration.diagnostics import fit_findings, predicts
from sonocal.calibration.evidence import set_up_findings
from sonocal.calibration.few_targets import beside_unsure_places, few_fixed_targets
from sonocal.calibration.groupings import groupings_of
from sonocal.calibration.held_out import held_out_errors, held_out_findings
from sonocal.calibration.lagged import LaggedTable, without_lag
from sonocal.calibration.left_out import left_out_findings
from sonocal.calibration.options import Keywords, Options, kept_options
from sonocal.calibration.placed import calibrate_with_places, wants_places
from sonocal.calibration.refusals import explained
from sonocal.calibration.repeated import Repeated, fit_distinct
from sonocal.calibration.result import Calibration
from sonocal.calibration.rows import image_area, known_levels
from sonocal.calibration.statistics import ErrorStatistics
from sonocal.calibration.through_sound import calibrate_through_sound
from sonocal.findings import Findings
from sonocal.geometry import area_places
from sonocal.observations import Observations
from sonocal.registration.ambiguity import beside_rival
from sonocal.registration.certificate import LazyCertificate, certificate_of
from sonocal.registration.degeneracy import refuse_apparent
from sonocal.registration.lazy import Lazy
from sonocal.registration.mapped import mapped_rows
from sonocal.registration.model_test import model_tests

__all__ = ["calibrate"]


def calibrate(observations: Observations, **options: Unpack[Keywords]) -> Calibration:
    """Calibrate a probe from sightings of a needle or of wires.

    Args:
        observations: one point of the image against one line in the probe marker's frame a row, or against a point
            or a plane.
        **options: any of the following, by name.

            How rows are fitted:
            model ("similarity"): or "anisotropic" where pixels are not square in mm, or voxels no cubes.
            scale_mm_per_px (None): where it is known: six unknowns are left, and the rows say whether they agree.
            weighting ("likelihood"): weigh every residual by the noise that it carries; "geometric": take all
            distances alike, as the paper does (section 8).
            threshold_mm (5.0): rows further than this from their line are outliers (paper section 9); "auto":
            3.3 standard deviations of the noise, found while more than half of the rows are sound.
            sigma_px, sigma_mm (None): noise of an image point along every axis, px, and of a segment's end point,
            mm, where known; each multiplies the table's own column. Default: estimated from the residuals.
            confidence (0.9999): of having drawn a sample without outliers.
            max_samples (10000): random minimal samples at the most.
            exhaustive_samples (200): up to this many samples are all tried.
            seed (0): of everything random; the same seed gives the same answer.

            latency (None): "estimate": the lag of the tracker behind the images is fitted, too, by the rows' column
            time_s, or by the velocities of their lines (vx0_mm_s ...).

            Which rows:
            fit_split (None): fit the rows of this split only; default: all but those of `test_split`.
            test_split (None): report the error of this split's rows, which are not fitted.

            What the answer is measured by:
            image_size_px (None): (width, height[, depth]); predicted errors are quoted at this image's corners.
            Default: the table's; where it has none, errors are quoted at the corners of the area seen, which is the
            box of the rows that agree.
            tolerance_mm (2.0): the predicted error (95 %) at a corner above which the answer comes with a warning.

            What is known of the set-up:
            scanner_mm_per_px (None): what the scanner says, one number or one along u and one along v.
            marker_above_image (False): the marker is on the handle, beyond the upper half of the image.
            expected_rotation (None): (3, 3), roughly, the directions of u, v and normal in the marker's frame,
            as columns.

            What was scanned:
            targets (None): of rows that give the pose of their target's frame and not where the target is: what each
            is, by its name, see `sonocal.targets.read_targets`. Places that are unknown (`Unplaced`) are found with the
            calibration, see `Calibration.targets`; ones known roughly are refined.

            What is known of the sound, where the scanner assumes another speed than there was:
            probe_radius_mm (None): radius of a curved probe's face.
            sound_speed_m_s (None): in what was scanned; "estimate": found beside the calibration, from 1400 to 1650.
            Of a curved probe only, by its radius; scanner_mm_per_px in all its digits makes it surer. The answer is
            then for images in which sound runs as assumed.
            assumed_sound_speed_m_s (1540.0): by the scanner.
            probe_face_px (None): the middle of the transducer's face in the image. Default: of the image's top row.

    Returns:
        The calibration.

    Raises:
        InputError: there is no such option, an option or a split is wrong, or rows are too few.
        DegenerateGeometryError: the sightings leave a motion free.
        NoConsensusError: no calibration agrees with enough rows.
        UnsupportedError: points or planes by a threshold from the noise.

    Source: paper sections 5 to 9.
    """
    asked = Options.of(**options)
    if asked.sound_speed_m_s is not None:
        return calibrate_through_sound(observations, asked, calibrate)
    if wants_places(observations, asked):
        return calibrate_with_places(observations, asked)
    given, held_out, asked, late = without_lag(observations, asked)
    # The transform that most rows agree with, refined on those that do.
    with explained(given, asked):
        rows, (table, fit, mirrored), repeated = fit_distinct(given, asked)
        used, groupings = asked.resolved(fit.threshold_mm), groupings_of(table, rows)
        # How sure it is: the rows' own noise, errors that they share, a second answer that fits as well.
        noise_of = partial(groupings.noise_of, table, known_levels(table, used))
        noise = noise_of(fit)
        refuse_apparent(table, fit.inlier, noise.apparent)
    mapped, few = mapped_rows(fit.transform, table), few_fixed_targets(table, fit.inlier)
    size, seen, area = image_area(rows, fit.inlier, asked.image_size_px)
    noise, rival = beside_rival(beside_unsure_places(noise, mapped, fit), fit, mirrored, area)
    found = Calibration(
        probe_from_image=fit.transform,
        model=fit.model,
        covariance=noise.covariance if predicts(noise) and not few else None,
        noise=noise,
        area_px=area,
        image_size_px=size,
        seen_px=seen,
        fit=ErrorStatistics.of(fit.residuals_mm[fit.inlier], len(rows), int(fit.inlier.sum())),
        test=held_out_errors(fit.transform, held_out, fit.threshold_mm),
        residuals_mm=fit.residuals_mm,
        inlier=fit.inlier,
        options=used,
        _certificate=LazyCertificate(partial(certificate_of, table, fit)),
        _models=Lazy(partial(model_tests, table, fit, noise_of, area_places(area)[:-1])),
        provenance={"input": rows.source, "sha256": rows.sha256, "options": kept_options(asked, used)},
    )

    # What to know before use, looked for when it is first read.
    looks = (
        partial(fit_findings, found, mapped, fit, rival, groupings),
        partial(left_out_findings, table, fit, used, found.accepted),
        partial(area_findings, found, rows.points_px[fit.inlier]),
        partial(held_out_findings, found, held_out),
        partial(set_up_findings, found, rows, mapped),
    )
    return _as_given(replace(found, diagnostics=Findings(looks=looks)), given, repeated, late)


def _as_given(
    found: Calibration, given: Observations, *changed: Repeated | LaggedTable | None
) -> Calibration:
    """The calibration as that of the rows that were given, where others were fitted."""
    for one in changed:
        found = found if one is None else one.told_of(found, given)
    return found
