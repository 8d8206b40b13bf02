"""Synthetic ultrasound: its statistics and its geometry are known."""

from dataclasses import replace

import numpy as np
import pytest

from sonocal import InputError
from sonocal.simulation.sweep import SweepOptions, simulate_sweep
from sonocal.simulation.ultrasound import Echo, Look, UltrasoundImager
from sonocal.simulation.ultrasound_probe import ProbeGeometry, curvilinear, curvilinear_3d, linear

FLAT = Look(haze_db=0, near_field_db=0, attenuation_db=0, noise_db=-120)
PROBES = [curvilinear(200, 180, 0.5), linear(200, 180, 0.2), curvilinear_3d(48, 2.0)]


@pytest.mark.parametrize("geometry", PROBES[:2], ids=["curvilinear", "linear"])
def test_speckle_has_a_rayleigh_envelope(geometry):
    envelopes = [
        UltrasoundImager(geometry, FLAT).envelope([], np.random.default_rng(seed))[40:-20, 20:-20]
        for seed in range(6)
    ]
    envelope = np.concatenate(envelopes)
    # Mean over standard deviation of a Rayleigh variable: sqrt(pi / (4 - pi)) = 1.913.
    assert envelope.mean() / envelope.std() == pytest.approx(1.913, rel=0.05)
    level = 20 * np.log10(np.sqrt((envelope**2).mean()))
    assert level == pytest.approx(FLAT.speckle_db, abs=0.7)


@pytest.mark.parametrize("geometry", PROBES, ids=["curvilinear", "linear", "3d"])
def test_places_and_beams_are_each_others_inverse(geometry):
    rng = np.random.default_rng(0)
    depth, lateral, sweep = rng.uniform(0.1, 0.9, 50), rng.uniform(-0.9, 0.9, 50), rng.uniform(-0.9, 0.9, 50)
    beams = geometry.beams_of(geometry.point_at(depth, lateral, sweep if geometry.dimension == 3 else 0.0))
    np.testing.assert_allclose(beams[:, 0], depth * (geometry.samples - 1), atol=1e-9)
    np.testing.assert_allclose(beams[:, 1], (lateral + 1) / 2 * (geometry.lines - 1), atol=1e-9)
    if geometry.dimension == 3:
        np.testing.assert_allclose(beams[:, 2], (sweep + 1) / 2 * (geometry.planes - 1), atol=1e-9)


@pytest.mark.parametrize("geometry", PROBES[:2], ids=["curvilinear", "linear"])
def test_an_echo_appears_where_it_is_and_as_bright_as_it_is(geometry):
    dark = replace(FLAT, speckle_db=-120.0, dynamic_range_db=40.0)
    place = geometry.point_at(np.array(0.5), np.array(0.3))
    image = UltrasoundImager(geometry, dark).image(
        [Echo(place[None], np.array([0.5]))], np.random.default_rng(0)
    )
    v, u = np.indices(image.shape)
    weight = image.astype(float)
    centre = np.array([(u * weight).sum(), (v * weight).sum()]) / weight.sum()
    np.testing.assert_allclose(
        centre * geometry.scale_mm_per_px, place[:2], atol=0.6 * geometry.scale_mm_per_px
    )
    assert image.max() == pytest.approx(255 * (1 - 6.02 / 40), abs=12)


def test_the_point_spread_widens_with_depth():
    geometry, dark = curvilinear(200, 180, 0.5), replace(FLAT, speckle_db=-120.0, dynamic_range_db=40.0)
    imager = UltrasoundImager(geometry, dark)
    widths = []
    for depth in (0.1, 0.9):
        place = geometry.point_at(np.array(depth), np.array(0.0))
        image = imager.image([Echo(place[None], np.array([1.0]))], np.random.default_rng(0))
        widths.append((image.max(axis=0) > 120).sum())
    assert widths[1] > 1.5 * widths[0]


def test_a_needle_is_brightest_across_the_beam():
    imager = UltrasoundImager(curvilinear(200, 180, 0.5), FLAT)
    place = imager.geometry.point_at(np.array(0.5), np.array(0.0))
    brightness = []
    for slope in (0.0, 0.5, 1.5):
        along = np.array([0.0, slope, 1.0])
        echo = imager.needle(np.stack([place - along, place + along]), np.random.default_rng(0))
        brightness.append(imager.envelope([echo], np.random.default_rng(0)).max())
    assert brightness[0] > brightness[1] > brightness[2]


def test_no_beam_no_light():
    geometry = curvilinear(200, 180, 0.5)
    imager = UltrasoundImager(geometry)
    image = imager.image([], np.random.default_rng(0))
    assert (image[~imager.inside] == 0).all()
    assert 0.4 < imager.inside.mean() < 0.9


