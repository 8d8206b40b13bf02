"""One array of detections for points of images, points of volumes and lines of volumes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonocal import InputError
from sonocal.detection import Detections, read_detections

seeds = st.integers(0, 10_000)
KINDS = [(1, 2), (1, 3), (2, 3)]
kinds = st.sampled_from(KINDS)


def detections_of(kind, seed=0, count=30):
    """Detections in unordered frames, some of which have none."""
    rng = np.random.default_rng(seed)
    each, axes = kind
    factor = rng.normal(size=(count, each, axes, axes))
    return Detections(
        rng.integers(0, 12, count),
        rng.uniform(0, 500, (count, each, axes)),
        factor @ np.swapaxes(factor, -1, -2) + 0.01 * np.eye(axes),
        rng.uniform(1, 9, count),
        target=rng.choice(["", "a", "b"], count),
    )


COLUMNS = ("frame", "points_px", "covariance_px2", "score", "rank", "target", "sigma_px")


@given(seeds, kinds)
def test_selecting_twice_is_selecting_once(seed, kind):
    found, rng = detections_of(kind, seed), np.random.default_rng(seed)
    first = rng.permutation(len(found))[:20]
    second = rng.integers(0, 2, 20).astype(bool)
    twice, once = found.select(first).select(second), found.select(first[second])
    for name in COLUMNS:
        np.testing.assert_array_equal(getattr(twice, name), getattr(once, name))


@given(seeds, kinds)
def test_ranks_count_from_the_best_of_each_frame_and_stay_with_their_detection(seed, kind):
    found = detections_of(kind, seed)
    for frame, target in {*zip(found.frame.tolist(), found.target.tolist(), strict=True)}:
        mine = (found.frame == frame) & (found.target == target)
        assert found.rank[mine].tolist() == list(range(mine.sum()))
    order = np.random.default_rng(seed).permutation(len(found))
    np.testing.assert_array_equal(found.select(order).rank, found.rank[order])


@given(seeds, kinds)
def test_turning_the_image_s_axes_leaves_the_mean_deviation_alone(seed, kind):
    found, axes = detections_of(kind, seed), kind[1]
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(axes, axes)))[0]
    turned = Detections(found.frame, found.points_px @ turn.T, turn @ found.covariance_px2 @ turn.T)
    np.testing.assert_allclose(turned.sigma_px, found.sigma_px, rtol=1e-9)


@given(seeds, st.sampled_from([2, 3]), st.floats(1e-3, 1e3))
def test_a_deviation_along_every_axis_is_the_deviation(seed, axes, sigma):
    points = np.random.default_rng(seed).uniform(0, 500, (5, axes))
    found = Detections.of_points(np.arange(5), points, sigma_px=sigma)
    np.testing.assert_allclose(found.sigma_px, np.full((5, 1), sigma), rtol=1e-12)
    np.testing.assert_array_equal(found.points_px[:, 0], points)


def test_a_line_s_deviation_is_that_across_it():
    along = np.array([1.0, 2.0, 2.0]) / 3
    across = 0.09 * (np.eye(3) - np.outer(along, along))
    found = Detections([4], [[[0.0, 0, 0], 30 * along]], np.array([[across, 4 * across]]))
    np.testing.assert_allclose(found.sigma_px, [[0.3, 0.6]])


@given(seeds, st.sampled_from([2, 3]), st.booleans(), st.booleans())
def test_points_written_to_a_file_are_read_to_the_bit(tmp_path_factory, seed, axes, named, told):
    rng = np.random.default_rng(seed)
    points, frame = rng.normal(size=(9, axes)) * 10.0 ** rng.integers(-3, 4), rng.integers(0, 10**6, 9)
    columns = {"frame": frame.tolist()} | dict(zip(["u_px", "v_px", "w_px"], points.T.tolist(), strict=False))
    columns |= {"target": rng.choice(["a", "", "b c"], 9).tolist()} if named else {}
    columns |= {"sigma_px": rng.uniform(0.1, 2, 9).tolist()} if told else {}
    rows = [",".join(map(str, row)) for row in zip(*columns.values(), strict=True)]
    path = tmp_path_factory.mktemp("points") / "p.csv"
    path.write_text("\n".join([",".join(columns), *rows]))
    found = read_detections(path)
    np.testing.assert_array_equal(found.points_px[:, 0], points)
    np.testing.assert_array_equal(found.frame, frame)
    assert found.target.tolist() == columns.get("target", [""] * 9)
    assert (found.sigma_px is None) == (not told)
    if told:
        np.testing.assert_allclose(found.sigma_px[:, 0], columns["sigma_px"], rtol=1e-15)


@pytest.mark.parametrize("kind", KINDS)
def test_no_detection_at_all_is_sound(kind):
    each, axes = kind
    empty = Detections(np.empty(0, dtype=int), np.empty((0, each, axes)), np.empty((0, each, axes, axes)))
    assert (len(empty), empty.images, empty.dimension, empty.points_each) == (0, 0, axes, each)
    assert len(detections_of(kind).select([])) == 0
    assert empty.sigma_px.shape == (0, each)


POINT = [[[1.0, 2.0]]]
SPOILED = {
    "frames that are no whole numbers": (
        {"frame": [0.5], "points_px": POINT},
        "detections: frame must be whole numbers; got float64",
    ),
    "too few frames": (
        {"frame": [0], "points_px": [[[1.0, 2.0]], [[3.0, 4.0]]]},
        "detections: needs frames (N,) and points_px (N, points, axes); got (1,) and (2, 1, 2)",
    ),
    "points without their own axis": (
        {"frame": [0], "points_px": [[1.0, 2.0]]},
        "detections: needs frames (N,) and points_px (N, points, axes); got (1,) and (1, 2)",
    ),
    "a plane in an image": (
        {"frame": [0], "points_px": [[[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]]},
        "detections: a detection is one point, two points of a line, or in a volume three of a plane; "
        "got 3 points of 2 coordinates",
    ),
    "a place that is no number": (
        {"frame": [0, 1], "points_px": [[[1.0, 2.0]], [[1.0, np.nan]]]},
        "detections, row 1, column v_px: nan is not a finite number; leave out rows that were not seen",
    ),
    "a covariance of the wrong shape": (
        {"frame": [0], "points_px": POINT, "covariance_px2": [[[1.0, 1.0]]]},
        "detections: covariance_px2 must have shape (1, 1, 2, 2); got (1, 1, 2)",
    ),
    "a negative variance": (
        {"frame": [0], "points_px": POINT, "covariance_px2": [[[[-1.0, 0.0], [0.0, -1.0]]]]},
        "detections, row 0: its covariance is not positive; give variances, or none at all",
    ),
    "a copy": (
        {"frame": [3, 4, 3], "points_px": POINT * 3},
        "detections, row 2: repeats row 0 (frame 3, target '') value for value; delete one, "
        "a copy is not a second measurement",
    ),
    "scores for others": (
        {"frame": [0], "points_px": POINT, "score": [1.0, 2.0]},
        "detections: score must have shape (1,); got (2,)",
    ),
}


@pytest.mark.parametrize("spoiled", SPOILED)
def test_what_is_no_detection_is_refused_in_one_sentence(spoiled):
    columns, sentence = SPOILED[spoiled]
    arrays = {name: np.array(column) for name, column in columns.items()}
    with pytest.raises(InputError) as caught:
        Detections(**arrays)
    assert str(caught.value) == sentence


@pytest.mark.parametrize("sigma", [0.0, -0.5, np.nan, np.inf])
def test_a_deviation_that_is_none_is_refused(sigma):
    with pytest.raises(InputError, match=r"p\.csv, row 1, column sigma_px: .* is not a positive number"):
        Detections.of_points([0, 1], [[1, 2], [3, 4]], sigma_px=[0.5, sigma], source="p.csv")


def test_a_copy_for_another_line_or_frame_is_none():
    found = Detections.of_points([0, 0, 1], [[1, 2]] * 3, ["a", "b", "a"])
    assert len(found) == 3
