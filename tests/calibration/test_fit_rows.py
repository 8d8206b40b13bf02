"""The transform alone: what calibrate() gives, for whoever asks for it many times."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import sonocal as sc
from sonocal.calibration import Options, fit_rows
from sonocal.simulation.scene import simulate_observations
from tests.builders.similarities import random_similarity

OPTIONS = st.fixed_dictionaries(
    {},
    optional={
        "weighting": st.sampled_from(["likelihood", "geometric"]),
        "threshold_mm": st.sampled_from([3.0, 5.0, 20.0, "auto"]),
        "sigma_px": st.sampled_from([None, 1.0]),
        "sigma_mm": st.sampled_from([None, 1.0]),
        "max_samples": st.sampled_from([200, 10_000]),
        "seed": st.integers(0, 5),
    },
)


@given(st.integers(0, 500), st.sampled_from([2, 3]), OPTIONS)
def test_the_fit_is_calibrates_own(seed, dimension, options):
    rows = simulate_observations(dimension, 24, outlier_share=0.2, seed=seed).observations
    alone, whole = fit_rows(rows, Options.of(**options)), sc.calibrate(rows, **options)
    np.testing.assert_array_equal(alone.fit.transform.matrix, whole.probe_from_image.matrix)
    np.testing.assert_array_equal(alone.fit.inlier, whole.inlier)
    np.testing.assert_array_equal(alone.fit.residuals_mm, whole.residuals_mm)
    assert alone.fit.threshold_mm == whole.threshold_mm


def test_of_a_mirrored_pair_the_better_is_the_fit():
    """Nearly parallel needles: the other answer is handed back, and is the worse one."""
    rng, truth = np.random.default_rng(3), random_similarity(3, scale=0.24)
    points = rng.uniform(0, 500, (30, 2))
    middle = truth @ points + 0.3 * rng.normal(size=(30, 3))
    along = 100 * (truth.rotation[:, 2] + 0.01 * rng.normal(size=(30, 3)))
    rows = sc.Observations(points, np.stack([middle - along, middle + along], axis=1))
    table, fit, mirrored = fit_rows(rows, Options())
    assert mirrored is not None
    assert np.sum(np.minimum(fit.residuals_mm, 5) ** 2) <= np.sum(np.minimum(mirrored.residuals_mm, 5) ** 2)
    assert len(table) == len(rows)
    np.testing.assert_array_equal(sc.calibrate(rows).probe_from_image.matrix, fit.transform.matrix)


def parallel():
    rng = np.random.default_rng(0)
    start = rng.normal(size=(12, 3)) * 50
    return sc.Observations(
        rng.uniform(0, 500, (12, 2)), np.stack([start, start + np.array([0, 0, 100.0])], axis=1)
    )


@pytest.mark.parametrize(
    ("rows", "options", "kind"),
    [
        (simulate_observations(2, 3).observations, {}, sc.InputError),
        (simulate_observations(3, 6).observations, {"model": "rigid"}, sc.InputError),
        (parallel(), {}, sc.DegenerateGeometryError),
    ],
)
def test_it_refuses_what_calibrate_refuses_with_the_same_sentence(rows, options, kind):
    with pytest.raises(kind) as alone:
        fit_rows(rows, Options.of(**options))
    with pytest.raises(kind) as whole:
        sc.calibrate(rows, **options)
    assert str(alone.value) == str(whole.value)
