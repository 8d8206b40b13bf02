"""Labels of dots: found where they can be, ambiguous where wires look alike, refused where nothing is right."""

import numpy as np
import pytest
from benchmarks.simulators import phantoms

from sonocal import registration as reg
from sonocal.errors import InputError
from sonocal.registration.wire_symmetry import near_isometries


def scan_of(seed, make, frames=20, **options):
    rng = np.random.default_rng(seed)
    return rng, phantoms.scan(rng, make(rng), frames, **options)


def found_in(dots, **options):
    return reg.associate(dots.points, dots.wires, frame=dots.frame, time_limit_s=60.0, **options)


@pytest.mark.parametrize("kind", list(phantoms.KINDS))
def test_labels_of_every_kind_of_phantom_are_found_among_false_dots(kind):
    rng, dots = scan_of(3, phantoms.KINDS[kind])
    dots = phantoms.spoilt(rng, dots, 0.2, 0.3)
    found = found_in(dots)
    assert found.verdict == "found", found.reason
    given = (found.labels >= 0) & (dots.truth >= 0)
    assert np.count_nonzero(found.labels[given] != dots.truth[given]) <= 0.02 * given.sum()
    # Where two of many wires cross within the noise a label is left out.
    assert np.count_nonzero(given) >= 0.8 * np.count_nonzero(dots.truth >= 0)


def test_residuals_and_similarity_belong_to_the_labels():
    _, dots = scan_of(1, lambda rng: phantoms.random_wires(rng, 6))
    found = found_in(dots)
    mapped = found.target_from_source @ np.column_stack([dots.points, np.zeros(len(dots.points))])
    ends = dots.wires[dots.frame, found.labels]
    along = ends[:, 1] - ends[:, 0]
    away = np.cross(mapped - ends[:, 0], along / np.linalg.norm(along, axis=1, keepdims=True))
    given = found.labels >= 0
    np.testing.assert_allclose(np.linalg.norm(away, axis=1)[given], found.residuals_mm[given], atol=1e-9)
    assert np.isnan(found.residuals_mm[~given]).all()


def test_the_order_of_dots_and_the_frame_of_the_target_change_nothing():
    rng, dots = scan_of(2, lambda rng: phantoms.random_wires(rng, 7))
    order = rng.permutation(len(dots.points))
    first = found_in(dots)
    again = reg.associate(dots.points[order], dots.wires + 100.0, frame=dots.frame[order], time_limit_s=60.0)
    assert first.verdict == again.verdict == "found"
    np.testing.assert_array_equal(first.labels[order], again.labels)


def test_the_same_seed_gives_the_same_answer():
    _, dots = scan_of(4, lambda rng: phantoms.random_wires(rng, 5))
    one, other = found_in(dots, seed=7), found_in(dots, seed=7)
    assert (one.hypotheses, one.finds, one.score) == (other.hypotheses, other.finds, other.score)
    np.testing.assert_array_equal(one.labels, other.labels)


def test_one_frame_is_searched_until_its_answer_was_found_twenty_times():
    _, dots = scan_of(5, lambda rng: phantoms.random_wires(rng, 9), frames=1)
    found = reg.associate(dots.points, dots.wires[0], time_limit_s=60.0)
    assert found.verdict == "unfinished" or found.finds >= 20


def test_a_hexagon_scanned_along_its_wires_is_ambiguous_and_the_symmetry_is_named():
    _, dots = scan_of(6, phantoms.symmetric, turn_rad=0.002, shift_mm=(0.3, 0.3, 20.0))
    found = found_in(dots)
    assert found.verdict == "ambiguous"
    assert any("turn by" in one.name or "mirror" in one.name for one in found.rivals)
    assert "turn the image" in found.reason
    assert found.second is not None and found.second.share_of_labels > 0.5
    assert found.second.behind_nats < 25


def test_frames_whose_poses_are_off_by_more_than_their_dots_are_weighed_by_what_is_left():
    rng, dots = scan_of(11, lambda rng: phantoms.n_wires(3, 10.0), sigma_mm=1.2)
    dots = phantoms.spoilt(rng, dots, 0.5, 1.0)
    found = found_in(dots)
    assert found.verdict == "found", found.reason
    given = (found.labels >= 0) & (dots.truth >= 0)
    np.testing.assert_array_equal(found.labels[given], dots.truth[given])
    assert found.second is None or found.second.behind_nats > 25


