"""A curved probe whose scanner assumes another speed of sound than there was: given, estimated, told, kept, undone."""

import json
import re

import numpy as np
import pytest
from benchmarks.simulators.fans import RADIUS_MM, as_shown, fan_scan
from benchmarks.simulators.trust_judge import image_size, table
from benchmarks.simulators.trust_scans import mapped
from benchmarks.sound import bath_errors, corner_errors, rms, tissue_errors

import sonocal as sc
from sonocal.calibration import calibration_json, parse_calibration, seen_at_assumed_speed
from sonocal.calibration.as_scanned import nearest_similarity
from sonocal.calibration.sound_options import ASSUMED_M_S
from sonocal.geometry import Similarity
from sonocal.validation import validate

SLOW = 0.96
GIVEN = {"probe_radius_mm": RADIUS_MM, "sound_speed_m_s": SLOW * ASSUMED_M_S}
ESTIMATED = {"probe_radius_mm": RADIUS_MM, "sound_speed_m_s": "estimate"}


def scan_of(ratio=SLOW, seed=3, dimension=2):
    return fan_scan(seed, 100 if dimension == 2 else 60, dimension, ratio, still=True)


def found_in(scan, **options):
    return sc.calibrate(table(scan), image_size_px=image_size(scan), **options)


@pytest.fixture(scope="module")
def slow():
    return scan_of()


@pytest.fixture(scope="module")
def given(slow):
    return found_in(slow, **GIVEN)


@pytest.fixture(scope="module")
def estimated(slow):
    return found_in(slow, **ESTIMATED)


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_given_speed_undoes_what_it_does(dimension):
    scan, right = scan_of(dimension=dimension), scan_of(1.0, dimension=dimension)
    at_right, ignored = found_in(right), found_in(scan)
    found = found_in(scan, **GIVEN)
    assert corner_errors(ignored, scan).max() > 2.0
    assert rms(tissue_errors(found, scan)) <= 1.1 * rms(tissue_errors(at_right, right))
    assert rms(bath_errors(found, scan, SLOW)) <= 1.1 * rms(tissue_errors(at_right, right))


@pytest.mark.parametrize("dimension", [2, 3])
def test_an_estimate_places_the_images_scanned_as_well_as_at_the_right_speed(dimension):
    scan, right = scan_of(dimension=dimension), scan_of(1.0, dimension=dimension)
    found = found_in(scan, **ESTIMATED)
    low, high = found.sound.by_rows_m_s
    assert low < SLOW * ASSUMED_M_S < high
    assert found.sound.p_value < 1e-3
    assert rms(bath_errors(found, scan, SLOW)) <= 1.15 * rms(tissue_errors(found_in(right), right))
    assert np.all(corner_errors(found, scan) <= found.predicted_errors()[2][:-1])


def test_an_estimate_is_less_sure_than_a_speed_that_is_known(given, estimated):
    bottom = given.predicted_errors()[0][:, 1] > 400
    assert np.all(estimated.predicted_errors()[2][bottom] > 1.3 * given.predicted_errors()[2][bottom])
    larger = estimated.covariance - given.covariance
    assert np.linalg.eigvalsh(larger / np.sqrt(np.outer(*[np.diag(given.covariance)] * 2)))[-1] > 0.5


def half_m_s(found):
    low, high = found.sound.by_rows_m_s
    return (high - low) / 2


def test_the_scanners_mm_per_px_make_an_estimate_sure(slow, estimated, given):
    true = float(np.linalg.norm(slow.truth[:3, 0]))
    found = found_in(slow, **ESTIMATED, scanner_mm_per_px=true)
    assert half_m_s(found) < 0.5 * half_m_s(estimated)
    assert abs(found.sound.speed_m_s - SLOW * ASSUMED_M_S) < half_m_s(found)
    assert rms(tissue_errors(found, slow)) <= 1.1 * rms(tissue_errors(given, slow))
    assert np.all(found.predicted_errors()[2] < estimated.predicted_errors()[2])
    assert np.linalg.eigvalsh(found.covariance)[0] > 0
    assert any("by the rows and the scanner's mm/px" in one.message for one in found.diagnostics)