def test_the_same_seed_gives_the_same_images_in_any_order():
    options = SweepOptions(frames=6, seed=4)
    first, second = (simulate_sweep(curvilinear(100, 100, 1.0), options=options) for _ in range(2))
    backwards = [second.recording.frames[i] for i in reversed(range(6))][::-1]
    for a, b in zip(first.recording.frames, backwards, strict=True):
        np.testing.assert_array_equal(a, b)
    other = simulate_sweep(curvilinear(100, 100, 1.0), options=replace(options, seed=5))
    assert (other.recording.frames[0] != backwards[0]).any()


@pytest.mark.parametrize("geometry", [curvilinear(100, 100, 1.0), curvilinear_3d(32, 3.0)], ids=["2d", "3d"])
def test_without_noise_the_needle_passes_through_its_image_points(geometry):
    sweep = simulate_sweep(geometry, options=SweepOptions(frames=12, sigma_px=0, sigma_mm=0, latency_s=0.0))
    probe_from_needle = sweep.recording.between("Probe", "Needle").matrices
    ends = (
        sweep.lines[0].segment_mm @ np.swapaxes(probe_from_needle[:, :3, :3], 1, 2)
        + probe_from_needle[:, None, :3, 3]
    )
    points = sweep.truth.probe_from_image @ sweep.truth.points_px.reshape(12, -1, geometry.dimension)
    along = (ends[:, 1] - ends[:, 0]) / np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)[:, None]
    distance = np.linalg.norm(np.cross(points - ends[:, :1], along[:, None]), axis=-1)
    assert distance.max() < 1e-6


def test_the_tracker_lags_by_the_latency_asked_for():
    late, prompt = (
        simulate_sweep(
            curvilinear(100, 100, 1.0),
            options=SweepOptions(frames=40, sigma_mm=0, rate_hz=20, latency_s=latency),
        ).recording.poses["tracker_from_probe"]
        for latency in (0.1, 0.0)
    )
    np.testing.assert_allclose(late.matrices[2:], prompt.matrices[:-2], atol=1e-9)


def test_hidden_images_and_lost_poses_are_as_many_as_asked_for():
    sweep = simulate_sweep(
        curvilinear(100, 100, 1.0), options=SweepOptions(frames=100, hidden_share=0.2, dropout_share=0.1)
    )
    assert sweep.truth.visible.sum() == 80
    assert sweep.recording.poses["tracker_from_needle"].valid.sum() == 90
    assert (sweep.truth.clear <= sweep.truth.visible).all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"frames": 0}, "a sweep needs frames and a rate; got 0"),
        ({"sigma_px": -1.0}, "noise cannot be negative"),
        ({"hidden_share": 1.5}, "hidden_share is between 0 and 1; got 1.5"),
    ],
)
def test_options_that_make_no_sense_are_refused(options, message):
    with pytest.raises(InputError, match=message):
        SweepOptions(**options)


def test_an_image_without_a_size_is_refused():
    with pytest.raises(InputError, match="16 px or more"):
        ProbeGeometry((4, 4), 0.2, 50, 2)


@pytest.mark.parametrize("geometry", PROBES, ids=["curvilinear", "linear", "3d"])
def test_what_is_inside_is_what_beams_reach(geometry):
    places = geometry.pixels_mm()[..., : geometry.dimension]
    np.testing.assert_array_equal(geometry.inside(places), UltrasoundImager(geometry).inside)
    assert not geometry.inside(places - 1000.0).any()


def test_a_needle_beside_the_image_does_not_show():
    geometry = curvilinear(200, 180, 0.5)
    sweep = simulate_sweep(geometry, options=SweepOptions(frames=200, rate_hz=2, hidden_share=0, seed=3))
    shown = geometry.inside(sweep.truth.shown_px * geometry.scale_mm_per_px)
    np.testing.assert_array_equal(sweep.truth.visible, shown)
    assert (sweep.truth.clear <= sweep.truth.visible).all()


def test_a_needle_shows_all_through_a_volume():
    """Two points of it are given, its echo reaches from one side of the fan to the other."""
    geometry = curvilinear_3d(48, 2.0)
    middle = geometry.point_at(0.5, 0.0)
    segment = middle + np.outer([-1.0, 1.0], [1.0, 0.0, 0.0])
    echo = UltrasoundImager(geometry).needle(segment, np.random.default_rng(0))
    width = 2 * geometry.point_at(0.5, 0.9)[0] - 2 * middle[0]
    assert np.ptp(echo.points_mm[:, 0]) > width