def test_motions_of_a_hexagon_onto_itself():
    wires = phantoms.symmetric(np.random.default_rng(0))
    names = [name for name, _ in near_isometries(wires)]
    assert {"a turn by 60 degrees", "a turn by 180 degrees", "a mirror"} <= set(names)
    for _, motion in near_isometries(wires):
        np.testing.assert_allclose(motion[:3, :3] @ motion[:3, :3].T, np.eye(3), atol=1e-9)
    assert near_isometries(phantoms.random_wires(np.random.default_rng(3), 7)) == []


def test_shuffled_poses_and_noise_are_no_answers():
    rng, dots = scan_of(8, lambda rng: phantoms.random_wires(rng, 6))
    shuffled = phantoms.Dots(dots.points, dots.frame, dots.truth, dots.wires[rng.permutation(20)])
    assert found_in(shuffled, max_hypotheses=100_000).verdict != "found"
    low, high = dots.points.min(axis=0), dots.points.max(axis=0)
    noise = phantoms.Dots(rng.uniform(low, high, dots.points.shape), dots.frame, dots.truth, dots.wires)
    assert found_in(noise, max_hypotheses=100_000).verdict == "nothing fits"


@pytest.mark.parametrize("seed", range(4))
def test_of_a_phantom_whose_wires_are_elsewhere_no_labels_are_found(seed):
    rng, dots = scan_of(seed, lambda rng: phantoms.random_wires(rng, 9))
    moved = rng.normal(size=(9, 1, 3))
    moved *= 6.0 / np.linalg.norm(moved, axis=2, keepdims=True)
    elsewhere = phantoms.Dots(dots.points, dots.frame, dots.truth, dots.wires + moved)
    assert found_in(elsewhere, max_hypotheses=100_000).verdict != "found"


def test_wires_that_are_not_in_view_are_to_be_left_out():
    _, dots = scan_of(3, lambda rng: phantoms.random_wires(rng, 9))
    few = dots.truth < 4
    seen = phantoms.Dots(dots.points[few], dots.frame[few], dots.truth[few], dots.wires)
    found = found_in(seen)
    assert found.verdict == "nothing fits"
    assert "5 of 9 lines are hardly met" in found.reason
    alone = phantoms.Dots(dots.points[few], dots.frame[few], dots.truth[few], dots.wires[:, :4])
    assert found_in(alone).verdict == "found"


def test_a_search_that_ends_too_early_is_unfinished():
    _, dots = scan_of(9, lambda rng: phantoms.random_wires(rng, 12))
    dots = phantoms.spoilt(np.random.default_rng(0), dots, 0.3, 1.0)
    assert found_in(dots, max_hypotheses=256).verdict in ("unfinished", "nothing fits")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"points": np.zeros((3, 3))}, "points must be"),
        ({"points": np.full((3, 2), np.nan)}, "points holds"),
        ({"lines": np.zeros((2, 3))}, "lines must be"),
        ({"lines": np.ones((2, 2, 3))}, "two points are one"),
        ({"lines": np.random.default_rng(0).normal(size=(1, 2, 3))}, "one line needs no labels"),
        ({"frame": [0, 0, 5]}, "frame must be between 0 and 0"),
        ({"frame": [0.0, 0.0, 0.0]}, "frame must be 3 whole numbers"),
        ({"threshold_mm": -1.0}, "threshold_mm"),
        ({"max_hypotheses": 0}, "max_hypotheses"),
    ],
)
def test_bad_input_is_refused_in_a_sentence(change, said):
    given = {"points": np.zeros((3, 2)), "lines": np.random.default_rng(0).normal(size=(3, 2, 3))} | change
    with pytest.raises(InputError, match=said):
        reg.associate(given.pop("points"), given.pop("lines"), **given)


def test_dots_in_one_place_fit_nothing():
    found = reg.associate(
        np.ones((6, 2)), np.random.default_rng(0).normal(size=(3, 2, 3)), max_hypotheses=1000
    )
    assert found.verdict == "nothing fits" and found.target_from_source is None
    empty = reg.associate(np.empty((0, 2)), np.random.default_rng(0).normal(size=(3, 2, 3)))
    assert empty.verdict == "nothing fits" and "<Association" in repr(empty)
