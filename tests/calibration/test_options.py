"""Options: refused at the door with the option's name, kept typed in the result and in its file."""

import dataclasses
import json
import typing

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import sonocal as sc
from sonocal.calibration import Options
from sonocal.calibration.options import Keywords
from sonocal.registration.options import Options as RegistrationOptions
from sonocal.simulation.scene import simulate_observations
from tests.builders.similarities import random_similarity

NAMES = [field.name for field in dataclasses.fields(Options)]
LENGTHS = ["threshold_mm", "tolerance_mm", "sigma_px", "sigma_mm", "scanner_mm_per_px"]
COUNTS = ["max_samples"]

positive = st.floats(1e-6, 1e6)
no_length = st.one_of(
    st.floats(max_value=0.0), st.sampled_from([np.nan, np.inf, True, False, "5", [5.0, 5.0, 5.0], b"x"])
)
sizes = st.one_of(st.none(), st.lists(st.integers(1, 5000), min_size=2, max_size=3).map(tuple))
splits = st.one_of(st.none(), st.text(min_size=1, max_size=5))
rotations = st.one_of(st.none(), st.integers(0, 1000).map(lambda seed: random_similarity(seed).rotation))
sound = st.fixed_dictionaries(
    {},
    optional={
        "model": st.sampled_from(["similarity", "anisotropic"]),
        "weighting": st.sampled_from(["likelihood", "geometric"]),
        "threshold_mm": st.one_of(positive, st.just("auto")),
        "sigma_px": st.one_of(st.none(), positive),
        "sigma_mm": st.one_of(st.none(), positive),
        "max_samples": st.integers(1, 10**6),
        "seed": st.integers(0, 2**31),
        "fit_split": splits,
        "image_size_px": sizes,
        "tolerance_mm": positive,
        "scanner_mm_per_px": st.one_of(st.none(), positive, st.tuples(positive, positive)),
        "marker_above_image": st.booleans(),
        "expected_rotation": rotations,
    },
)


def refusal(**options):
    with pytest.raises(sc.InputError) as caught:
        Options.of(**options)
    return str(caught.value)


@given(st.sampled_from(LENGTHS), no_length)
def test_what_is_no_length_is_refused_by_the_options_name(name, value):
    sentence = refusal(**{name: value})
    assert name in sentence
    assert "positive" in sentence
    assert "got" in sentence


@given(
    st.sampled_from(COUNTS), st.one_of(st.integers(max_value=0), st.sampled_from([True, np.nan, "7", None]))
)
def test_what_is_no_count_is_refused_by_the_options_name(name, value):
    assert name in refusal(**{name: value})


@given(st.sampled_from(NAMES), st.integers(0, 30), st.sampled_from("aeiouxyz_"))
def test_a_misspelt_option_is_refused_and_the_right_one_named(name, place, letter):
    place %= len(name)
    wrong = name[:place] + letter + name[place + 1 :]
    if wrong in NAMES:
        return
    sentence = refusal(**{wrong: 1})
    assert repr(wrong) in sentence
    assert name in sentence


def test_a_misspelt_option_is_refused_before_the_table_is_looked_at():
    with pytest.raises(sc.InputError, match="treshold_mm"):
        sc.calibrate(None, treshold_mm=3)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"model": "affine"}, "model must be one of similarity, anisotropic, rigid; got 'affine'"),
        ({"weighting": "none"}, "weighting must be one of likelihood, geometric; got 'none'"),
        ({"fit_split": 3}, "fit_split must be the name of a split; got 3"),
        ({"test_split": b"a"}, "test_split must be the name of a split; got b'a'"),
        ({"fit_split": "a", "test_split": "a"}, "fit_split and test_split are both 'a'"),
        (
            {"image_size_px": (640,)},
            "image_size_px must be two or three positive whole numbers below 1e+09; got (640,)",
        ),
        (
            {"image_size_px": (640, 0)},
            "image_size_px must be two or three positive whole numbers below 1e+09",
        ),
        (
            {"image_size_px": (640.5, 480)},
            "image_size_px must be two or three positive whole numbers below 1e+09",
        ),
        (
            {"image_size_px": 640},
            "image_size_px must be two or three positive whole numbers below 1e+09; got 640",
        ),
        ({"scanner_mm_per_px": -1}, "scanner_mm_per_px must be positive"),
        (
            {"scanner_mm_per_px": (0.1, 0.1, 0.1)},
            "scanner_mm_per_px must be positive, one number or one along u",
        ),
        ({"marker_above_image": "yes"}, "marker_above_image must be True or False; got 'yes'"),
        ({"expected_rotation": np.eye(4)}, "expected_rotation must be the directions of u, v and normal"),
        ({"expected_rotation": np.full((3, 3), np.nan)}, "expected_rotation must be the directions"),
        ({"expected_rotation": "up"}, "expected_rotation must be the directions"),
        ({"expected_rotation": 10**400}, "expected_rotation must be the directions"),
        ({"expected_rotation": np.diag([1, 1, -1])}, "expected_rotation must be a rotation; got left-handed"),
        ({"threshold_mm": "5"}, "threshold_mm must be a positive number; got the text '5'"),
        ({"max_samples": "5"}, "got the text '5'"),
    ],
)
def test_every_other_refusal_says_what_arrived_and_what_is_wanted(options, words):
    assert words in refusal(**options)


