"""calibrate(): options, held-out rows, diagnostics; and the file it is kept in."""

import dataclasses
import json

import numpy as np
import pytest

import sonocal as sc
from sonocal.calibration import (
    calibration_json,
    parse_calibration,
)
from sonocal.calibration.diagnostics import diagnose_noise
from sonocal.registration.noise import Drift, Noise
from sonocal.simulation.scene import simulate_observations
from sonocal.validation import give_verdict
from tests.builders.similarities import random_similarity


@pytest.fixture(scope="module")
def rows():
    return simulate_observations(2, 40, outlier_share=0.1, seed=1).observations


@pytest.fixture(scope="module")
def calibration(rows):
    return sc.calibrate(rows)


def with_split(rows, fit_count):
    split = np.where(np.arange(len(rows)) < fit_count, "fit", "test")
    return dataclasses.replace(rows, split=split)


def test_held_out_rows_are_reported_and_not_fitted(rows):
    parts = with_split(rows, 30)
    found = sc.calibrate(parts, fit_split="fit", test_split="test")
    alone = sc.calibrate(rows.select(np.arange(30)))
    np.testing.assert_array_equal(found.probe_from_image.matrix, alone.probe_from_image.matrix)
    assert (found.fit.observations, found.test.observations) == (30, 10)
    assert alone.test is None
    assert sc.calibrate(parts, test_split="test").fit == found.fit


def test_held_out_errors_count_every_row_and_fitted_ones_those_that_agree(rows):
    found = sc.calibrate(with_split(rows, 30), fit_split="fit", test_split="test")
    residuals = found.residuals_mm[found.inlier]
    assert found.fit.rms_mm == pytest.approx(np.sqrt(np.mean(residuals**2)))
    assert found.fit.max_mm == residuals.max() <= 5
    assert found.test.max_mm > 5 or found.test.inliers == 10


def test_predicted_errors_are_quoted_at_the_corners_of_the_image_given(rows):
    found = sc.calibrate(dataclasses.replace(rows, image_size_px=None), image_size_px=(640, 480))
    places = found.predicted_errors()[0]
    np.testing.assert_array_equal(places[:4], [[0, 0], [0, 479], [639, 0], [639, 479]])
    np.testing.assert_array_equal(places[4], [319.5, 239.5])


def test_predict_gives_places_and_symmetric_covariances(calibration):
    places, covariances = calibration.predict([[0.0, 0], [250, 250]])
    np.testing.assert_allclose(places, calibration.probe_from_image @ [[0.0, 0], [250, 250]])
    np.testing.assert_allclose(covariances, np.swapaxes(covariances, 1, 2), atol=1e-15)
    assert np.all(np.linalg.eigvalsh(covariances) > 0)
    assert np.trace(covariances[0]) > np.trace(covariances[1])  # a corner is known less well than the centre


OPTION_REFUSALS = [
    ({"model": "affine"}, "model must be one of similarity, anisotropic, rigid; got 'affine'"),
    ({"threshold_mm": 0}, "threshold_mm must be a positive number; got 0"),
    ({"threshold_mm": float("nan")}, "threshold_mm must be a positive number; got nan"),
    ({"tolerance_mm": -1}, "tolerance_mm must be a positive number; got -1"),
    ({"max_samples": 0}, "max_samples must be a whole number from 1 to 1073741824; got 0"),
    (
        {"fit_split": "a", "test_split": "a"},
        "fit_split and test_split are both 'a'; held-out rows must not be fitted",
    ),
    (
        {"fit_split": "a"},
        "simulation (seed 1): no row has split 'a'; it has no column split: add one that says which part of the data "
        "a row belongs to",
    ),
    (
        {"image_size_px": (640, 480, 3)},
        "image_size_px must be 2 positive numbers for a 2D probe; got (640, 480, 3)",
    ),
]


