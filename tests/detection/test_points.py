"""Candidate points: laws of a detector, and pictures whose truth is known."""

import numpy as np
import pytest

import sonocal as sc
from sonocal.detection import DetectionOptions, PointDetector, as_grey, detect, find_mask
from sonocal.recording import (
    ArrayFrames,
    ImageGeometry,
    Recording,
)
from sonocal.recording.formats import read_recording

SHAPE = (120, 160)


def blob(u, v, sigma=4.0, height=150.0, shape=SHAPE, aspect=0.5):
    rows, cols = np.mgrid[: shape[0], : shape[1]]
    return height * np.exp(-0.5 * (((cols - u) / sigma) ** 2 + ((rows - v) / (aspect * sigma)) ** 2))


def detector(shape=SHAPE, **options):
    return PointDetector(np.ones(shape, dtype=bool), **options)


def grey(*blobs, floor=20.0):
    return np.clip(floor + sum(blobs), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("centre", ["head", "mass"])
@pytest.mark.parametrize("place", [(40.0, 50.0), (80.3, 60.7), (121.5, 30.25)])
def test_a_blob_is_found_to_a_fifth_of_a_pixel(centre, place):
    points, _, _ = detector(centre=centre).detect(grey(blob(*place)))
    np.testing.assert_allclose(points[0], place, atol=0.2)


def test_shifting_the_image_shifts_the_candidates_with_it():
    image = grey(blob(60, 50), blob(110, 80, height=90))
    first, _, _ = detector().detect(image)
    second, _, _ = detector().detect(np.roll(image, (4, 10), axis=(0, 1)))
    np.testing.assert_allclose(second - first, np.tile([10, 4], (len(first), 1)), atol=1e-6)


def test_mirroring_the_image_mirrors_the_candidates():
    image = grey(blob(61, 50), blob(110, 80, height=90))
    first, _, _ = detector().detect(image)
    mirrored, _, _ = detector().detect(image[:, ::-1])
    np.testing.assert_allclose(mirrored[:, 0], SHAPE[1] - 1 - first[:, 0], atol=0.3)


def test_brighter_blobs_come_first_and_no_more_than_asked_for():
    image = grey(*(blob(20 + 30 * i, 60, height=60 + 20 * i) for i in range(5)))
    points, _, scores = detector(count=3).detect(image)
    assert len(points) == 3
    assert (np.diff(scores) <= 0).all()
    np.testing.assert_allclose(points[:, 0], [140, 110, 80], atol=0.5)


def test_the_first_echo_is_the_needle_and_its_tail_is_not():
    delays = np.arange(5)
    shape = (400, 400)
    amplitude = sum(blob(180, 140 + 14 * n, sigma=9, height=0.45**n, shape=shape) for n in delays)
    image = (255 + 255 / 60 * 20 * np.log10(np.maximum(amplitude, 1e-3))).clip(0, 255).astype(np.uint8)
    head, _, _ = detector(shape, centre="head").detect(image)
    mass, _, _ = detector(shape, centre="mass").detect(image)
    np.testing.assert_allclose(head[0], [180, 140], atol=0.5)
    assert mass[0, 1] > 142


def merged_with_its_tail(phase, sigma=6.0, period=7.0, shape=(300, 300)):
    """A steep needle's echo, so tall that reverberations of this phase run into it; its place is (150, 120)."""
    rows, cols = np.mgrid[: shape[0], : shape[1]]
    orders = np.arange(6)
    weights = 0.45**orders * np.exp(1j * phase * (orders > 0))
    echoes = np.exp(-0.5 * ((rows[..., None] - 120 - period * orders) / sigma) ** 2) @ weights
    amplitude = np.abs(echoes) * np.exp(-0.5 * ((cols - 150) / 5) ** 2)
    return (200 + 255 / 60 * 20 * np.log10(np.maximum(amplitude, 1e-5))).clip(0, 255).astype(np.uint8)


@pytest.mark.parametrize("phase", [0.0, 0.5 * np.pi, np.pi])
def test_one_reading_of_an_echo_merged_with_its_tail_is_the_needle(phase):
    points, _, _ = detector((300, 300)).detect(merged_with_its_tail(phase))
    assert np.hypot(*(points - [150, 120]).T).min() < 2


def test_the_second_reading_of_a_merged_echo_lies_deeper_and_counts_half():
    points, _, scores = detector((300, 300)).detect(merged_with_its_tail(0.0))
    assert len(points) == 2
    np.testing.assert_allclose(points[1, 0], points[0, 0])
    assert 2 <= points[1, 1] - points[0, 1] < 4
    assert scores[1] == scores[0] / 2


def test_a_second_reading_takes_nobodys_place():
    image = merged_with_its_tail(0.0)
    for u, v in ((60, 60), (240, 60), (60, 240), (240, 240)):
        image = np.maximum(image, blob(u, v, height=220, shape=(300, 300)).astype(np.uint8))
    points, _, _ = detector((300, 300)).detect(image)
    assert len(points) == 5
    assert (np.abs(points[:, 0] - 150) < 2).sum() == 1


@pytest.mark.parametrize("slope", [-0.6, 0.0, 0.4])
def test_an_oblique_needle_is_one_candidate_at_its_middle(slope):
    rows, cols = np.mgrid[:240, :320]
    off = rows - 110 - slope * (cols - 150)
    beads = 1 + 0.05 * np.sin(0.9 * cols)
    image = grey(170 * beads * np.exp(-0.5 * ((cols - 150) / 12.0) ** 2 - 0.5 * (off / 2.5) ** 2), floor=30)
    points, _, _ = detector(image.shape).detect(image)
    assert len(points) == 1
    np.testing.assert_allclose(points[0], [150, 110], atol=1)


def test_a_layer_does_not_fill_the_list():
    rows = np.mgrid[: SHAPE[0], : SHAPE[1]][0]
    beads = 1 + 0.2 * np.sin(np.arange(SHAPE[1]))
    layer = 200 * beads * np.exp(-0.5 * ((rows - 90) / 2.0) ** 2)
    points, _, _ = detector(count=2).detect(grey(blob(60, 30, height=80), layer))
    assert np.hypot(*(points - [60, 30]).T).min() < 0.5


def test_nothing_is_found_where_the_mask_hides_it():
    mask = np.ones(SHAPE, dtype=bool)
    mask[:, 100:] = False
    points, _, _ = PointDetector(mask).detect(grey(blob(60, 50), blob(130, 60, height=200)))
    assert (points[:, 0] < 100).all()
    np.testing.assert_allclose(points[0], [60, 50], atol=0.3)


@pytest.mark.parametrize("level", [0, 90, 255])
def test_a_constant_image_has_no_candidates(level):
    points, covariances, scores = detector().detect(np.full(SHAPE, level, dtype=np.uint8))
    assert points.shape == (0, 2)
    assert covariances.shape == (0, 2, 2)
    assert scores.shape == (0,)


def test_depth_of_pixel_and_colour_change_nothing():
    image = grey(blob(60, 50, height=235))
    expected = detector().detect(image)[0]
    assert image.max() == 255
    np.testing.assert_allclose(detector().detect(image.astype(np.uint16) * 257)[0], expected, atol=1e-3)
    np.testing.assert_allclose(detector().detect(np.stack([image] * 3, axis=-1))[0], expected, atol=0.05)


@pytest.mark.parametrize("shape", [(16, 16), (16, 900), (2000, 1500)])
def test_tiny_long_and_huge_images_work(shape):
    u, v = shape[1] / 2 + 0.25, shape[0] / 2
    sigma = max(2.0, min(shape) / 80)
    points, _, _ = detector(shape).detect(grey(blob(u, v, sigma=sigma, shape=shape)))
    assert np.hypot(*(points[0] - [u, v])) < 0.15 * sigma


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (np.zeros((8, 8), np.uint8), "of 16 px or more a side; got shape (8, 8)"),
        (np.zeros((32, 32), complex), "pixels of type complex128 are not grey levels"),
        (np.full((32, 32), np.nan), "holds pixels that are not finite numbers"),
    ],
)
def test_images_that_are_none_are_refused_in_one_sentence(image, message):
    with pytest.raises(sc.SonocalError) as refused:
        as_grey(image)
    assert message in str(refused.value)


