"""An offset that is constant in a third frame: against least squares by hand, and what may not change it."""

import numpy as np
import pytest
from benchmarks.simulators.trust_faults import offset_in_tracker, rng_of, unit_vector
from benchmarks.simulators.trust_judge import table
from benchmarks.simulators.trust_scans import sound
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from scipy.stats import kstest

import sonocal as sc
from sonocal.calibration import point_line_rows
from sonocal.registration.fixed_offset import FEWEST_FRAMES, STRETCHES, fixed_offset
from sonocal.registration.mapped import MappedRows
from sonocal.registration.uncertainty import point_jacobian

PARAMETERS = 7


def scene(scan):
    """The rows of a scan under their calibration, those that agree, and the turns of the tracker's frame."""
    rows = table(scan)
    found = sc.calibrate(rows)
    mapped = MappedRows(found.probe_from_image, point_line_rows(rows))
    return mapped, found.inlier, np.swapaxes(scan.tracker_from_probe[:, :3, :3], 1, 2)


def columns(mapped, chosen, rotations):
    """(M, 3, 10): by hand: the mapped point less the line, across the line, of which the offset is to be taken away."""
    across = np.eye(3) - np.einsum("ni,nj->nij", *[mapped.directions[chosen]] * 2)
    motion = point_jacobian(mapped.transform, mapped.table.points[chosen], PARAMETERS)
    return np.concatenate([across @ motion, across @ rotations[chosen]], axis=2)


@settings(max_examples=10)
@given(st.integers(0, 10**6), st.floats(0.0, 3.0))
def test_it_is_least_squares_with_the_motions_of_the_transform(seed, millimetres):
    mapped, chosen, rotations = scene(offset_in_tracker(seed, millimetres).scan)
    found = fixed_offset(mapped, chosen, rotations, PARAMETERS)
    design, residuals = (
        columns(mapped, chosen, rotations).reshape(-1, 10),
        mapped.residuals[chosen].reshape(-1),
    )
    size = np.linalg.norm(design, axis=0)
    # What a small motion and offset must take away.
    solved = np.linalg.lstsq(design / size, -residuals, rcond=None)[0] / size
    alone = np.linalg.lstsq(design[:, :7] / size[:7], -residuals, rcond=None)[0] / size[:7]
    np.testing.assert_allclose(found.offset_mm, solved[7:], atol=1e-6)
    np.testing.assert_allclose(found.moved * size[:7], (solved[:7] - alone) * size[:7], atol=1e-5)


def test_its_deviation_is_that_of_leaving_stretches_out():
    mapped, chosen, rotations = scene(offset_in_tracker(3, 1.0).scan)
    found = fixed_offset(mapped, chosen, rotations, PARAMETERS)
    design, residuals = columns(mapped, chosen, rotations), mapped.residuals[chosen]
    order = np.arange(len(design))
    stretch = order * STRETCHES // len(order)
    size = np.linalg.norm(design.reshape(-1, 10), axis=0)
    each = [
        np.linalg.lstsq(
            (design[stretch != s] / size).reshape(-1, 10), -residuals[stretch != s].reshape(-1), rcond=None
        )[0]
        / size
        for s in range(STRETCHES)
    ]
    away = np.array(each)[:, 7:] - np.mean(each, axis=0)[7:]
    variance = (STRETCHES - 1) / STRETCHES * np.sum(away**2)
    assert found.deviation_mm == pytest.approx(np.sqrt(variance), rel=1e-5)


@settings(max_examples=10)
@given(st.integers(0, 10**6))
def test_it_turns_with_the_tracker_and_moves_the_same(seed):
    mapped, chosen, rotations = scene(offset_in_tracker(1, 1.0).scan)
    turn = Rotation.random(random_state=seed).as_matrix()
    one = fixed_offset(mapped, chosen, rotations, PARAMETERS)
    other = fixed_offset(mapped, chosen, rotations @ turn.T, PARAMETERS)
    np.testing.assert_allclose(other.offset_mm, turn @ one.offset_mm, atol=1e-8)
    np.testing.assert_allclose(other.moved, one.moved, rtol=1e-6, atol=1e-10)
    assert other.p_value == pytest.approx(one.p_value, rel=1e-6)


def test_the_offset_put_in_is_found_within_its_uncertainty():
    off = []
    for seed in range(30):
        mapped, chosen, rotations = scene(offset_in_tracker(seed, 1.0).scan)
        found = fixed_offset(mapped, chosen, rotations, PARAMETERS)
        off.append(np.linalg.norm(found.offset_mm - unit_vector(rng_of(seed))) / found.deviation_mm)
    assert np.mean(np.array(off) < 2.5) > 0.85
    assert 0.4 < np.sqrt(np.mean(np.square(off))) < 1.8


def test_of_sound_scans_its_p_value_is_as_likely_to_be_anything():
    found = [fixed_offset(*scene(sound(seed, 100, still=True)), PARAMETERS).p_value for seed in range(100)]
    assert kstest(found, "uniform").pvalue > 1e-3


def test_a_tracker_that_hardly_turned_and_few_frames_tell_nothing():
    mapped, chosen, rotations = scene(sound(0, 100))
    still = np.broadcast_to(rotations[0], rotations.shape)
    assert fixed_offset(mapped, chosen, still, PARAMETERS) is None
    few = chosen & (np.arange(len(chosen)) < FEWEST_FRAMES - 1)
    assert fixed_offset(mapped, few, rotations, PARAMETERS) is None
