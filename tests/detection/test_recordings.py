"""A whole recording in one call: images and volumes through the same code."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sonocal import InputError
from sonocal.detection import DetectionOptions, PointDetector, detect, detect_lines
from sonocal.detection.recordings import LINES, POINTS, detector_of
from sonocal.recording import Recording
from tests.builders.sweeps import SHAPE, recording_of_images, scan_of, spots, tubes

PLACES = [[(30.0, 40.0), (80.0, 60.0)], [(60.0, 30.0)], [], [(50.0, 70.0), (90.0, 30.0), (20.0, 60.0)]]
SEGMENTS = [((6.0, 12, 8), (34, 26, 30)), ((30.0, 6, 20), (8, 30, 14)), ((20.0, 20, 4), (18, 22, 36))]
EVERYWHERE = np.ones(SHAPE, dtype=bool)
LOOK = {2: DetectionOptions(mask=EVERYWHERE, centre="mass"), 3: None}


@pytest.fixture(scope="module")
def images():
    return spots(PLACES)


@pytest.fixture(scope="module")
def volumes():
    return tubes(SEGMENTS)


@pytest.fixture(scope="module", params=[2, 3])
def recording(request, images, volumes):
    return recording_of_images(images if request.param == 2 else volumes, request.param)


def of_recording(recording):
    return detect(recording, LOOK[recording.image.dimension])


COLUMNS = ("points_px", "covariance_px2", "score", "rank")


def assert_same(found, expected):
    for name in ("frame", *COLUMNS):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


def test_a_recording_is_its_images_one_after_the_other(images, volumes):
    flat, deep = recording_of_images(images), recording_of_images(volumes, 3)
    found, detector = of_recording(flat), PointDetector(EVERYWHERE, POINTS, centre="mass")
    for i, image in enumerate(images):
        points, covariances, scores = detector.detect(image)
        here = found.select(found.frame == i)
        np.testing.assert_array_equal(here.points_px[:, 0], points)
        np.testing.assert_array_equal(here.covariance_px2[:, 0], covariances)
        np.testing.assert_array_equal(here.score, scores)
    found = of_recording(deep)
    for i, volume in enumerate(volumes):
        here, lines = found.select(found.frame == i), detect_lines(volume, LINES)
        assert len(here) == len(lines) > 0
        for line, ends, score in zip(lines, here.points_px, here.score, strict=True):
            np.testing.assert_array_equal(ends, line.ends_px)
            assert score == line.score


def test_what_is_bright_is_found_best_first(images, volumes):
    found = of_recording(recording_of_images(images))
    for i, places in enumerate(PLACES):
        here = found.points_px[found.frame == i, 0]
        assert len(here) >= len(places)
        np.testing.assert_allclose(here[: len(places)], np.reshape(places, (-1, 2)), atol=0.5)
    found = of_recording(recording_of_images(volumes, 3))
    for i, (first, second) in enumerate(np.array(SEGMENTS, dtype=float)):
        along = (second - first) / np.linalg.norm(second - first)
        off = np.cross(found.points_px[(found.frame == i) & (found.rank == 0)][0] - first, along)
        assert np.linalg.norm(off, axis=1).max() < 0.5


def test_images_in_another_order_give_the_same_in_that_order(recording):
    found, order = of_recording(recording), np.random.default_rng(0).permutation(len(recording))
    other = of_recording(recording.select(order))
    for new, old in enumerate(order):
        here, there = other.select(other.frame == new), found.select(found.frame == old)
        for name in COLUMNS:
            np.testing.assert_array_equal(getattr(here, name), getattr(there, name))


def test_images_marked_invalid_are_not_decoded_into_detections(recording):
    valid = np.arange(len(recording)) != 1
    part = of_recording(replace(recording, image_valid=valid))
    whole = of_recording(recording)
    assert_same(part, whole.select(whole.frame != 1))
    assert part.images == len(recording) - 1
    assert whole.images == len(recording)


def test_progress_is_told_of_every_image(recording):
    steps = []
    detect(recording, LOOK[recording.image.dimension], lambda done, total: steps.append((done, total)))
    assert steps == [(i + 1, len(recording)) for i in range(len(recording))]


@pytest.mark.parametrize("count", [1, 2, 4])
def test_fewer_an_image_are_the_best_of_more(recording, count):
    options = replace(LOOK[recording.image.dimension] or DetectionOptions(), count=count)
    fewer, more = detect(recording, options), detect(recording, replace(options, count=6))
    # In a volume lines are taken one after the other and sorted at the end: the strongest may come later.
    if recording.image.dimension == 2:
        assert_same(fewer, more.select(more.rank < count))
    assert np.bincount(fewer.frame).max() <= count


@given(st.integers(-15, 15), st.integers(-15, 15), st.integers(0, 50))
@settings(max_examples=15)
def test_a_shifted_image_has_its_spots_shifted(du, dv, seed):
    place = np.array([[60.0, 50.0]])
    options = DetectionOptions(count=1, mask=EVERYWHERE)
    (image,) = spots([place], noise=0, seed=seed)
    shifted = np.roll(image, (dv, du), axis=(0, 1))
    found = detect(recording_of_images(np.stack([image, shifted])), options)
    np.testing.assert_allclose(found.points_px[1] - found.points_px[0], [[du, dv]], atol=1e-3)
    np.testing.assert_allclose(found.covariance_px2[1], found.covariance_px2[0], rtol=1e-3)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_mirrored_image_has_its_spots_mirrored(images, axis):
    """All of what is bright; the first echo has its tail on one side."""
    found = of_recording(recording_of_images(images))
    other = of_recording(recording_of_images(np.flip(images, axis=1 + axis)))
    strong = found.score > 10
    assert strong.sum() == sum(map(len, PLACES))
    mirrored = found.points_px.copy()
    mirrored[:, :, 1 - axis] = SHAPE[axis] - 1 - mirrored[:, :, 1 - axis]
    np.testing.assert_array_equal(other.frame[other.score > 10], found.frame[strong])
    np.testing.assert_allclose(other.points_px[other.score > 10], mirrored[strong], atol=0.05)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_mirrored_volume_has_its_line_mirrored(volumes, axis):
    once = DetectionOptions(count=1)
    found, other = (
        detect(recording_of_images(v, 3), once) for v in (volumes, np.flip(volumes, axis=1 + axis))
    )
    back = other.points_px.copy()
    back[:, :, 2 - axis] = volumes.shape[1] - 1 - back[:, :, 2 - axis]
    for ends, (first, second) in zip(back, found.points_px, strict=True):
        along = (second - first) / np.linalg.norm(second - first)
        assert np.linalg.norm(np.cross(ends - first, along), axis=1).max() < 0.1


def test_a_second_look_finds_what_stands_near_a_needle_and_nothing_else(images, volumes):
    flat = detector_of(recording_of_images(images), LOOK[2])
    across = np.array([[80.0, 60.0, -50.0], [80.0, 60.0, 50.0]])  # through the second spot of the first image
    near = flat.near(0, across, 4.0)
    assert near.shape[1:] == (1, 2)
    assert (np.linalg.norm(near - [80, 60], axis=-1) <= 4).all()
    assert np.linalg.norm(near - [80, 60], axis=-1).min() < 0.5
    assert len(flat.near(1, across, 4.0)) == 0
    beside = across + np.array([200.0, 0, 0])
    alongside = np.array([[0.0, 3.0, 1.0], [9.0, 3.0, 1.0]])
    assert len(flat.near(0, beside, 4.0)) == len(flat.near(0, alongside, 4.0)) == 0
    deep = detector_of(recording_of_images(volumes, 3))
    (line,) = deep.near(0, np.array(SEGMENTS[0]) + np.array([1.0, 0, 0]), 4.0)
    assert line.shape == (2, 3)
    assert len(deep.near(0, np.array([[-9.0, 1, 1], [-9.0, 1, 2]]), 4.0)) == 0


def test_the_mask_is_found_only_where_it_is_needed():
    """A detector of closed images can be made; looking with it opens them."""
    detector = detector_of(scan_of().recording)
    with pytest.raises(AssertionError, match="was decoded"):
        detector.detect()
    given_mask = detector_of(scan_of().recording, DetectionOptions(mask=np.ones((500, 500), dtype=bool)))
    assert given_mask.mask.all()


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"count": 0}, "count must be a whole number of candidates, 1 or more; got 0"),
        ({"count": True}, "count must be a whole number of candidates, 1 or more; got True"),
        ({"count": 2.5}, "count must be a whole number of candidates, 1 or more; got 2.5"),
        ({"centre": "tail"}, "centre must be one of head, mass; got 'tail'"),
        ({"mask": np.zeros((3, 3), dtype=bool)}, "the mask hides the whole image; give another one"),
        (
            {"mask": np.ones((3, 3))},
            "mask must be an array (rows, columns) of booleans, True where to look; got float64 of shape (3, 3)",
        ),
        (
            {"mask": "mask.png"},
            "mask must be an array (rows, columns) of booleans, True where to look; got 'mask.png'",
        ),
    ],
)
def test_options_that_mean_nothing_are_refused(options, sentence):
    with pytest.raises(InputError) as caught:
        DetectionOptions(**options)
    assert str(caught.value) == sentence


def test_numpy_s_whole_numbers_are_counts(images):
    assert_same(
        detect(recording_of_images(images), DetectionOptions(np.int32(2), EVERYWHERE)),
        detect(recording_of_images(images), DetectionOptions(2, EVERYWHERE)),
    )


@pytest.mark.parametrize(("name", "value"), [("mask", np.ones((8, 8), dtype=bool)), ("centre", "mass")])
def test_what_is_for_images_is_refused_for_volumes(name, value):
    with pytest.raises(InputError, match=f"lines in volumes are found without {name}, leave it out"):
        detect(scan_of(3).recording, DetectionOptions(**{name: value}))


def test_where_there_are_no_images_nothing_is_looked_for():
    alone = Recording(times=np.arange(3.0))
    with pytest.raises(InputError) as caught:
        detect(alone)
    assert str(caught.value) == ("recording: has no images to look for a needle in; record images too")


def test_a_mask_of_another_size_is_refused(images):
    with pytest.raises(InputError, match=r"frame 0: is \(100, 120\) where the mask is \(8, 8\)"):
        detect(recording_of_images(images), DetectionOptions(mask=np.ones((8, 8), dtype=bool)))


def test_black_images_hold_nothing():
    found = detect(recording_of_images(np.zeros((4, *SHAPE), np.uint8)))
    assert (len(found), found.images) == (0, 4)
    found = detect(recording_of_images(np.zeros((2, 32, 32, 32), np.uint8), 3))
    assert (len(found), found.images, found.points_px.shape) == (0, 2, (0, 2, 3))