@pytest.mark.parametrize(("options", "sentence"), OPTION_REFUSALS)
def test_options_that_make_no_sense_are_refused(rows, options, sentence):
    with pytest.raises(sc.InputError) as caught:
        sc.calibrate(rows, **options)
    assert str(caught.value) == sentence


def test_an_option_that_does_not_exist_is_refused(rows):
    with pytest.raises(sc.InputError, match=r"'treshold_mm'.*'threshold_mm'"):
        sc.calibrate(rows, treshold_mm=3)


def test_too_few_rows_are_refused(rows):
    with pytest.raises(sc.InputError) as caught:
        sc.calibrate(rows.select([0, 1, 2]))
    assert str(caught.value) == (
        "simulation (seed 1): has 3 rows to fit and the similarity model of a 2D probe needs at least 4; "
        "scan more needle poses, ten or more for an answer to rely on"
    )


def test_3d_rows_that_make_no_lines_are_refused():
    rows = simulate_observations(3, 6).observations
    with pytest.raises(sc.InputError) as caught:
        sc.calibrate(rows.select(np.arange(0, 12, 2)))
    assert str(caught.value) == (
        "simulation (seed 0): fewer than two sightings have two points; a 3D probe sees a needle as a line, so give "
        "two or more rows with one frame and target, or leave out w_px for a 2D probe"
    )


def test_more_points_on_a_3d_needle_are_used():
    scene = simulate_observations(3, 8, sigma_px=0, sigma_mm=0, seed=2)
    rows = scene.observations
    middle = rows.points_px.reshape(-1, 2, 3).mean(axis=1)
    frame = rows.frame.reshape(-1, 2)[:, 0]
    more = sc.Observations(
        np.vstack([rows.points_px, middle]),
        np.vstack([rows.segments_mm, rows.segments_mm[::2]]),
        frame=np.concatenate([rows.frame, frame]),
    )
    found = sc.calibrate(more)
    np.testing.assert_allclose(found.probe_from_image.matrix, scene.probe_from_image.matrix, atol=1e-9)
    assert found.fit.observations == 24


def codes(found):
    return [d.code for d in found.warnings]


def test_pixels_of_unequal_size_are_noticed_and_the_wider_model_fits_them(rows):
    stretched = dataclasses.replace(rows, points_px=rows.points_px * [1, 1.1], image_size_px=(500, 550))
    found = sc.calibrate(stretched)
    assert codes(found) == ["anisotropic-scale", "anisotropic-scale-far-off"]
    message = found.warnings[0].message
    assert message.startswith("the residuals point to different mm/px in u and v: 0.2")
    assert " % apart (+-" in message
    wider = sc.calibrate(stretched, model="anisotropic")
    assert codes(wider) == []
    assert wider.probe_from_image.scales[0] / wider.probe_from_image.scales[1] == pytest.approx(1.1, abs=0.02)
    assert wider.covariance.shape == (8, 8)


def test_equal_pixels_are_not_called_unequal():
    false = sum(
        "anisotropic-scale" in codes(sc.calibrate(simulate_observations(2, 40, seed=s).observations))
        for s in range(60)
    )
    assert false <= 1


def test_many_outliers_are_warned_of():
    found = sc.calibrate(simulate_observations(2, 40, outlier_share=0.3, seed=3).observations)
    warning = next(d for d in found.warnings if d.code == "many-outliers")
    assert warning.message == "12 of 40 rows are further than 5 mm from their lines and were left out"


def test_a_drift_is_warned_of():
    rng, truth = np.random.default_rng(0), random_similarity(0, scale=0.24)
    frame = np.repeat(np.arange(120), 6)
    points = rng.uniform(0, 500, (720, 2))
    drift = np.sin(frame / 15)[:, None] * [1.0, -0.5, 0.5]
    middle = truth @ points + drift + 0.1 * rng.normal(size=(720, 3))
    along = rng.normal(size=(720, 3)) * 50
    found = sc.calibrate(
        sc.Observations(
            points, np.stack([middle - along, middle + along], axis=1), frame=frame, target=np.arange(720) % 6
        )
    )
    assert "drifting-residuals" in codes(found)


