"""A second line along the wall: found where it is, told from what moves, and said."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sonocal.detection import Detections
from sonocal.observations import Observations
from sonocal.sweep.second_wall import find_second_wall, second_wall_findings

SCALE = 0.3
FRAMES = 20


def seen(*away_mm, share=1.0, brightness=0.7, scatter_mm=0.0, turned_deg=0.0, seed=0):
    """Walls at any tilt, each with others so far below it; and the table in which the walls were chosen."""
    rng = np.random.default_rng(seed)
    frames, points, scores, chosen = [], [], [], []
    for frame in range(FRAMES):
        tilt, depth = rng.uniform(-0.5, 0.5), rng.uniform(80, 220)
        lines = [(tilt, 0.0, 100.0)]
        for away in away_mm if rng.random() < share else ():
            off = (away + scatter_mm * rng.normal()) / SCALE
            lines.append((tilt + np.radians(turned_deg), off, 100.0 * brightness))
        for i, (angle, off, score) in enumerate(lines):
            middle = np.array([150.0, depth]) + off * np.array([-np.sin(tilt), np.cos(tilt)])
            along = rng.uniform(30, 60) * np.array([np.cos(angle), np.sin(angle)])
            frames.append(frame)
            points.append([middle - along, middle + along])
            scores.append(score)
            if i == 0:
                chosen += points[-1]
    spanning = np.tile(np.eye(3) * 50.0, (len(chosen), 1, 1))
    table = Observations.of_targets(
        np.array(chosen), spanning, frame=np.repeat(np.arange(FRAMES), 2), target=np.full(2 * FRAMES, "floor")
    )
    return Detections(np.array(frames), np.array(points), score=np.array(scores), images=FRAMES), table


@settings(max_examples=20, deadline=None)
@given(st.floats(2.0, 40.0), st.booleans(), st.floats(0.4, 1.6), st.integers(0, 99))
def test_it_is_found_as_far_away_and_as_bright_as_it_is(away, above, brightness, seed):
    walls, chosen = seen(-away if above else away, brightness=brightness, seed=seed)
    found = find_second_wall(walls, chosen, SCALE)
    assert found.deeper_mm == pytest.approx(-away if above else away)
    assert found.brightness == pytest.approx(brightness)
    assert (found.seen, found.images) == (FRAMES, FRAMES)
    (finding,) = second_wall_findings(found)
    assert (finding.severity == "warning") == (above or brightness >= 0.9)
    assert f"{away:.1f} mm {'nearer' if above else 'deeper'}" in finding.message


@pytest.mark.parametrize(
    "how",
    [
        {"share": 0.0},
        {"share": 0.1},
        {"scatter_mm": 15.0},  # as what went to the wall twice
        {"turned_deg": 15.0},
    ],
)
def test_what_is_rare_or_elsewhere_each_time_or_not_parallel_is_none(how):
    found = find_second_wall(*seen(20.0, **how), SCALE)
    assert found is None
    assert list(second_wall_findings(found)) == []


def test_walls_that_were_chosen_both_are_no_second_ones():
    walls, _ = seen(12.0)
    spanning = np.tile(np.eye(3) * 50.0, (2 * len(walls), 1, 1))
    chosen = Observations.of_targets(
        walls.points_px.reshape(-1, 2),
        spanning,
        frame=np.repeat(walls.frame, 2),
        target=np.repeat(np.where(walls.rank == 0, "floor", "sheet"), 2),
    )
    assert find_second_wall(walls, chosen, SCALE) is None


def test_of_one_below_and_one_above_the_one_above_is_said():
    found = find_second_wall(*seen(5.0, -12.0, brightness=0.5), SCALE)
    assert found.deeper_mm == pytest.approx(-12.0)
    assert found.is_above
