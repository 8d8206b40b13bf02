"""Targets that were found with the calibration, drawn in their own frame."""

import dataclasses

import numpy as np
import pytest
from benchmarks.simulators.places import Noise, sweep
from matplotlib.figure import Figure

import sonocal as sc
from sonocal.calibration.found_targets import target_in_words
from sonocal.report import plot_place, report_html
from sonocal.targets import Unplaced
from tests.builders.tank import unplaced_table

NAME = "it <b> $x$"


def found_of(kind, said=None):
    scene = sweep(kind, 40, 3, Noise())
    place = None if said is None else scene.place + said
    sigmas = {} if said is None else {"sigma_mm": 1.0, "sigma_deg": 1.0}
    target = Unplaced(kind, NAME, "Tracker", place, **sigmas)
    return sc.calibrate(unplaced_table(scene, NAME), targets=(target,))


@pytest.mark.parametrize("kind", ["point", "line", "plane"])
def test_a_place_is_drawn_as_well_as_it_is_known(kind):
    found = found_of(kind)
    axis = Figure().add_subplot()
    plot_place(axis, found, NAME)
    (label,) = {line.get_label() for line in axis.lines if line.get_label().startswith("found")}
    sigma = found.targets[NAME].sigma_mm
    if kind == "point":
        outline = np.array(axis.lines[0].get_data())
        assert np.linalg.norm(outline, axis=0).max() == pytest.approx(2.4477 * sigma, rel=1e-2)
        assert label == "found, 95 %"
    else:
        (band,) = axis.collections
        edge = band.get_paths()[0].vertices
        least = np.abs(edge[:, 1]).min() if kind == "plane" else np.abs(edge[np.abs(edge[:, 0]) < 2, 1]).min()
        assert least <= 1.96 * sigma * 1.01
        assert np.abs(edge[:, 1]).max() > least  # a direction is known to a part only


def test_where_it_was_said_to_be_is_drawn_beside_and_told():
    near, far = (found_of("line", np.array([0.0, 0, off])) for off in (0.3, 8.0))
    assert ", which agrees (" in target_in_words(NAME, near.targets[NAME])
    assert ", which disagrees (" in target_in_words(NAME, far.targets[NAME])
    axis = Figure().add_subplot()
    plot_place(axis, far, NAME)
    (line,) = [one for one in axis.lines if one.get_label() == "where it was said to be"]
    where, off = line.get_data()
    said_off = np.interp(0.0, where, off)
    # What is shown is the direction in which it is furthest off.
    assert abs(said_off) == pytest.approx(far.targets[NAME].said_off_mm, rel=0.1)


def test_the_report_draws_them_and_names_them_safely():
    page = report_html(found_of("plane", 0.2)).decode()
    assert "What was scanned, where it was found" in page
    assert "it &lt;b&gt;" in page
    assert "it <b>" not in page.split("<svg")[0]


def test_a_target_that_was_not_found_is_refused():
    found = dataclasses.replace(found_of("point"))
    with pytest.raises(sc.InputError, match="found no target 'other'; its targets are: it"):
        plot_place(Figure().add_subplot(), found, "other")