def test_four_rows_leave_nothing_to_check_with():
    found = sc.calibrate(simulate_observations(2, 4, seed=3).observations)
    assert codes(found)[0] == "no-redundancy"


def hardly_determined(kind, seed):
    """A 3D probe's sightings with noise, of needles that are parallel or pass through one point."""
    rng, truth = np.random.default_rng(seed), random_similarity(seed, scale=0.24)
    points = np.repeat(rng.uniform(0, 500, (10, 1, 3)), 2, axis=1)
    points[:, 1, 2] += 200.0
    if kind == "through a point":
        points = np.stack([np.full((10, 3), 250.0), rng.uniform(0, 500, (10, 3))], axis=1)
    seen = points + rng.normal(size=points.shape)
    segments = truth @ points + 0.5 * rng.normal(size=points.shape)
    frame = np.repeat(np.arange(10), 2)
    return sc.Observations(seen.reshape(-1, 3), np.repeat(segments, 2, axis=0), frame=frame)


@pytest.mark.parametrize("kind", ["parallel", "through a point"])
@pytest.mark.parametrize("seed", range(12))
def test_what_hardly_determines_a_3d_probe_is_refused_or_not_to_be_used(kind, seed):
    try:
        found = sc.calibrate(hardly_determined(kind, seed))
    except (sc.DegenerateGeometryError, sc.NoConsensusError) as error:
        assert "\n" not in str(error)
    else:
        assert give_verdict(found).level != "use"


# The calibration file


def test_the_file_gives_back_the_calibration_to_the_last_bit(calibration, tmp_path):
    calibration.save(tmp_path / "c.json")
    again = sc.load(tmp_path / "c.json")
    np.testing.assert_array_equal(again.probe_from_image.matrix, calibration.probe_from_image.matrix)
    np.testing.assert_array_equal(again.covariance, calibration.covariance)
    np.testing.assert_array_equal(again.residuals_mm, calibration.residuals_mm)
    np.testing.assert_array_equal(again.inlier, calibration.inlier)
    assert (again.fit, again.test, again.diagnostics) == (
        calibration.fit,
        calibration.test,
        calibration.diagnostics,
    )
    np.testing.assert_allclose(again.predicted_errors()[2], calibration.predicted_errors()[2])


@pytest.mark.parametrize("model", ["similarity", "anisotropic"])
def test_the_file_has_the_documented_fields(rows, model):
    fields = json.loads(calibration_json(sc.calibrate(rows, model=model)))
    assert list(fields) == [
        "format", "version", "created", "conventions", "probe_from_image", "model", "scale_mm_per_px", "rotation_wxyz",
        "translation_mm", "covariance", "sigma", "area_px", "image_size_px",
        "seen_px", "fit", "test", "residuals_mm", "inlier", "latency_s",
        "latency_interval_s", "sound", "targets", "phantom", "certificate", "models", "diagnostics", "provenance",
    ]  # fmt: skip
    assert fields["format"] == "sonocal-calibration"
    assert len(fields["scale_mm_per_px"]) == (1 if model == "similarity" else 2)
    assert set(fields["fit"]) == {"observations", "inliers", "rms_mm", "median_mm", "p95_mm", "max_mm"}
    assert parse_calibration(json.dumps(fields).encode(), "c.json").model == model


def test_a_calibration_without_covariance_is_kept_and_refuses_to_predict(tmp_path):
    rows = simulate_observations(2, 4, seed=3).observations
    found = dataclasses.replace(sc.calibrate(rows), covariance=None)
    found.save(tmp_path / "c.json")
    with pytest.raises(sc.UnsupportedError) as caught:
        sc.load(tmp_path / "c.json").predicted_errors()
    assert str(caught.value) == (
        "this calibration has no row to spare and so no covariance; calibrate with more sightings"
    )