def test_a_scanners_number_is_known_to_half_of_its_last_digit(slow, estimated):
    true = float(np.linalg.norm(slow.truth[:3, 0]))
    halves = [half_m_s(found_in(slow, **ESTIMATED, scanner_mm_per_px=round(true, n))) for n in (1, 2, 3, 4)]
    assert np.all(np.diff(halves) < 0)
    assert halves[0] == pytest.approx(half_m_s(estimated), rel=0.01)


def test_mm_per_px_that_the_rows_contradict_are_doubted(slow):
    true = float(np.linalg.norm(slow.truth[:3, 0]))
    found = found_in(slow, **ESTIMATED, scanner_mm_per_px=0.97 * true)
    said = [one.message for one in found.warnings if one.code == "sound-speed-doubtful"]
    assert len(said) == 1
    # Less mm/px is a truth that is smaller in px: depths must be stretched by more.
    assert re.match(r"by the scanner's mm/px sound ran (\d\d) m/s faster than by the rows", said[0])


@pytest.mark.parametrize("options", [{"weighting": "geometric"}, {"threshold_mm": "auto"}])
def test_other_ways_to_fit_find_the_speed_too(slow, estimated, options):
    found = found_in(slow, **ESTIMATED, **options)
    assert abs(found.sound.speed_m_s - SLOW * ASSUMED_M_S) < 1.5 * half_m_s(found)
    assert half_m_s(found) == pytest.approx(half_m_s(estimated), rel=0.2)


def test_outliers_and_copies_do_not_mislead_an_estimate(slow, estimated):
    rows = table(slow)
    rng = np.random.default_rng(0)
    wild = rng.random(len(rows)) < 0.3
    points = np.where(wild[:, None], rng.uniform(0, 500, rows.points_px.shape), rows.points_px)
    found = sc.calibrate(rows.with_sound(points_px=points), image_size_px=image_size(slow), **ESTIMATED)
    assert abs(found.sound.speed_m_s - SLOW * ASSUMED_M_S) < 1.5 * half_m_s(found)
    twice = rows.select(np.tile(np.arange(len(rows)), 2)).with_sound(frame=np.arange(2 * len(rows)))
    copied = sc.calibrate(twice, image_size_px=image_size(slow), **ESTIMATED)
    assert "repeated-rows" in {one.code for one in copied.warnings}
    assert half_m_s(copied) == pytest.approx(half_m_s(estimated), rel=0.01)
    assert len(copied.residuals_mm) == len(twice)


def test_the_speed_that_is_assumed_changes_nothing_to_the_last_digit(slow):
    plain = found_in(slow)
    same = found_in(slow, probe_radius_mm=RADIUS_MM, sound_speed_m_s=ASSUMED_M_S)
    assert np.array_equal(same.probe_from_image.matrix, plain.probe_from_image.matrix)
    assert np.array_equal(same.covariance, plain.covariance)
    assert np.array_equal(same.residuals_mm, plain.residuals_mm)


def test_only_the_ratio_of_the_speeds_counts(slow, given):
    other = found_in(
        slow, probe_radius_mm=RADIUS_MM, sound_speed_m_s=SLOW * 1450.0, assumed_sound_speed_m_s=1450.0
    )
    assert np.allclose(other.probe_from_image.matrix, given.probe_from_image.matrix, rtol=0, atol=1e-9)


def test_another_unit_of_length_changes_the_radius_with_it(slow, given):
    rows = table(slow)
    halved = rows.with_sound(segments_mm=0.5 * rows.segments_mm)
    options = {**GIVEN, "probe_radius_mm": 0.5 * RADIUS_MM, "threshold_mm": 2.5}
    found = sc.calibrate(halved, image_size_px=image_size(slow), **options)
    assert np.allclose(found.probe_from_image.matrix[:3], 0.5 * given.probe_from_image.matrix[:3], atol=1e-6)
    assert found.sound.radius_px == pytest.approx(given.sound.radius_px, rel=1e-7)


@pytest.mark.parametrize("options", [GIVEN, ESTIMATED])
def test_moving_the_images_origin_moves_the_answer_with_it(slow, options):
    shift = np.array([37.0, -12.0])
    rows = table(slow)
    moved = rows.with_sound(points_px=rows.points_px + shift)
    face = (249.5, 0.0)
    here = sc.calibrate(rows, **options, probe_face_px=face)
    there = sc.calibrate(moved, **options, probe_face_px=tuple(np.array(face) + shift))
    corners = slow.corners_px
    assert np.allclose(there.probe_from_image @ (corners + shift), here.probe_from_image @ corners, atol=1e-5)
    assert there.sound.speed_m_s == pytest.approx(here.sound.speed_m_s, abs=1e-3)


