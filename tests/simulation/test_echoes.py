"""What a simulated scanner shows: echoes where the truth says, brighter with gain, fainter with depth."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sonocal.simulation.ultrasound import Echo, Look, UltrasoundImager
from sonocal.simulation.ultrasound_probe import curvilinear, curvilinear_3d, linear

DARK = Look(
    haze_db=0, near_field_db=0, attenuation_db=0, noise_db=-120, speckle_db=-120, roughness=0, tail_count=0
)
PROBES = {
    "curvilinear": curvilinear(128, 128, 0.8),
    "linear": linear(160, 128, 0.3),
    "3d": curvilinear_3d(40, 2.5),
}
IMAGERS = {name: UltrasoundImager(geometry, DARK) for name, geometry in PROBES.items()}
flat = st.sampled_from(["curvilinear", "linear"])
shares = st.floats(0.15, 0.85)
sides = st.floats(-0.7, 0.7)


def rng():
    return np.random.default_rng(0)


def place_of(name, depth, side, sweep=0.0):
    return PROBES[name].point_at(np.array(depth), np.array(side), sweep if name == "3d" else 0.0)


def centre_px(image):
    """(d,): the centre of brightness, u first."""
    weight = image.astype(float) / image.sum()
    return np.array([(grid * weight).sum() for grid in np.indices(image.shape)])[::-1]


def across(name, place, tilt=0.0, half_mm=30.0):
    """A needle through a place of a 2D image, tilted from its normal along the beam."""
    away = PROBES[name].beam_directions(place)
    along = np.array([0.0, 0.0, np.cos(tilt)]) + np.sin(tilt) * away
    return np.stack([place - half_mm * along, place + half_mm * along])


@settings(max_examples=15)
@given(st.sampled_from(sorted(PROBES)), shares, sides, sides)
def test_an_echo_is_brightest_where_it_is(name, depth, side, sweep):
    place, geometry = place_of(name, depth, side, 0.7 * sweep), PROBES[name]
    image = IMAGERS[name].image([Echo(place[None], np.array([0.5]))], rng())
    expected = place[: geometry.dimension] / geometry.scale_mm_per_px
    brightest = np.array(np.unravel_index(image.argmax(), image.shape))[::-1]
    np.testing.assert_allclose(brightest, expected, atol=2.0)
    np.testing.assert_allclose(centre_px(np.where(image > 0.6 * image.max(), image, 0)), expected, atol=1.0)


@settings(max_examples=12)
@given(flat, shares, sides)
def test_a_needle_is_brightest_where_it_crosses_the_image(name, depth, side):
    place, geometry = place_of(name, depth, side), PROBES[name]
    image = IMAGERS[name].image([IMAGERS[name].needle(across(name, place), rng())], rng())
    brightest = np.array(np.unravel_index(image.argmax(), image.shape))[::-1]
    np.testing.assert_allclose(brightest, place[:2] / geometry.scale_mm_per_px, atol=2.0)


@given(flat, shares, sides, st.floats(0.1, 10))
def test_a_needle_echoes_the_same_whichever_end_comes_first_and_however_long_it_is(name, depth, side, length):
    imager, segment = IMAGERS[name], across(name, place_of(name, depth, side))
    middle = segment.mean(axis=0)
    plain = imager.needle(segment, rng())
    for other in (segment[::-1], middle + length * (segment - middle)):
        echo = imager.needle(other, rng())
        assert np.abs(echo.amplitudes).sum() == pytest.approx(np.abs(plain.amplitudes).sum(), rel=1e-6)
        np.testing.assert_allclose(
            np.sort(echo.points_mm, axis=0), np.sort(plain.points_mm, axis=0), atol=1e-6
        )


@given(flat, shares, sides, st.floats(0, 1.2), st.floats(0.05, 0.3))
def test_a_needle_further_from_across_the_beam_is_no_brighter(name, depth, side, tilt, more):
    imager, place = IMAGERS[name], place_of(name, depth, side)
    steep, flatter = (
        np.abs(imager.needle(across(name, place, t), rng()).amplitudes).sum() for t in (tilt, tilt + more)
    )
    assert flatter < steep


@given(flat, shares, sides)
def test_a_needle_in_the_plane_or_beside_it_never_crosses(name, depth, side):
    beside = place_of(name, depth, side) + np.array([[0.0, 0.0, 3.0], [10.0, 5.0, 3.0]])
    assert len(IMAGERS[name].needle(beside, rng()).points_mm) == 0


@settings(max_examples=12)
@given(flat, shares, sides, st.floats(1, 12))
def test_gain_lifts_every_echo_by_as_many_decibels(name, depth, side, gain):
    echo = Echo(place_of(name, depth, side)[None], np.array([0.1]))
    lifted = UltrasoundImager(PROBES[name], replace(DARK, gain_db=gain))
    before, after = (imager.envelope([echo], rng()).max() for imager in (IMAGERS[name], lifted))
    assert 20 * np.log10(after / before) == pytest.approx(gain, abs=0.05)


@settings(max_examples=12)
@given(flat, sides, st.floats(0.1, 0.45), st.floats(3, 20))
def test_attenuation_takes_as_many_decibels_as_the_echo_is_deep(name, side, shallow, attenuation):
    lossy = UltrasoundImager(PROBES[name], replace(DARK, attenuation_db=attenuation))
    lost = []
    for depth in (shallow, 2 * shallow):
        echo = Echo(place_of(name, depth, side)[None], np.array([0.5]))
        before, after = (imager.envelope([echo], rng()).max() for imager in (IMAGERS[name], lossy))
        lost.append(20 * np.log10(before / after))
    assert lost[1] == pytest.approx(2 * lost[0], rel=0.05)
    assert lost[0] == pytest.approx(attenuation * shallow, rel=0.08)


@settings(max_examples=12)
@given(flat, shares, sides, st.floats(0.1, 1.0), st.floats(1.1, 4.0))
def test_twice_the_amplitude_is_twice_the_envelope_and_never_a_darker_pixel(
    name, depth, side, amplitude, times
):
    place = place_of(name, depth, side)[None]
    faint, bright = (Echo(place, np.array([a])) for a in (0.1 * amplitude, 0.1 * amplitude * times))
    envelopes = [IMAGERS[name].envelope([echo], rng()) for echo in (faint, bright)]
    assert envelopes[1].max() == pytest.approx(times * envelopes[0].max(), rel=1e-3)
    images = [IMAGERS[name].image([echo], rng()).astype(int) for echo in (faint, bright)]
    assert np.all(images[1] >= images[0] - 1)


@given(st.lists(st.floats(1e-8, 10), min_size=2, max_size=20))
def test_grey_levels_grow_with_the_envelope_from_black_to_white(amplitudes):
    grey = IMAGERS["linear"].compress(np.sort(np.array(amplitudes, dtype=np.float32)))
    assert np.all(np.diff(grey) >= 0)
    assert np.all((grey >= 0) & (grey <= 255))
    black, white = IMAGERS["linear"].compress(
        np.array([10 ** (-DARK.dynamic_range_db / 20), 1.0], np.float32)
    )
    assert black == pytest.approx(0, abs=1e-3)
    assert white == pytest.approx(255)


@pytest.mark.parametrize("shadow", [0.0, 0.5, 1.0])
def test_a_shadow_dims_what_lies_behind_it_and_nothing_before_or_beside_it(shadow):
    geometry, imager = PROBES["linear"], UltrasoundImager(PROBES["linear"], replace(DARK, speckle_db=-30.0))
    layer = geometry.point_at(np.full(60, 0.5), np.linspace(-0.3, 0.3, 60))
    plain = imager.envelope([], rng())
    shaded = imager.envelope([Echo(layer, np.zeros(60), shadow=shadow)], rng())
    top, bottom, middle = slice(0, 180), slice(280, 440), slice(75, 115)
    np.testing.assert_allclose(shaded[top], plain[top], atol=1e-5)
    np.testing.assert_allclose(shaded[:, :30], plain[:, :30], atol=1e-5)
    ratio = shaded[bottom, middle].mean() / plain[bottom, middle].mean()
    assert ratio == pytest.approx(1 - shadow, abs=0.05)


@given(st.sampled_from(sorted(PROBES)), st.integers(0, 100))
def test_beams_run_straight_away_from_the_face(name, seed):
    geometry, random = PROBES[name], np.random.default_rng(seed)
    side, sweep = random.uniform(-0.9, 0.9, 2)
    depths = np.linspace(0.05, 0.95, 7)
    points = geometry.point_at(depths, side, sweep if name == "3d" else 0.0)
    directions = geometry.beam_directions(points)
    np.testing.assert_allclose(directions, np.broadcast_to(directions[0], directions.shape), atol=1e-9)
    steps = np.diff(points, axis=0)
    np.testing.assert_allclose(
        steps, np.diff(depths)[:, None] * geometry.depth_mm * directions[:-1], atol=1e-9
    )
