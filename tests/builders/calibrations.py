"""Calibrations and their tables, sound and not, for tests of what is said of them."""

import dataclasses
import functools

import numpy as np
from benchmarks.simulators.scans import scan

import sonocal as sc
from sonocal.simulation.scene import simulate_observations


@functools.cache
def sound_calibration(seed=1, count=60):
    """Of sightings with nothing wrong, quoted at the corners of the simulated image."""
    return sc.calibrate(simulate_observations(2, count, seed=seed).observations, image_size_px=(500, 500))


def calibration_with(transform):
    """A calibration whose transform is the one given."""
    return dataclasses.replace(sound_calibration(), probe_from_image=transform)


def slipped_rows(seed=0, at=0.5):
    """Sightings of a scan during which the marker turned by 2 degrees and moved by 4 mm."""
    return scan(seed, slip=(np.radians([0, 2, 0]), np.array([4.0, 0, 0])), slip_at=at).observations


def parted_rows(seed=5, count=60, fitted=40, moved_mm=0.0):
    """Sightings of which some are held out, whose lines are moved along all axes."""
    rows = simulate_observations(2, count, seed=seed).observations
    late = np.arange(count) >= fitted
    moved = rows.segments_mm + np.where(late, moved_mm, 0.0)[:, None, None]
    return dataclasses.replace(rows, split=np.where(late, "test", "fit"), segments_mm=moved)
