"""The view that tells two answers apart: none where they are one, the same in every frame; images of it tell."""

import numpy as np
import pytest
from benchmarks.simulators import phantoms
from scipy.spatial.transform import Rotation

from sonocal import registration as reg
from sonocal.registration.label_table import LabelTable
from sonocal.registration.label_views import VIEWS, _crossings_px, _seen_from, telling_view


def ambiguous(seed):
    rng = np.random.default_rng(seed)
    dots = phantoms.scan(rng, phantoms.symmetric(rng), 12, turn_rad=0.002, shift_mm=(0.3, 0.3, 20.0))
    found = reg.associate(dots.points, dots.wires, frame=dots.frame, time_limit_s=60.0)
    assert found.verdict == "ambiguous", found.reason
    return dots, found, found.rivals[0]


def test_one_answer_and_itself_part_nowhere():
    dots, found, _ = ambiguous(0)
    table, own = LabelTable.of(dots.points, dots.wires, dots.frame), found.target_from_source.matrix
    assert telling_view(table, own, own) == ("", 0.0)
    empty = LabelTable.of(np.empty((0, 2)), dots.wires, np.empty(0, dtype=int))
    assert telling_view(empty, own, own) == ("", 0.0)


def test_the_frame_of_the_target_and_which_answer_comes_first_change_nothing():
    dots, found, rival = ambiguous(1)
    one, other = found.target_from_source.matrix, rival.target_from_source.matrix
    motion = np.eye(4)
    motion[:3, :3] = Rotation.from_rotvec([0.3, -1.0, 0.4]).as_matrix()
    motion[:3, 3] = [10.0, -40.0, 7.0]
    table = LabelTable.of(dots.points, dots.wires, dots.frame)
    moved = LabelTable.of(dots.points, dots.wires @ motion[:3, :3].T + motion[:3, 3], dots.frame)
    words, apart_mm = telling_view(table, one, other)
    for name, mm in (
        telling_view(moved, motion @ one, motion @ other),
        telling_view(table, other, one),
    ):
        assert name == words and mm == pytest.approx(apart_mm, rel=1e-6)
    assert (rival.view, rival.view_apart_mm) == (words, apart_mm)


@pytest.mark.parametrize("seed", range(3))
def test_images_from_the_view_that_is_named_exclude_the_rival(seed):
    dots, found, rival = ambiguous(seed)
    assert rival.view in VIEWS and rival.view_apart_mm > found.threshold_mm
    # Were the answer right, these images would show its dots.
    table, own = LabelTable.of(dots.points, dots.wires, dots.frame), found.target_from_source.matrix
    rng, new = np.random.default_rng(seed), range(12, 20)
    middle = dots.wires[6]
    wires = [_seen_from(table, own, middle, 1.0 - 0.05 * i, VIEWS[rival.view]) for i in range(len(new))]
    points = np.concatenate([_crossings_px(own, one) + rng.normal(0, 0.5, (6, 2)) for one in wires])
    again = reg.associate(
        np.concatenate([dots.points, points]),
        np.concatenate([dots.wires, wires]),
        frame=np.concatenate([dots.frame, np.repeat(list(new), 6)]),
        time_limit_s=60.0,
    )
    there = rival.target_from_source @ np.column_stack([dots.points, np.zeros(len(dots.points))])
    for one in again.rivals:
        other = one.target_from_source @ np.column_stack([dots.points, np.zeros(len(dots.points))])
        assert np.linalg.norm(other - there, axis=1).max() > found.threshold_mm
