"""A table of one needle that was seen twice says so; others do not."""

import dataclasses

import numpy as np
import pytest
from benchmarks.simulators.scans import SCALE, scan

import sonocal as sc


def rows_of(seed, dimension, share, away_mm):
    """A scan in which a share of the frames shows the twin, away along u and v."""
    rows = scan(seed, dimension=dimension).observations
    shown = np.random.default_rng(seed).random(rows.frame.max() + 1) < share
    points = rows.points_px + shown[rows.frame][:, None] * np.resize([*away_mm, 0.0], dimension) / SCALE
    return dataclasses.replace(rows, points_px=points)


def said(rows):
    return [one.message for one in sc.calibrate(rows).warnings if one.code == "second-needle"]


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize(("away_mm", "where"), [((0.0, 11.0), "deeper"), ((11.0, 0.0), "to the right of")])
def test_rows_left_out_that_lie_one_shift_away_are_a_second_needle(away_mm, where, dimension):
    found = [said(rows_of(seed, dimension, 0.25, away_mm)) for seed in range(10)]
    assert all(len(messages) == 1 for messages in found)
    assert sum(f"mm {where}" in messages[0] for messages in found) >= 9


@pytest.mark.parametrize("away_mm", [3.0, 4.0, 6.0, 8.0])
def test_a_twin_at_any_distance_is_found(away_mm):
    assert sum(len(said(rows_of(seed, 2, 0.3, (0.0, away_mm)))) for seed in range(10)) >= 8


@pytest.mark.parametrize("dimension", [2, 3])
def test_rows_used_that_one_shift_parts_in_two_are_a_second_needle(dimension):
    assert sum(len(said(rows_of(seed, dimension, 0.4, (0.0, 4.0)))) for seed in range(10)) >= 9


@pytest.mark.parametrize("dimension", [2, 3])
def test_one_needle_and_a_marker_that_slips_are_no_second_needle(dimension):
    slipped = {"slip": (np.array([0.0, 0.03, 0.0]), np.array([10.0, 0.0, 0.0]))}
    for wrong in ({}, slipped, {"latency_s": 0.1}):
        named = [said(scan(seed, dimension=dimension, **wrong).observations) for seed in range(8)]
        assert sum(map(bool, named)) <= 1


def test_one_of_several_wires_is_not_asked():
    rows = rows_of(0, 2, 0.25, (0.0, 11.0))
    assert said(rows)
    assert not said(dataclasses.replace(rows, target=(rows.frame % 2).astype(str)))