def test_an_image_of_another_size_than_the_mask_is_refused():
    with pytest.raises(sc.InputError, match=r"is \(32, 32\) where the mask is \(120, 160\)"):
        detector().detect(np.zeros((32, 32), np.uint8))


def test_covariances_are_symmetric_and_positive():
    _, covariances, _ = detector().detect(grey(blob(60, 50), blob(110, 80, sigma=8)))
    np.testing.assert_array_equal(covariances, np.swapaxes(covariances, 1, 2))
    assert (np.linalg.eigvalsh(covariances) > 0).all()


def test_a_dim_echo_and_one_merged_with_its_tail_are_less_certain():
    def variance(image):
        return detector(image.shape).detect(image)[1][0, 1, 1]

    bright, dim = (variance(grey(blob(60, 50, sigma=6, height=height))) for height in (200, 80))
    assert dim > 1.5 * bright
    assert variance(merged_with_its_tail(0.0)) > 4 * variance(merged_with_its_tail(0.0, sigma=2.0))


def recording_of(images):
    return Recording(
        times=np.arange(len(images)) / 20,
        frames=ArrayFrames(images),
        image=ImageGeometry(images.shape[:0:-1], 1, "uint8", "MF", np.eye(4)),
    )


def test_text_and_rulers_are_masked_and_the_needle_is_not():
    rng = np.random.default_rng(0)
    images = np.stack(
        [grey(blob(40 + 8 * i, 60), rng.normal(scale=8, size=SHAPE), floor=60) for i in range(9)]
    )
    images[:, 5:12, 120:150:3] = 230
    mask = find_mask(images)
    assert not mask[5:12, 120:150:3].any()
    assert mask[40:, :].all()
    found = detect(recording_of(images))
    best = found.points_px[found.rank == 0, 0]
    np.testing.assert_allclose(best, [[40 + 8 * i, 60] for i in range(9)], atol=1.5)


