"""The core's door: whatever does not fit is refused in a sentence, before anything behind it looks at it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sonocal import _core
from sonocal.errors import InputError
from sonocal.registration.constraints import Rows
from sonocal.registration.rows import PointLineRows
from tests.builders import core_calls
from tests.builders.point_lines import scene_rows

RANDOM = np.random.default_rng(0)
ROWS = 12
POINTS = np.column_stack([RANDOM.uniform(0, 500, (ROWS, 2)), np.zeros(ROWS)])
SEGMENTS = RANDOM.uniform(-50, 50, (ROWS, 2, 3))
PLANES = np.column_stack(
    [np.linalg.qr(RANDOM.normal(size=(ROWS, 3)).T)[0].T[:1].repeat(ROWS, 0), np.ones(ROWS)]
)
SIGHTINGS = (np.arange(ROWS) // 2).astype(np.int32)
OPTIONS = {
    "model": "similarity",
    "weighting": "likelihood",
    "threshold": 5.0,
    "level_px": 0.0,
    "level_mm": 0.0,
    "confidence": 0.99,
    "max_samples": 100,
    "exhaustive_samples": 20,
    "seed": 0,
}
ALL = np.ones(ROWS, dtype=bool)


def spoilt(array, place, value):
    other = array.copy()
    other[place] = value
    return other


def lines(dimension=2, **columns):
    given_ = {"points": POINTS, "segments": SEGMENTS, "dimension": dimension} | columns
    return _core.Table.of_lines(**given_)


def options(**changes):
    return _core.Options(**(OPTIONS | changes))


def transform(**parts):
    still = {"rotation": np.eye(3), "translation": np.zeros(3), "scales": np.ones(3)}
    return _core.Transform(**(still | parts))


def codes(*values):
    return np.resize(np.array(values, dtype=np.int32), ROWS)


TABLES = [
    ({"points": POINTS[:-1].copy()}, "segments has 12 entries for 11 rows"),
    ({"points": POINTS[:0], "segments": SEGMENTS[:0]}, "between one row and 2"),
    ({"points": spoilt(POINTS, (3, 0), np.nan)}, "points holds a number that is not finite"),
    ({"segments": spoilt(SEGMENTS, (3, 0, 1), np.inf)}, "segments holds a number that is not finite"),
    ({"segments": spoilt(SEGMENTS, (3, 0, 1), 1e300)}, "beyond 1e60"),
    ({"segments": spoilt(SEGMENTS, 3, 1.0)}, "a segment has no length"),
    ({"points": spoilt(POINTS, (3, 2), 1.0)}, "third coordinate that is not 0"),
    ({"dimension": 1}, "dimension is neither 2 nor 3"),
    ({"dimension": -2}, "dimension is neither 2 nor 3"),
    ({"sightings": SIGHTINGS}, "sightings of several points are of 3D probes"),
    ({"dimension": 3, "sightings": SIGHTINGS[:-1].copy()}, "sightings has 11 entries for 12 rows"),
    ({"dimension": 3, "sightings": spoilt(SIGHTINGS, 0, -1)}, "sightings holds a number below 0"),
    ({"dimension": 3, "sightings": spoilt(SIGHTINGS, 0, 2**31 - 1)}, "not below the number of rows"),
    ({"dimension": 3, "sightings": spoilt(SIGHTINGS, slice(4), 9)}, "counted from 0 without a gap"),
    ({"frames": codes(0, -5)}, "frames holds a number below 0"),
    ({"targets": codes(0, 10**6)}, "targets holds a number below 0, or not below"),
    ({"frames": codes(0)[:3].copy()}, "frames has 3 entries for 12 rows"),
    ({"noise_px": np.zeros(ROWS)}, "noise_px holds a number that is not positive"),
    ({"noise_mm": np.full(ROWS, np.nan)}, "noise_mm holds a number that is not positive"),
    ({"noise_mm": np.ones(ROWS + 1)}, "noise_mm has 13 entries for 12 rows"),
]


@pytest.mark.parametrize(("columns", "sentence"), TABLES)
def test_a_table_that_is_none_is_not_made(columns, sentence):
    with pytest.raises(ValueError, match=sentence):
        lines(**columns)


@pytest.mark.parametrize(
    ("first", "sentence"),
    [
        ([], "first does not run from 0"),
        ([0], "first does not run from 0"),
        ([0, 6], "to the number of rows"),
        ([1, 12], "first does not run from 0"),
        ([0, 8, 4, 12], "first does not grow"),
        ([0, 6, 6, 12], "first does not grow"),
        ([0, -6, 12], "first does not grow"),
        ([0, 2**31 - 1, 12], "first does not grow"),
    ],
)
def test_groups_of_rows_cover_them_all_once_and_in_order(first, sentence):
    with pytest.raises(ValueError, match=sentence):
        _core.Table.of_planes(POINTS, PLANES, np.array(first, dtype=np.int32))


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"model": "affine"}, "no such model: affine"),
        ({"model": "rigid"}, "the rigid model, and no other, has a known scale"),
        ({"scale": 0.24}, "the rigid model, and no other, has a known scale"),
        ({"model": "rigid", "scale": -0.24}, "scale is not a number from 0 on"),
        ({"model": "rigid", "scale": np.nan}, "scale is not a number from 0 on"),
        ({"weighting": ""}, "no such weighting: "),
        ({"threshold": -1.0}, "threshold is not"),
        ({"threshold": np.nan}, "threshold is not"),
        ({"level_px": -1.0}, "a noise level is not"),
        ({"level_mm": np.inf}, "a noise level is not"),
        ({"confidence": 1.0}, "confidence is not between 0 and 1"),
        ({"confidence": np.nan}, "confidence is not between 0 and 1"),
        ({"max_samples": 0}, "max_samples is not between"),
        ({"max_samples": 2**30 + 1}, "max_samples is not between"),
        ({"exhaustive_samples": -1}, "exhaustive_samples is not between"),
    ],
)
def test_options_that_mean_nothing_are_refused(changes, sentence):
    with pytest.raises(ValueError, match=sentence):
        options(**changes)


@pytest.mark.parametrize(
    ("parts", "sentence"),
    [
        ({"rotation": 1.001 * np.eye(3)}, "rotation is not orthonormal"),
        ({"rotation": np.full((3, 3), np.nan)}, "rotation holds a number that is not finite"),
        ({"translation": np.full(3, np.inf)}, "translation holds a number that is not finite"),
        ({"scales": np.zeros(3)}, "scales are not positive"),
        ({"scales": np.array([1.0, -1, 1])}, "scales are not positive"),
    ],
)
def test_a_transform_is_one(parts, sentence):
    with pytest.raises(ValueError, match=sentence):
        transform(**parts)


@pytest.mark.parametrize(
    ("chosen", "sentence"),
    [(ALL[:-1].copy(), "chosen has 11 entries for 12 rows"), (~ALL, "no row is chosen")],
)
@pytest.mark.parametrize("call", [_core.refine, _core.white_residuals])
def test_marks_are_as_many_as_rows(call, chosen, sentence):
    with pytest.raises(ValueError, match=sentence):
        call(lines(), chosen, transform(), options())
    with pytest.raises(ValueError, match=sentence):
        _core.extent(lines(), chosen)
    with pytest.raises(ValueError, match=sentence):
        _core.noise_sums(lines(), chosen, transform(), options(), np.eye(7), [], known_px=True, known_mm=True)


def test_each_call_takes_its_own_kind_of_table():
    planes = _core.Table.of_planes(POINTS, PLANES, np.array([0, ROWS], dtype=np.int32))
    with pytest.raises(ValueError, match="of points and planes, and this takes points and lines"):
        _core.estimate(planes, options())
    with pytest.raises(ValueError, match="of points and lines, and this takes points and planes"):
        _core.estimate_correspondences(lines(), options())


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("model", ["rigid", "similarity", "anisotropic"])
def test_a_covariance_has_a_row_for_every_unknown(dimension, model):
    of_sightings = {"sightings": SIGHTINGS} if dimension == 3 else {}
    scale = {"scale": 1.0} if model == "rigid" else {}
    found = _core.refine(lines(dimension, **of_sightings), ALL, transform(), options(model=model, **scale))
    unknowns = 6 + {"rigid": 0, "similarity": 1, "anisotropic": dimension}[model]
    assert found.covariance.shape == (unknowns, unknowns)
    assert model != "rigid" or (found.scales == 1.0).all()


@pytest.mark.parametrize(
    ("covariance", "groups", "sentence"),
    [
        (np.eye(8), [], "as many rows and columns as the model has parameters"),
        (np.full((7, 7), np.nan), [], "covariance holds a number that is not finite"),
        (np.eye(7), [codes(0)[:3].copy()], "a grouping has not as many entries"),
    ],
)
def test_sums_of_noise_take_what_belongs_to_the_table(covariance, groups, sentence):
    with pytest.raises(ValueError, match=sentence):
        _core.noise_sums(
            lines(), ALL, transform(), options(), covariance, groups, known_px=False, known_mm=False
        )


IMAGE = np.zeros((8, 6), dtype=np.float32)
MASK = np.ones((8, 6), dtype=np.uint8)


@pytest.mark.parametrize(
    ("mask", "scales", "pool", "sentence"),
    [
        (MASK[:0], [1.0, 2.0], 1, "between one and 2"),
        (MASK, [1.0], 1, "there are not between 2 and 64 scales"),
        (MASK, [0.0, 1.0], 1, "a scale is not between"),
        (MASK, [1.0, np.nan], 1, "a scale is not between"),
        (MASK, [-1.0, 1.0], 1, "a scale is not between"),
        (MASK, [2.0, 1.0], 1, "scales do not grow"),
        (MASK, [1.0, 2.0], 0, "pool is not between"),
    ],
)
def test_a_filter_has_scales_that_it_can_have(mask, scales, pool, sentence):
    with pytest.raises(ValueError, match=sentence):
        _core.BlobFilter(mask, scales, pool)


@pytest.mark.parametrize(
    ("image", "count", "limit", "sentence"),
    [
        (IMAGE[:, :-1].copy(), 1, 0.0, "the image and the mask differ in shape"),
        (IMAGE, -1, 0.0, "count is not between"),
        (IMAGE, 2**31 - 1, 0.0, "count is not between"),
        (IMAGE, 1, np.nan, "a limit is not a finite number"),
        (np.full_like(IMAGE, np.nan), 1, 0.0, "the image holds a number that is not finite"),
    ],
)
def test_an_image_is_that_of_the_mask(image, count, limit, sentence):
    blobs = _core.BlobFilter(MASK, [1.0, 2.0], 1)
    with pytest.raises(ValueError, match=sentence):
        blobs.detect(image, count, limit, 0.0, 0.5, 0.5, False)


TRIALS = {
    "dimension": 2,
    "solver": "closed_form",
    "likelihood": False,
    "threshold_mm": 5.0,
    "level_px": 1.0,
    "level_mm": 1.0,
    "confidence": 0.99,
    "max_samples": 10,
    "threads": 1,
}


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"solver": "best"}, "no such solver: best"),
        ({"solver": "paper_four_points", "dimension": 3}, "four points are of a 2D image"),
        ({"dimension": 4}, "differ in their number"),
        ({"threads": 0}, "threads is not between"),
        ({"threads": -1}, "threads is not between"),
        ({"confidence": 0.0}, "confidence is not between"),
        ({"max_samples": 2**31 - 1}, "max_samples is not between"),
        ({"level_px": -1.0}, "a noise level is not"),
        ({"threshold_mm": np.nan}, "threshold_mm is not"),
    ],
)
def test_trials_are_refused_whole(changes, sentence):
    seeds = np.zeros(1, dtype=np.uint64)
    with pytest.raises(ValueError, match=sentence):
        _core.study_trials(POINTS[None], SEGMENTS[None], seeds, **(TRIALS | changes))


def test_trials_have_as_many_rows_seeds_marks_and_truths():
    seeds, numbers = (
        np.zeros(1, dtype=np.uint64),
        {"dimension": 2, "level_px": 1.0, "level_mm": 1.0, "threads": 1},
    )
    truth = np.eye(4)[None]
    with pytest.raises(ValueError, match="differ in their number of trials or rows"):
        _core.study_trials(POINTS[None], SEGMENTS[None, :-1].copy(), seeds, **TRIALS)
    with pytest.raises(ValueError, match="one seed a trial"):
        _core.study_trials(POINTS[None], SEGMENTS[None], seeds[:0], **TRIALS)
    for sound, truths in ((ALL[None, :-1].copy(), truth), (ALL[None], truth[:0])):
        with pytest.raises(ValueError, match="differ in their number of trials or rows"):
            _core.study_bounds(POINTS[None], SEGMENTS[None], sound, truths, **numbers)


@pytest.mark.parametrize("steps", [-1, 1001, 2**31 - 1])
def test_solvers_take_steps_scale_and_threads_that_make_sense(steps):
    four, segments = POINTS[:4, :2].copy(), SEGMENTS[:4].copy()
    with pytest.raises(ValueError, match="steps is not between"):
        _core.four_points(four, segments, steps, 0.0, 1)
    for scale in (-1.0, np.nan, np.inf):
        with pytest.raises(ValueError, match="scale is not"):
            _core.four_points(four, segments, 1, scale, 1)
    with pytest.raises(ValueError, match="threads is not"):
        _core.four_points(four, segments, 1, 0.0, 0)


def test_arrays_of_another_type_or_stride_are_refused_not_reinterpreted():
    for points in (POINTS.astype(np.float32), POINTS[::-1], POINTS.tolist(), np.asfortranarray(POINTS), None):
        with pytest.raises(TypeError):
            lines(points=points)


def test_a_table_keeps_its_arrays_alive():
    table = _core.Table.of_lines(POINTS.copy(), SEGMENTS.copy(), dimension=2)
    for _ in range(20):
        np.full((ROWS, 2, 3), np.nan)  # takes the place of what was let go
    expected = _core.extent(lines())
    np.testing.assert_array_equal(_core.extent(table).ends, expected.ends)
    assert len(table) == ROWS


def test_what_a_call_does_not_make_is_no_attribute():
    found = _core.estimate(scene_rows(0, 2)[0].core, options())
    assert found.covariance.shape == (7, 7)
    with pytest.raises(AttributeError, match="this call makes no such array"):
        _ = found.jacobian


def test_python_says_it_as_bad_input():
    with pytest.raises(
        InputError, match="the rows cannot be fitted: points holds a number that is not finite"
    ):
        _ = PointLineRows(spoilt(POINTS, (0, 0), np.nan), SEGMENTS, 2).core
    with pytest.raises(InputError, match="first does not run from 0"):
        _ = Rows(POINTS, PLANES, np.array([0], dtype=np.int32)).core


def test_everything_in_the_core_is_called_with_hostile_arrays():
    assert core_calls.missing(_core) == set()


@pytest.mark.parametrize("name", core_calls.CALLS)
@given(seed=st.integers(0, 2**32))
@settings(max_examples=25)
def test_a_hostile_call_is_answered_or_refused_in_a_sentence(name, seed):
    number = list(core_calls.CALLS).index(name)
    assert isinstance(core_calls.call(_core, seed, number, name), bool)
