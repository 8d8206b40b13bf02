"""Sightings outside of their image are named, however small it is said to be; noise at its edges is none."""

import dataclasses

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

import sonocal as sc
from sonocal.cli.main import main
from sonocal.observations.outside import outside_findings
from sonocal.simulation.scene import simulate_observations
from sonocal.validation import give_verdict

ROWS = simulate_observations(2, 60, seed=4).observations
sizes = st.integers(50, 2000)


@given(sizes, sizes, st.integers(0, 99), st.integers(0, 20), st.sampled_from([0, 1]), st.booleans())
def test_as_many_are_counted_as_lie_far_outside(width, height, seed, outside, axis, before):
    rng = np.random.default_rng(seed)
    size = np.array([width, height])
    points = rng.uniform(0, 1, (30, 2)) * (size - 1) + rng.normal(0, 1, (30, 2))
    points[:outside, axis] = -0.5 * size[axis] if before else 1.5 * size[axis]
    said = [*outside_findings(points, (width, height))]
    assert [one.message.split(" sightings")[0] for one in said] == [f"{outside} of 30"] * bool(outside)
    assert not [*outside_findings(points, None)]


@pytest.mark.parametrize("size", [(100, 100), (1, 1), (500, 50)])
def test_a_size_that_is_too_small_stops(size):
    for table, options in (
        (dataclasses.replace(ROWS, image_size_px=size), {}),
        (dataclasses.replace(ROWS, image_size_px=None), {"image_size_px": size}),
    ):
        verdict = give_verdict(sc.calibrate(table, **options))
        assert (verdict.level, verdict.codes[0]) == ("stop", "outside-image")


def test_info_says_so_too(tmp_path):
    path = tmp_path / "rows.csv"
    for size, said in (((100, 100), True), ((500, 500), False)):
        sc.write_observations(dataclasses.replace(ROWS, image_size_px=size), path)
        shown = CliRunner().invoke(main, ["info", str(path)])
        assert ("outside-image" in shown.output) == said
        path.unlink()
