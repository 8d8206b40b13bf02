"""Lines of volumes on wires that nobody names, and needles that move one without the other."""

import re

import numpy as np
import pytest
from benchmarks.simulators import phantoms
from scipy.spatial.transform import Rotation

from sonocal import registration as reg
from sonocal.errors import InputError

KINDS = ["3 random wires", "9 random wires", "three N, 5 mm apart", "one N", "parallel planes"]


def found_in(dots, **options):
    return reg.associate(dots.points, dots.wires, frame=dots.frame, **{"time_limit_s": 60.0} | options)


def right(found, dots, least=0.9):
    assert found.verdict == "found", found.reason
    given = (found.labels >= 0) & (dots.truth >= 0)
    assert np.count_nonzero(found.labels[given] != dots.truth[given]) <= 0.02 * given.sum()
    assert given.sum() >= least * np.count_nonzero(dots.truth >= 0)
    return found


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("frames", [5, 20])
def test_lines_of_volumes_are_labelled_among_false_ones(kind, frames):
    rng = np.random.default_rng(3)
    dots = phantoms.scan_volumes(rng, phantoms.KINDS[kind](rng), frames)
    dots = phantoms.spoilt(rng, dots, 0.2, 0.5)
    right(found_in(dots), dots)


@pytest.mark.parametrize("volumes", [False, True])
@pytest.mark.parametrize(("count", "wires"), [(2, 0), (3, 0), (1, 6)])
def test_needles_that_move_apart_are_labelled_and_one_among_wires(volumes, count, wires):
    rng = np.random.default_rng(7)
    beside = phantoms.random_wires(rng, wires) if wires else None
    dots = phantoms.spoilt(
        rng, phantoms.scan_needles(rng, count, 20, volumes=volumes, wires=beside), 0.1, 0.5
    )
    right(found_in(dots), dots, 0.85)


def test_the_similarity_of_volumes_takes_lines_onto_wires_to_their_residuals():
    rng = np.random.default_rng(1)
    dots = phantoms.scan_volumes(rng, phantoms.random_wires(rng, 6), 6)
    found = right(found_in(dots), dots)
    mapped = (found.target_from_source @ dots.points.reshape(-1, 3)).reshape(-1, 2, 3)
    given = found.labels >= 0
    ends = dots.wires[dots.frame[given], found.labels[given]]
    along = ends[:, 1] - ends[:, 0]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    away = np.linalg.norm(np.cross(mapped[given] - ends[:, :1], along[:, None]), axis=-1)
    np.testing.assert_allclose(np.sqrt(np.mean(away**2, axis=1)), found.residuals_mm[given], atol=1e-9)
    assert np.isnan(found.residuals_mm[~given]).all()


def test_order_ends_and_frames_of_lines_change_no_label():
    rng = np.random.default_rng(2)
    dots = phantoms.scan_volumes(rng, phantoms.random_wires(rng, 7), 8)
    first = right(found_in(dots), dots)
    order, turn = rng.permutation(len(dots.points)), Rotation.random(random_state=0).as_matrix()
    flipped = np.where(rng.random(len(order))[:, None, None] < 0.5, dots.points, dots.points[:, ::-1])
    moved = phantoms.Dots(
        flipped[order] @ turn.T * 3 - 50, dots.frame[order], dots.truth[order], dots.wires @ turn.T + 100.0
    )
    again = right(found_in(moved), moved)
    np.testing.assert_array_equal(first.labels[order], again.labels)
    same = found_in(dots)
    np.testing.assert_array_equal(first.labels, same.labels)
    assert (first.hypotheses, first.score) == (same.hypotheses, same.score)


def test_a_hexagon_that_is_scanned_along_its_wires_is_no_answer_in_volumes_either():
    rng = np.random.default_rng(6)
    dots = phantoms.scan_volumes(rng, phantoms.symmetric(rng), 20, turn_rad=0.002, shift_mm=(0.3, 0.3, 20.0))
    found = found_in(dots, max_hypotheses=50_000)
    assert found.verdict != "found", found.reason