def test_the_map_of_images_as_scanned_is_as_far_off_as_it_says(given, slow):
    sound = given.sound
    side = np.linspace(0, image_size(slow)[0] - 1, 31)
    points = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    true = given.probe_from_image @ sound.at_assumed_speed(points)
    off = np.linalg.norm(Similarity.from_matrix(sound.as_scanned) @ points - true, axis=1)
    assert off.max() == pytest.approx(sound.as_scanned_off_mm, rel=0.02)
    assert 0.2 < off.max() < 2.0
    assert np.abs(np.linalg.norm(given.probe_from_image @ points - true, axis=1)).max() > 3.0


def test_of_a_similarity_the_nearest_is_itself():
    for dimension in (2, 3):
        true = Similarity.from_rotvec([0.3, -1.0, 2.0], [10.0, -50.0, 7.0], 0.25)
        area = np.array([[0.0] * dimension, [499.0, 399.0, 199.0][:dimension]])
        found, off = nearest_similarity(true.apply, area)
        assert np.allclose(found.matrix, true.matrix, atol=1e-9)
        assert off < 1e-9


def test_places_go_from_the_image_and_back(given):
    points = np.random.default_rng(0).uniform(0, 500, (50, 2))
    assert np.allclose(given.sound.in_image(given.sound.at_assumed_speed(points)), points, atol=1e-9)
    shown = as_shown(points, given.probe_from_image.matrix, given.sound.ratio)
    assert np.allclose(given.sound.in_image(points), shown, atol=1e-3)


def test_what_is_ignored_is_told_with_its_place(given, slow):
    told = next(one for one in given.diagnostics if one.code == "sound-speed")
    off = corner_errors(found_in(slow), slow)
    assert given.sound.ignored_mm == pytest.approx(off.max(), abs=0.5)
    assert given.sound.ignored_at_px[1] == image_size(slow)[1] - 1
    assert f"{given.sound.ignored_mm:.1f} mm" in told.message
    assert "1478 m/s as given, where the scanner assumes 1540" in told.message
    assert "middle of the image's top row" in told.message
    assert not given.warnings


def test_a_face_that_was_given_is_no_default(slow):
    found = found_in(slow, **GIVEN, probe_face_px=(249.5, 0.0))
    assert not any("by default" in one.message for one in found.diagnostics)


def test_a_speed_that_the_rows_contradict_is_doubted(slow):
    found = found_in(slow, probe_radius_mm=RADIUS_MM, sound_speed_m_s=1580.0)
    assert "sound-speed-doubtful" in {one.code for one in found.warnings}


def test_what_no_bath_has_is_doubted():
    found = found_in(scan_of(0.85), **ESTIMATED)
    assert found.sound.speed_m_s == pytest.approx(1400.0)
    assert "sound-speed-doubtful" in {one.code for one in found.warnings}


def test_few_needles_leave_the_speed_open():
    scan = fan_scan(5, 7, 2, 1.0, still=True)
    found = found_in(scan, **ESTIMATED)
    low, high = found.sound.by_rows_m_s
    assert high - low > 250
    assert "sound-speed-doubtful" in {one.code for one in found.warnings}


def test_without_the_option_the_advice_names_it(slow):
    assert any("--probe-radius-mm" in one.advice for one in found_in(slow).warnings)


def test_the_right_speed_is_not_called_another():
    told = [found_in(scan_of(1.0, seed), **ESTIMATED).sound.p_value < 0.01 for seed in range(20)]
    assert sum(told) <= 1


def test_the_file_keeps_the_sound(given, estimated):
    for one in (given, estimated):
        again = parse_calibration(calibration_json(one), "found.json")
        assert again.sound == one.sound
        assert again.options == one.options
        assert np.array_equal(again.probe_from_image.matrix, one.probe_from_image.matrix)