@given(sound)
def test_numpys_scalars_and_arrays_are_the_same_options_as_pythons(options):
    kinds = {bool: np.bool_, int: np.int64, float: np.float64}
    theirs = {name: kinds.get(type(value), lambda x: x)(value) for name, value in options.items()}
    theirs |= {
        name: np.array(value)
        for name, value in options.items()
        if name in ("image_size_px", "scanner_mm_per_px") and isinstance(value, tuple)
    }
    ours, same = Options.of(**options), Options.of(**theirs)
    assert ours == same
    assert hash(ours) == hash(same)
    for name in NAMES:
        assert type(getattr(same, name)).__module__ == "builtins", name


@given(sound)
def test_options_come_back_from_a_file_as_they_were(options):
    chosen = Options.of(**options)
    record = json.loads(json.dumps(chosen.record()))
    assert Options.from_record(record | {"probe": "L14", "count": 3}) == chosen


@given(sound, positive)
def test_only_auto_is_resolved(options, threshold):
    chosen = Options.of(**options)
    used = chosen.resolved(threshold)
    if chosen.threshold_mm == "auto":
        assert used == dataclasses.replace(chosen, threshold_mm=threshold)
    else:
        assert used == chosen


def test_calibrations_options_are_registrations_and_more():
    assert issubclass(Options, RegistrationOptions)
    with pytest.raises(dataclasses.FrozenInstanceError):
        Options().seed = 3


def test_the_keywords_that_are_typed_and_those_that_are_taken_are_the_same():
    assert list(typing.get_type_hints(Keywords)) == NAMES
    said = sc.calibrate.__doc__
    assert all(name in said for name in NAMES), [name for name in NAMES if name not in said]


def test_the_defaults_that_help_states_are_those_taken():
    said = sc.calibrate.__doc__
    for field in dataclasses.fields(Options):
        stated = {"model": '"similarity"', "weighting": '"likelihood"'}
        if field.name == "sigma_px":
            continue  # stands beside sigma_mm, which has the same
        assert f"{field.name} ({stated.get(field.name, field.default)})" in said, field.name


# What a calibration keeps


@pytest.fixture(scope="module")
def rows():
    return simulate_observations(2, 30, outlier_share=0.2, seed=4).observations


def test_a_calibration_knows_what_it_was_made_with(rows):
    asked = {"threshold_mm": np.float32(4.0), "seed": np.int32(3), "sigma_px": 1, "image_size_px": [500, 400]}
    rows = dataclasses.replace(rows, image_size_px=None)
    found = sc.calibrate(rows, **asked)
    assert found.options == Options.of(**asked)
    assert found.options.image_size_px == (500, 400)
    assert found.threshold_mm == 4.0


def test_auto_comes_to_a_number_that_parts_the_rows_as_it_did(rows, tmp_path):
    found = sc.calibrate(rows, threshold_mm="auto")
    assert isinstance(found.options.threshold_mm, float)
    np.testing.assert_array_equal(found.inlier, found.residuals_mm <= found.threshold_mm)
    assert 0 < found.inlier.sum() < len(rows)
    found.save(tmp_path / "c.json")
    kept = json.loads((tmp_path / "c.json").read_text())["provenance"]["options"]
    assert (kept["threshold_mm"], kept["threshold_asked"]) == (found.threshold_mm, "auto")
    assert sc.load(tmp_path / "c.json").options == found.options


def test_a_number_asked_for_is_kept_alone(rows):
    assert "threshold_asked" not in sc.calibrate(rows).provenance["options"]


def test_calibrating_again_with_the_options_kept_gives_the_same(rows):
    found = sc.calibrate(rows, threshold_mm="auto", weighting="geometric")
    again = sc.calibrate(rows, **{field: getattr(found.options, field) for field in NAMES})
    np.testing.assert_array_equal(again.inlier, found.inlier)
    np.testing.assert_allclose(
        again.probe_from_image.matrix, found.probe_from_image.matrix, rtol=1e-7, atol=1e-7
    )
    assert again.options == found.options


def test_options_hold_no_auto_where_a_calibration_is_asked_for_its_threshold(rows):
    found = dataclasses.replace(sc.calibrate(rows), options=Options(threshold_mm="auto"))
    with pytest.raises(sc.InputError, match='the threshold that "auto" came to'):
        _ = found.threshold_mm


@pytest.mark.parametrize(
    "options",
    [
        {"model": np.str_("anisotropic")},
        {"threshold_mm": np.str_("auto")},
        {"weighting": np.str_("geometric")},
    ],
)
def test_texts_of_other_types_are_kept_as_texts(options, tmp_path):
    found = sc.calibrate(simulate_observations(2, 20, seed=1).observations, **options)
    found.save(tmp_path / "calibration.json")
    assert sc.load(tmp_path / "calibration.json").options == found.options


@pytest.mark.parametrize(
    "options",
    [
        *(
            {name: value}
            for name in ("threshold_mm", "sigma_px", "tolerance_mm")
            for value in (10**400, 1e300)
        ),
        *({"model": value} for value in (np.array(["similarity"]), np.array(["similarity", "x"]), None, 3)),
        *({"threshold_mm": value} for value in (np.array([3.0, 2.0]), np.array("auto"), None)),
        *({"expected_rotation": value} for value in (np.zeros((3, 3)), np.ones((3, 3)), 1e-200 * np.eye(3))),
        {"scanner_mm_per_px": 10**400},
        {"image_size_px": (10**400, 5)},
    ],
)
def test_what_no_option_can_be_is_refused_in_one_sentence(options):
    sentence = refusal(**options)
    assert next(iter(options)) in sentence
    assert len(sentence) < 300


@pytest.mark.parametrize("table", ["needle.csv", None, np.zeros((4, 2))])
def test_what_is_no_table_is_refused(table):
    with pytest.raises(
        sc.InputError, match=r"observations must be a table of sightings .see read_observations.;"
    ):
        sc.calibrate(table)