def test_a_notch_in_the_fan_is_looked_into_and_its_corners_stay_masked():
    rows, cols = np.mgrid[:200, :240]
    fan = (np.abs(cols - 120) < 20 + 0.5 * rows) & (rows > 10)
    notched = fan & ~((np.abs(rows - 120) < 5) & (cols < 70))
    speckle = np.random.default_rng(0).integers(40, 90, size=(5, *fan.shape))
    mask = find_mask((speckle * notched).astype(np.uint8))
    assert mask[120, 50]
    assert not mask[~fan].any()
    assert mask[fan].mean() > 0.9


def test_a_recording_that_stands_still_is_not_masked_away():
    assert find_mask(np.stack([grey(blob(60, 50), floor=60)] * 5)).mean() > 0.9


def test_detection_streams_and_says_how_far_it_is():
    images = np.stack([grey(blob(60, 50))] * 4)
    steps = []
    found = detect(recording_of(images), progress=lambda done, total: steps.append((done, total)))
    assert steps == [(1, 4), (2, 4), (3, 4), (4, 4)]
    assert found.images == 4
    assert found.frame.tolist() == sorted(found.frame.tolist())


def test_wires_of_real_images_are_found_where_plus_found_them(data_folder):
    recording = read_recording(data_folder / "recordings" / "fCal_Test_Calibration_3NWires.igs.mha")
    rows = sc.read_observations(data_folder / "observations" / "fcal12_ascension.csv").select_split(
        "calibration"
    )
    found = detect(recording, DetectionOptions(count=15, centre="mass"))
    distance = np.array(
        [
            np.linalg.norm(found.points_px[found.frame == frame, 0] - point, axis=1).min()
            for frame, point in zip(rows.frame, rows.points_px, strict=True)
        ]
    )
    assert (distance <= 2).mean() >= 0.95
    assert np.median(distance) <= 0.7


def test_letters_that_flicker_are_masked_and_wires_that_stand_still_in_noise_are_not():
    rng = np.random.default_rng(1)
    letters, wire = np.zeros(SHAPE), blob(60, 60)
    letters[5:19, 100:150] = np.kron(rng.random((7, 25)) < 0.5, np.ones((2, 2))) * 200
    below = np.arange(SHAPE[0])[:, None] >= 30  # a grabber's letters stand beside the echoes
    images = [
        np.maximum(letters * (1 + rng.normal(scale=0.03)), (wire + rng.normal(40, 4, SHAPE)) * below)
        for _ in range(24)
    ]
    mask = find_mask(np.clip(images, 0, 255).astype(np.uint8))
    assert not mask[7:17, 102:148].any()
    assert mask[40:, :].all()