def test_a_damaged_sound_is_refused(given):
    record = json.loads(calibration_json(given))
    for name, value in {"as_scanned": [[1.0]], "radius_px": -1.0, "face_px": [1.0], "speed_m_s": 0.0}.items():
        damaged = record | {"sound": record["sound"] | {name: value}}
        with pytest.raises(sc.FormatError, match="damaged"):
            parse_calibration(json.dumps(damaged).encode(), "found.json")


def test_held_out_rows_and_validation_are_of_the_same_bath(slow):
    rows = table(slow)
    fitted, other = rows.select(np.arange(0, 100, 2)), rows.select(np.arange(1, 100, 2))
    other = other.with_sound(source="other")
    numbers, ignored = (
        validate(sc.calibrate(fitted, image_size_px=image_size(slow), **options), other)
        for options in (GIVEN, {})
    )
    assert numbers["held-out"].value_mm < 0.8
    assert not {one.code for one in numbers.diagnostics} & {"other-depth-setting", "held-out-rows-off"}
    assert ignored["held-out"].value_mm > 1.1 * numbers["held-out"].value_mm
    split = np.where(np.arange(len(rows)) % 4 == 0, "test", "fit")
    found = sc.calibrate(
        rows.with_sound(split=split), image_size_px=image_size(slow), test_split="test", **GIVEN
    )
    assert found.test.rms_mm < 0.8
    assert seen_at_assumed_speed(None, rows) is rows


def test_a_report_is_made(given, slow):
    assert b"<html" in given.report(table(slow)).content


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (
            {"sound_speed_m_s": 1480},
            "of a linear probe a wrong speed is another scale along v, which the anisotropic model",
        ),
        ({"probe_radius_mm": 60}, "probe_radius_mm says nothing without sound_speed_m_s"),
        ({"probe_face_px": (1, 2)}, "probe_face_px says nothing without sound_speed_m_s"),
        ({**GIVEN, "model": "anisotropic"}, "leave out one of them"),
        ({**GIVEN, "sound_speed_m_s": "guess"}, 'a speed in m/s or "estimate"'),
        ({**GIVEN, "sound_speed_m_s": 1.48}, "from 1000 to 2500 m/s; got 1.48"),
        ({**GIVEN, "assumed_sound_speed_m_s": 0}, "assumed_sound_speed_m_s must be"),
        ({**GIVEN, "probe_radius_mm": 0.06}, "from 1 to 1000 mm; got 0.06"),
        ({**GIVEN, "probe_face_px": (1, 2, 3)}, "must be 2 numbers for a 2D probe"),
        ({**GIVEN, "probe_face_px": ("a", 2)}, "a place in the image; got"),
    ],
)
def test_what_means_nothing_is_refused_in_a_sentence(slow, options, words):
    with pytest.raises(sc.InputError) as refused:
        found_in(slow, **options)
    assert words in str(refused.value)


def test_without_an_image_size_the_face_must_be_told(slow):
    with pytest.raises(sc.InputError, match="give probe_face_px, or image_size_px"):
        sc.calibrate(table(slow), **GIVEN)
    found = sc.calibrate(table(slow), **GIVEN, probe_face_px=(249.5, 0))
    corners = slow.corners_px
    assert np.linalg.norm(found.probe_from_image @ corners - mapped(slow.truth, corners), axis=1).max() < 1.0


def test_rows_of_points_are_refused(slow):
    rows = table(slow)
    spanning = np.full((len(rows), 3, 3), np.nan)
    spanning[:, 0] = rows.segments_mm[:, 0]
    mixed = sc.Observations.of_targets(rows.points_px, spanning)
    with pytest.raises(sc.UnsupportedError, match="for needles and wires alone"):
        sc.calibrate(mixed, image_size_px=image_size(slow), **GIVEN)


def test_too_few_rows_to_tell_a_speed_are_refused():
    scan = fan_scan(5, 4, 2, 1.0, still=True)
    with pytest.raises(sc.SonocalError, match="speed of sound"):
        found_in(scan, **ESTIMATED)
    found = found_in(scan, probe_radius_mm=RADIUS_MM, sound_speed_m_s=1500.0)
    assert found.sound.by_rows_m_s is None
    assert parse_calibration(calibration_json(found), "found.json").sound == found.sound
    assert "1500 m/s as given" in next(one.message for one in found.diagnostics if one.code == "sound-speed")
