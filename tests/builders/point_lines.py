"""Points on lines as registration takes them, of simulated sightings and of none."""

from __future__ import annotations

import dataclasses

import numpy as np

from sonocal.calibration import point_line_rows
from sonocal.geometry import AxisScaled, Similarity
from sonocal.registration.rows import PointLineRows
from sonocal.simulation.scene import simulate_observations

STEP = [0.03, 0.03, 0.03, 3.0, 3.0, 3.0, 0.03]


def scene_rows(
    seed: int, dimension: int, count: int = 20, **noise: float
) -> tuple[PointLineRows, Similarity]:
    """Rows of so many needles, and the truth."""
    scene = simulate_observations(dimension, count, seed=seed, **noise)
    return point_line_rows(scene.observations), scene.probe_from_image


def wire_rows(seed: int, frames: int = 12, wires: int = 5, drift_mm: float = 0.3) -> PointLineRows:
    """Rows of wires in frames of a 2D probe, whose errors are partly shared by frame and by wire."""
    random = np.random.default_rng(seed)
    frame, target = np.repeat(np.arange(frames), wires), np.tile(np.arange(wires), frames)
    truth = Similarity.from_rotvec(random.normal(size=3), random.normal(size=3) * 50, 0.24)
    points = np.column_stack([random.uniform(0, 500, (len(frame), 2)), np.zeros(len(frame))])
    shared = drift_mm * (random.normal(size=(frames, 3))[frame] + random.normal(size=(wires, 3))[target])
    middle = truth @ points + shared + 0.2 * random.normal(size=(len(frame), 3))
    along = 40 * random.normal(size=(len(frame), 3))
    segments = np.stack([middle - along, middle + along], axis=1)
    return PointLineRows(points, segments, 2, frame=frame.astype(np.int32), target=target.astype(np.int32))


def reordered(rows: PointLineRows, order: np.ndarray) -> PointLineRows:
    """The same rows, in another order or some of them several times; sightings keep their codes."""
    columns = {
        field.name: np.ascontiguousarray(value[order])
        for field in dataclasses.fields(rows)
        if isinstance(value := getattr(rows, field.name), np.ndarray)
    }
    return dataclasses.replace(rows, **columns)


def moved(rows: PointLineRows, mover: Similarity) -> PointLineRows:
    """The lines carried by a similarity."""
    return dataclasses.replace(rows, segments_mm=np.ascontiguousarray(mover @ rows.segments_mm))


def tangent_step(transform: AxisScaled, step: np.ndarray) -> Similarity:
    """A similarity near another one."""
    return Similarity(transform.rotation, transform.translation, transform.scales[0]).retract(step)
