"""Whoever gives a function something else than it takes reads which argument it was, and where one comes from."""

import importlib
import inspect
import pkgutil

import numpy as np
import pytest

import sonocal as sc
from sonocal.errors import WORDS
from sonocal.simulation.scene import simulate_observations
from tests.builders.recordings import random_recording

ROWS = simulate_observations(2, 20, seed=1).observations
LINES = [sc.Line("needle", "Needle", np.array([[0.0, 0, 0], [0, 0, -100]]))]
# Called a thousand times on what was checked by those above them, or of what they return themselves.
INSIDE = {
    *("evidence_of", "fit_rows", "line_distances", "point_line_rows", "health", "join_several"),
    *("interpolate_poses", "motion_signal", "errors_of", "answer_sentences", "summarise"),
    *(
        "leave_one_frame_out",
        "leave_one_target_out",
        "repeatability",
        "nwire_error",
        "nwire_errors",
        "pivot_doubts",
    ),
    *("digitise_point", "fit_crosswire", "rank", "detect_line_near"),
}
OURS = {"Calibration", "Detections", "Observations", "PointSightings", "Recording", "Rows", "Study"}
WRONG = ["needle.csv", None, 3, [1.0, 2.0], {"a": 1}, np.eye(4)]


def public_functions():
    rooms = [module.name for module in pkgutil.walk_packages(sc.__path__, "sonocal.") if module.ispkg]
    faces = [importlib.import_module(name) for name in ("sonocal", *rooms) if ".cli" not in name]
    named = {
        (name, getattr(face, name))
        for face in faces
        for name in getattr(face, "__all__", ())
        if inspect.isfunction(getattr(face, name))
    }
    return sorted((one for one in named if not inspect.isgeneratorfunction(one[1])), key=lambda one: one[0])


def first_of(function):
    return next(iter(inspect.signature(function).parameters.values()), None)


def takes_ours(name, function):
    first = first_of(function)
    return (
        first
        and first.annotation in OURS
        and first.kind is first.POSITIONAL_OR_KEYWORD
        and name not in INSIDE
    )


def takes_a_name(name, function):
    first = first_of(function)
    return (
        first and first.name == "path" and "str" in str(first.annotation) and name != "writing"
    )  # a context


OF_OURS = [one for one in public_functions() if takes_ours(*one)]
OF_FILES = [one for one in public_functions() if takes_a_name(*one)]


def sentence_of(call, *arguments, **options):
    with pytest.raises(sc.InputError) as refused:
        call(*arguments, **options)
    return str(refused.value)


@pytest.mark.parametrize(("name", "function"), OF_OURS, ids=lambda one: one if isinstance(one, str) else "")
def test_the_first_argument_is_named_and_what_it_must_be(name, function):
    parameters = inspect.signature(function).parameters.values()
    needed = [one for one in parameters if one.default is one.empty and one.kind is one.POSITIONAL_OR_KEYWORD]
    keywords = {
        one.name: None for one in parameters if one.default is one.empty and one.kind is one.KEYWORD_ONLY
    }
    first = first_of(function)
    for wrong in WRONG:
        said = sentence_of(function, *[wrong] * len(needed), **keywords)
        assert said.startswith(f"{first.name} must be "), name
        assert WORDS.get(first.annotation, first.annotation) in said
        assert len(said) <= 200


@pytest.mark.parametrize(("name", "function"), OF_FILES, ids=lambda one: one if isinstance(one, str) else "")
def test_a_path_that_is_none_is_named(name, function):
    needed = [one for one in inspect.signature(function).parameters.values() if one.default is one.empty]
    for wrong in (None, 3, b"x", [1]):
        assert sentence_of(function, *[wrong] * len(needed)).startswith("path must be "), name


def test_enough_functions_are_tried():
    assert len(OF_OURS) > 15 < len(OF_FILES) + 8
    assert {name for name, _ in OF_OURS} >= {
        "calibrate",
        "calibrate_recording",
        "write_recording",
        "validate",
        "register",
    }
    assert {name for name, _ in public_functions()} >= INSIDE


CALIBRATION, RECORDING = sc.calibrate(ROWS), random_recording(0, n=3, size=(5, 4))
CALLS = {
    "lines must be": lambda: sc.calibrate_recording(RECORDING, 3),
    "lines must be a list of lines": lambda: sc.calibrate_recording(RECORDING, ["needle.toml"]),
    "detections must be": lambda: sc.calibrate_recording(RECORDING, LINES, detections="points.csv"),
    "observations must be": lambda: sc.write_observations("a.csv", "b.csv"),
    "recording must be": lambda: sc.write_recording("a.mha", "b.mha"),
    "path must be the": lambda: sc.write_observations(ROWS, 3),
    "path must be the name": lambda: CALIBRATION.save(3),
    "points_px must be": lambda: CALIBRATION.predict("a"),
    "observations must be a": lambda: sc.validation.validate(CALIBRATION, "a"),
    "second must be": lambda: sc.validation.compare(CALIBRATION, "a"),
    "matrix must be": lambda: sc.Similarity.from_matrix("a"),
    "rotation must be": lambda: sc.Similarity("a", np.zeros(3), 1.0),
    "source must be": lambda: RECORDING.tool(3),
    "rows must be": lambda: RECORDING.select("a"),
    "threshold_mm must be": lambda: sc.calibrate(ROWS, threshold_mm="5"),
    "image_size_px must be": lambda: sc.calibrate(ROWS, image_size_px="640x480"),
    "seed must be": lambda: sc.calibrate(ROWS, seed=1.5),
    "model must be": lambda: sc.calibrate(ROWS, model=3),
    "sigma_px must be": lambda: sc.calibrate(ROWS, sigma_px="1"),
    "expected_rotation must be": lambda: sc.calibrate(ROWS, expected_rotation="up"),
    "scanner_mm_per_px must be": lambda: sc.calibrate(ROWS, scanner_mm_per_px="a"),
}


@pytest.mark.parametrize("words", CALLS)
def test_other_arguments_are_named(words):
    assert words in sentence_of(CALLS[words])
