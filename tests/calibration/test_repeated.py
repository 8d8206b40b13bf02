"""Copies count once, however they are shuffled and rounded; what rests, or comes back as hands do, is no copy."""

import dataclasses

import numpy as np
import pytest
from benchmarks.simulators.scans import scan
from hypothesis import given, settings
from hypothesis import strategies as st

import sonocal as sc
from sonocal.simulation.scene import simulate_observations

CODE = "repeated-rows"
SEEDS = st.integers(0, 2**16)


def pasted(rows, times, jitter, seed):
    """The rows so many times in any order of frames, each time with other last digits."""
    rng = np.random.default_rng(seed)
    frames = np.unique(rows.frame)
    order = rng.permutation(times * len(frames))
    parts = []
    for part in range(times):
        number = order[part * len(frames) + np.searchsorted(frames, rows.frame)]
        _, first = np.unique(rows.frame, return_index=True)
        moved = rng.normal(0, 0.2 * jitter, (len(first), 2, 3))[np.searchsorted(frames, rows.frame)]
        points = rows.points_px + rng.normal(0, jitter, rows.points_px.shape)
        parts.append((points, rows.segments_mm + moved, number))
    points, segments, frame = (np.concatenate(column) for column in zip(*parts, strict=True))
    by_frame = np.argsort(frame, kind="stable")
    size = rows.image_size_px
    return sc.Observations(points[by_frame], segments[by_frame], frame=frame[by_frame], image_size_px=size)


@pytest.mark.parametrize("dimension", [2, 3])
@given(SEEDS, st.integers(2, 12), st.sampled_from([0.0, 1e-6, 0.1]))
@settings(max_examples=6, deadline=None)
def test_pasted_scans_are_one_scan(dimension, seed, times, jitter):
    rows = simulate_observations(dimension, 20, seed=seed).observations
    table = pasted(rows, times, jitter, seed)
    once, again = sc.calibrate(rows), sc.calibrate(table)
    said = [one.message for one in again.warnings if one.code == CODE]
    count = len(np.unique(rows.frame))
    assert [one.split(" that")[0] for one in said] == [
        f"rows repeat one another: {times * count} sightings are {count}"
    ]
    assert again.warnings[0].code == CODE
    assert len(again.inlier) == len(again.residuals_mm) == again.fit.observations == len(table)
    assert again.noise.freedom <= once.noise.freedom + 2
    ratio = again.predicted_errors()[2].max() / once.predicted_errors()[2].max()
    assert 0.5 < ratio < 2.0


@pytest.mark.parametrize("slowly", [0.02, 1.0])
@pytest.mark.parametrize("rounded", [0.0, 1.0])
@pytest.mark.parametrize("seed", range(2))
def test_scans_as_hands_make_them_hold_no_copies(slowly, rounded, seed):
    rows = simulate_observations(2, 40, seed=seed).observations
    rng = np.random.default_rng(seed)
    # Between the places of forty sightings the needle moves in so many steps, each with noise of its own.
    steps = 10
    at = np.linspace(0, 39 * slowly, 400 if slowly < 1 else 39 * steps)
    before, share = at.astype(int), at % 1.0
    after = np.minimum(before + 1, 39)
    points = (1 - share[:, None]) * rows.points_px[before] + share[:, None] * rows.points_px[after]
    points = points + rng.normal(0, 1.0, points.shape)
    points = np.round(points / rounded) * rounded if rounded else points
    truth = sc.calibrate(rows).probe_from_image
    along = rng.normal(size=3) * [0.2, 0.2, 1.0] + [0, 0, 1.0]
    turned = along + 0.6 * np.column_stack([np.sin(at), np.cos(0.7 * at), 0 * at])
    turned = turned @ truth.rotation.T
    through = truth @ np.column_stack([points, np.zeros(len(points))])
    through = through + rng.normal(0, 0.3, through.shape)
    segments = np.stack([through - 60 * turned, through + 60 * turned], axis=1)
    try:
        found = sc.calibrate(sc.Observations(points, segments))
    except sc.DegenerateGeometryError:
        return
    assert CODE not in {one.code for one in found.diagnostics}


def test_sound_sweeps_hold_no_copies():
    for seed in range(4):
        rows = scan(seed).observations
        assert CODE not in {one.code for one in sc.calibrate(rows).diagnostics}
        half = dataclasses.replace(rows, points_px=np.round(rows.points_px))
        assert CODE not in {one.code for one in sc.calibrate(half).diagnostics}