def damaged(calibration, **changes):
    return json.dumps(json.loads(calibration_json(calibration)) | changes).encode()


def test_files_that_are_no_calibration_are_refused(calibration):
    def sentence(content, kind=sc.FormatError):
        with pytest.raises(kind) as caught:
            parse_calibration(content, "c.json")
        return str(caught.value)

    assert sentence(b"{").startswith("c.json: is not a calibration file (")
    assert sentence(b"{}") == (
        "c.json: is JSON but not a calibration: its format is None where it must be 'sonocal-calibration'; name the "
        "calibration.json that sonocal calibrate wrote"
    )
    assert sentence(damaged(calibration, version=99), sc.UnsupportedError) == (
        "c.json: has version 99 of the calibration format and this sonocal reads up to 1; update sonocal"
    )
    assert sentence(damaged(calibration, model="x")) == (
        "c.json: is a damaged calibration file (Invalid enum value 'x' - at `$.model`); calibrate again"
    )
    assert sentence(damaged(calibration, probe_from_image=[[1.0]])) == (
        "c.json: is a damaged calibration file (probe_from_image has shape (1, 1) and not (4, 4)); calibrate again"
    )
    assert "covariance has shape (1, 1) and not (7, 7)" in sentence(damaged(calibration, covariance=[[1.0]]))
    assert "scale_mm_per_px is [0.0] and not positive" in sentence(
        damaged(calibration, scale_mm_per_px=[0.0])
    )
    for name in ("area_px", "seen_px"):
        for corners in ([[0, 0]], [[0, 0], [1, 1e30]], [[5, 5], [4, 9]], [[0], [1]]):
            assert f"{name} is {[[float(x) for x in one] for one in corners]} and not the least" in sentence(
                damaged(calibration, **{name: corners})
            )
    skewed = np.diag([1.0, 2, 3, 1]).tolist()
    assert "a similarity needs a rotation" in sentence(damaged(calibration, probe_from_image=skewed))


def test_saving_where_it_cannot_be_leaves_nothing(calibration, tmp_path):
    (tmp_path / "folder").mkdir()
    for path in (tmp_path / "no" / "c.json", tmp_path / "folder"):
        with pytest.raises(sc.InputError, match=r"cannot be written \(.*\); choose another place"):
            calibration.save(path)
    assert [p.name for p in tmp_path.iterdir()] == ["folder"]
    assert not list((tmp_path / "folder").iterdir())


@pytest.mark.parametrize("stamps", [[0.0, 1e300], [0.0, 1e-300], [5.0, 5.0], [1e18, 1e18 + 256]])
def test_stamps_that_are_no_time_are_taken_by_their_order(rows, stamps):
    last, first = np.array(stamps)[::-1]
    time = np.linspace(first, last, len(rows))
    time[-1] = last
    found = sc.calibrate(rows.with_sound(extra={"time_s": time.astype(str)}))
    assert np.isfinite(found.covariance).all()


@pytest.mark.parametrize("odd", [np.nan, np.inf, -np.inf, 1e12])
def test_a_point_that_is_nowhere_in_an_image_is_named(odd):
    found = sc.calibrate(simulate_observations(2, 30, seed=1).observations)
    with pytest.raises(sc.InputError, match=r"^points_px must lie in an image; row 1 is at \("):
        found.predict([[1, 2], [odd, 1], [odd, odd]])


@pytest.mark.parametrize(
    ("stretches", "words"),
    [
        (0.6, "one independent stretch was"),
        (1.4, "one independent stretch was"),
        (3.2, "3 independent stretches were"),
    ],
)
def test_how_many_stretches_were_seen_is_said_in_english(stretches, words):
    noise = Noise(
        row_mm=1.0,
        covariance=np.eye(7),
        freedom=9,
        shared_mm={"stretch": 2.0},
        drift=Drift(9.0, stretches, 30.0),
    )
    (found,) = diagnose_noise(noise)
    assert f"; only about {words} seen, so that the predicted error is a guess" in found.message
