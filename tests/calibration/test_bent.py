"""A needle that is bent one way as the probe sees it is warned of; one that is straight, or turned about, is not."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import sonocal as sc
from sonocal.calibration.rows import point_line_rows
from sonocal.registration.bent_lines import bend_of
from sonocal.registration.mapped import MappedRows

CODE = "bent-needle"
SIDE, SCALE, NEEDLE_MM, TILT = 400, 0.25, 200.0, 0.6
MM, PX = 0.4, 1.0


def bent_rows(seed, count, sag_mm=0.0, *, rolling=False, dimension=2):
    """Stills of a needle, each seen at another place along it; what is seen is off by that share of the sag.

    Returns:
        The rows, and the sag (3,) in the probe marker's frame.
    """
    rng = np.random.default_rng([seed, count, dimension])
    turn, shift = Rotation.random(random_state=rng).as_matrix(), rng.uniform(-80, 80, 3)
    middle = rng.uniform(20, SIDE - 20, (count, 3))
    if dimension == 2:
        middle[:, 2] = 0.0
    way = Rotation.from_rotvec(rng.uniform(-TILT, TILT, (count, 3))).as_matrix()[
        :, :, 2 if dimension == 2 else 0
    ]
    offsets = [0.0] if dimension == 2 else [-150.0, 150.0]
    place = rng.uniform(0.3, 0.7, count)
    direction = way @ turn.T
    start = SCALE * middle @ turn.T + shift - place[:, None] * NEEDLE_MM * direction
    start += rng.normal(0, MM, (count, 3))
    end = start + NEEDLE_MM * direction + rng.normal(0, MM, (count, 3))
    bend = sag_mm * (rng.normal(size=(count, 3)) if rolling else np.array([0.0, 1.0, 0.0])) @ turn.T
    points, segments, frame = [], [], []
    for along in offsets:
        share = place + along * SCALE / NEEDLE_MM
        points.append(middle + along * way + rng.normal(0, PX, (count, 3)))
        points[-1] += (share[:, None] * bend) @ turn / SCALE
        segments.append(np.stack([start, end], axis=1))
        frame.append(np.arange(count))
    rows = np.argsort(np.concatenate(frame), kind="stable")
    return sc.Observations(
        np.concatenate(points)[rows, :dimension],
        np.concatenate(segments)[rows],
        frame=np.concatenate(frame)[rows],
        image_size_px=(SIDE,) * dimension,
    ), turn @ np.array([0.0, sag_mm, 0.0])


def port_rows(seed, count, spread_mm):
    """Stills of a straight needle through a port, seen `spread_mm` rms from the middle of its segment."""
    rng = np.random.default_rng([seed, count])
    turn, shift = Rotation.random(random_state=rng).as_matrix(), rng.uniform(-80, 80, 3)
    seen = np.column_stack([rng.uniform(20, SIDE - 20, (count, 2)), np.zeros(count)])
    port = np.array([SIDE / 2, SIDE / 2, 60.0 / SCALE]) + rng.normal(0, 3.0 / SCALE, (count, 3))
    way = (port - seen) / np.linalg.norm(port - seen, axis=1, keepdims=True)
    middle = SCALE * (seen @ turn.T) + shift + rng.normal(0, spread_mm, (count, 1)) * (way @ turn.T)
    ends = middle[:, None] + 0.5 * NEEDLE_MM * np.array([-1.0, 1.0])[:, None] * (way @ turn.T)[:, None]
    points = seen[:, :2] + rng.normal(0, 2.0 * PX, (count, 2))
    return sc.Observations(points, ends + rng.normal(0, MM, ends.shape), image_size_px=(SIDE, SIDE))


def said(rows):
    return [one for one in sc.calibrate(rows).warnings if one.code == CODE]


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("sag_mm", [8.0, -8.0])
def test_a_bent_needle_is_found(dimension, sag_mm):
    for seed in range(5):
        (finding,) = said(bent_rows(seed, 150, sag_mm, dimension=dimension)[0])
        assert "one way as the probe sees it" in finding.message
        assert "stiffer" in finding.advice


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("count", [10, 30, 150])
def test_straight_needles_are_not_accused(dimension, count):
    assert sum(bool(said(bent_rows(seed, count, dimension=dimension)[0])) for seed in range(15)) <= 1


@pytest.mark.parametrize("spread_mm", [0.0, 2.0, 5.0, 20.0])
def test_straight_needles_through_a_port_are_not_accused(spread_mm):
    """All come from one side: a point's noise moves its place along the needle and its residual together."""
    assert sum(bool(said(port_rows(seed, 300, spread_mm))) for seed in range(15)) <= 1


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_needle_that_is_turned_about_its_axis_is_not_accused(dimension):
    made = (bent_rows(seed, 100, 2.0, rolling=True, dimension=dimension)[0] for seed in range(10))
    assert sum(bool(said(rows)) for rows in made) <= 1


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_bend_is_found_in_the_frame_of_the_lines(dimension):
    rows, sag = bent_rows(0, 400, 8.0, dimension=dimension)
    found = sc.calibrate(rows)
    mapped = MappedRows(found.probe_from_image, point_line_rows(rows))
    chosen = mapped.distances < found.threshold_mm
    bend = bend_of(mapped, chosen, levels=(PX, MM), parameters=7, groups=[])
    np.testing.assert_allclose(bend.sag_mm, sag, atol=3.0)


def test_rows_at_one_place_along_the_needle_tell_of_no_bend():
    rows, _ = bent_rows(0, 40)
    found = sc.calibrate(rows)
    mapped = MappedRows(found.probe_from_image, point_line_rows(rows))
    middle = (mapped.along_mm / mapped.lengths_mm)[:, None, None]
    segments = rows.segments_mm + (middle - 0.5) * np.diff(rows.segments_mm, axis=1)
    same = MappedRows(
        found.probe_from_image, point_line_rows(sc.Observations(rows.points_px, segments, frame=rows.frame))
    )
    everyone = np.ones(40, dtype=bool)
    assert bend_of(same, everyone, levels=(PX, MM), parameters=7, groups=[]) is None