def test_two_needles_held_together_are_ambiguous():
    """Side by side in one holder: which is which no image tells, while it moves along and across them alone."""
    rng = np.random.default_rng(4)
    pair = phantoms._ends(np.array([[-6.0, 0.0], [6.0, 0.0]]), np.array([[-6.0, 0.0], [6.0, 0.0]]))
    for scan in (phantoms.scan, phantoms.scan_volumes):
        dots = scan(rng, pair, 20, turn_rad=0.002, shift_mm=(0.3, 0.3, 20.0))
        found = found_in(dots, max_hypotheses=50_000)
        assert found.verdict != "found", found.reason


@pytest.mark.parametrize(("seed", "fault"), list(enumerate(["shuffled poses", "other wires", "noise"])))
def test_shuffled_poses_other_wires_and_noise_are_no_answers_in_volumes(seed, fault):
    rng = np.random.default_rng(seed)
    dots = phantoms.scan_volumes(rng, phantoms.random_wires(rng, 6), 12)
    low, high = dots.points.min(axis=(0, 1)), dots.points.max(axis=(0, 1))
    away = rng.normal(size=(6, 1, 3))
    away *= 6.0 / np.linalg.norm(away, axis=2, keepdims=True)
    points, wires = {
        "shuffled poses": (dots.points, dots.wires[np.roll(np.arange(12), 5)]),
        "other wires": (dots.points, dots.wires + away),
        "noise": (rng.uniform(low, high, dots.points.shape), dots.wires),
    }[fault]
    found = reg.associate(points, wires, frame=dots.frame, max_hypotheses=6_000, time_limit_s=60.0)
    assert found.verdict != "found", found.reason


@pytest.mark.parametrize(
    ("points", "said"),
    [
        (np.zeros((3, 2, 2)), r"points must be \(N, 2\) px, or \(N, 2, 3\) px"),
        (np.zeros((3, 2, 3)), "two points are one"),
        (np.full((3, 2, 3), np.nan), "not finite"),
    ],
)
def test_bad_lines_are_refused_in_a_sentence(points, said):
    with pytest.raises(InputError, match=said):
        reg.associate(points, np.random.default_rng(0).normal(size=(3, 2, 3)))


def test_one_wire_needs_no_labels_and_few_lines_are_no_answer():
    lines = np.random.default_rng(0).normal(size=(4, 2, 3))
    with pytest.raises(InputError, match="its lines with line_line"):
        reg.associate(lines, lines[:1])
    for few in (lines[:0], lines[:1], lines[:2]):
        assert reg.associate(few, lines[:3], max_hypotheses=3000).verdict != "found"


def crossed_wires():
    """Three wires above and across three others: all alike when they are turned by half a turn."""
    upper = [[[x, 0.0, -20.0], [x, 0.0, 20.0]] for x in (-10.0, 0.0, 10.0)]
    lower = [[[-20.0, 9.0, z], [20.0, 9.0, z]] for z in (-12.0, 0.0, 12.0)]
    return np.array(upper + lower)


@pytest.mark.parametrize(("seed", "frames"), [(0, 1), (1, 20), (2, 1)])
def test_wires_that_are_alike_when_turned_are_ambiguous_and_named_where_volumes_stand_still(seed, frames):
    rng = np.random.default_rng(seed)
    dots = phantoms.scan_volumes(rng, crossed_wires(), frames, turn_rad=0.0005, shift_mm=(0.1, 0.1, 0.1))
    found = found_in(dots, max_hypotheses=50_000)
    assert found.verdict == "ambiguous"
    assert found.reason.startswith("a turn by 180 degrees fits as well")
    moved = phantoms.scan_volumes(rng, crossed_wires(), 20)
    right(found_in(moved), moved)


def test_lines_that_are_parallel_in_every_volume_are_said_to_be():
    rng = np.random.default_rng(6)
    dots = phantoms.scan_volumes(rng, phantoms.symmetric(rng), 20, turn_rad=0.002, shift_mm=(0.3, 0.3, 20.0))
    found = found_in(dots, max_hypotheses=5_000)
    assert found.verdict == "nothing fits"
    assert re.search(
        r"all lines are parallel to within \d\.\d degrees, in every volume.*turn the probe by", found.reason
    )
    turned = phantoms.scan_volumes(rng, phantoms.symmetric(rng), 20)
    right(found_in(turned), turned)
