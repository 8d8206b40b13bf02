"""What a session shows of an object: one short line with units, whatever is in it."""

import dataclasses

import numpy as np
import pytest

import sonocal as sc
from sonocal.geometry import AxisScaled, Similarity
from sonocal.simulation.scene import simulate_observations
from tests.builders.recordings import random_recording

ROWS = {dimension: simulate_observations(dimension, 12, seed=1).observations for dimension in (2, 3)}


@pytest.fixture(scope="module")
def shown():
    return {
        "table": ROWS[2],
        "table of a volume": ROWS[3],
        "table of a long name": ROWS[2].with_sound(source="a\n\x1b[31m" * 100),
        "calibration": sc.calibrate(ROWS[2]),
        "calibration of two scales": sc.calibrate(ROWS[2], model="anisotropic"),
        "calibration of a volume": sc.calibrate(ROWS[3], image_size_px=(500, 500, 500)),
        "calibration that predicts nothing": dataclasses.replace(sc.calibrate(ROWS[2]), covariance=None),
        "similarity": Similarity.identity(),
        "similarities": Similarity(np.tile(np.eye(3), (5, 1, 1)), np.zeros((5, 3)), np.ones(5)),
        "two scales": AxisScaled(np.eye(3), np.zeros(3), np.array([0.1, 0.2, 0.15])),
        "recording": random_recording(0, n=3, size=(5, 4)),
        "poses alone": dataclasses.replace(
            random_recording(0, n=3, size=(5, 4)), frames=sc.recording.frames.no_frames()
        ),
    }


def test_a_repr_is_one_short_line(shown):
    for name, one in shown.items():
        assert repr(one).startswith(f"<{type(one).__name__}"), name
        assert repr(one).isprintable(), name
        assert len(repr(one)) < 200, name


def test_reprs_say_what_is_in_them(shown):
    assert (
        repr(shown["table"])
        == "<Observations of a 2D probe: 12 rows, 12 frames, 1 target, from 'simulation (seed 1)'>"
    )
    assert "mm/px, 12 of 12 rows, errors up to" in repr(shown["calibration"])
    assert "no error is predicted" in repr(shown["calibration that predicts nothing"])
    assert repr(shown["similarity"]) == "<Similarity: 1 mm/px, turned by 0.0 deg, origin at (0, 0, 0) mm>"
    assert repr(shown["two scales"]).startswith("<AxisScaled: 0.1 x 0.2 x 0.15 mm/px")
