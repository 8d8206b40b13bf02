"""Which dot was which wire: counted by wire, drawn into images, and what else would fit said beside it."""

import dataclasses
import re

import numpy as np
import pytest
from benchmarks.simulators import phantoms

import sonocal as sc
from sonocal.calibration.labelled import next_best_in_words
from sonocal.observations import Observations
from sonocal.report import plot_labels, report_html
from sonocal.report.labels import label_section, telling_frames
from sonocal.sweep.choice import calibrate_candidates
from tests.builders.browser import CHROMIUM, opened

NAMES = np.array([f"wire <{i}>" for i in range(1, 7)])


def candidates_of(dots):
    """Each dot against every wire, by frames."""
    order = np.argsort(dots.frame, kind="stable")
    points, frame, count = dots.points[order], dots.frame[order], len(NAMES)
    return Observations(
        frame=np.repeat(frame, count),
        target=np.tile(NAMES, len(points)),
        points_px=np.repeat(points, count, axis=0),
        segments_mm=dots.wires[frame].reshape(-1, 2, 3),
        image_size_px=(500, 500),
    )


@pytest.fixture(scope="module")
def scanned():
    rng = np.random.default_rng(5)
    dots = phantoms.spoilt(rng, phantoms.scan(rng, phantoms.random_wires(rng, len(NAMES)), 20), 0.1, 0.3)
    return dots, calibrate_candidates(candidates_of(dots))


def images_of(dots):
    rng = np.random.default_rng(0)
    return {one: rng.integers(0, 255, (500, 500), dtype=np.uint8) for one in telling_frames(dots)}


def test_every_dot_stands_once_with_the_wire_that_it_is_of(scanned):
    dots, found = scanned
    labels = found.labels
    truth = {(f, *p): t for f, p, t in zip(dots.frame, map(tuple, dots.points), dots.truth, strict=True)}
    of = np.array([truth[(f, *p)] for f, p in zip(labels.frame, map(tuple, labels.points_px), strict=True)])
    assert len(labels.wire) == len(dots.points) == len(truth)
    used = labels.wire >= 0
    assert np.count_nonzero(used) == np.count_nonzero(found.calibration.inlier)
    assert np.count_nonzero(labels.wire[used] != of[used]) <= 0.02 * np.count_nonzero(used)
    assert np.array_equal(used, np.isfinite(labels.residuals_mm))


def test_hits_count_images_and_their_rms_are_the_calibration_s(scanned):
    _, found = scanned
    hits = found.labels.hits(found.calibration)
    assert [one.name for one in hits] == sorted(NAMES)
    assert sum(one.seen for one in hits) == found.used
    squares = sum(one.seen * one.rms_mm**2 for one in hits)
    assert squares == pytest.approx(found.used * found.calibration.fit.rms_mm**2)
    assert all(one.seen <= one.crossed <= 20 for one in hits)


def test_wires_cross_the_images_where_their_dots_are(scanned):
    _, found = scanned
    labels, scale = found.labels, found.calibration.scales_mm_per_px[0]
    for row in np.flatnonzero(labels.wire >= 0):
        met = labels.crossings_px(found.calibration, labels.frame[row])[labels.wire[row]]
        # In the image a dot may be farther from a leaning wire's crossing than from the wire.
        assert scale * np.linalg.norm(met - labels.points_px[row]) < 3 * found.calibration.threshold_mm
    assert np.isnan(labels.crossings_px(found.calibration, 999)).all()


def test_a_wire_that_no_dot_is_of_is_said_to_be_never_seen(scanned):
    _, found = scanned
    lost = found.labels.wire == 2
    labels = dataclasses.replace(
        found.labels,
        wire=np.where(lost, -1, found.labels.wire),
        residuals_mm=np.where(lost, np.nan, found.labels.residuals_mm),
    )
    page = report_html(found.calibration, found.observations, labels=labels).decode()
    row = re.search(r"<td>wire &lt;3&gt;</td>.*?</tr>", page)[0]
    assert "never seen" in row and labels.hits(found.calibration)[2].seen == 0


def test_the_pictures_number_every_dot_that_takes_part(scanned):
    _, found = scanned
    images = images_of(found.labels)
    section = label_section(found.calibration, found.labels, images)
    assert len(section.pictures) == len(images) == 6
    for (title, svg), frame in zip(section.pictures, images, strict=True):
        here = found.labels.frame == frame
        used = here & (found.labels.wire >= 0)
        assert title == f"frame {frame}"
        assert svg.count('class="found"') == np.count_nonzero(used)
        assert svg.count('class="unused"') == np.count_nonzero(here & ~used)
        numbers = re.findall(r'class="named of-found">(\d+)</text>', svg)
        assert sorted(map(int, numbers)) == sorted(found.labels.wire[used] + 1)
        assert "wire &lt;" in svg and "wire <" not in svg


def test_the_page_says_what_is_next_best_and_which_view_would_tell(scanned):
    _, found = scanned
    page = report_html(
        found.calibration, found.observations, labels=found.labels, images=images_of(found.labels)
    ).decode()
    assert page.index("Which dot is which wire") < page.index("The matrix")
    second = found.labels.association.second
    assert second is not None and second.view in page and second.view_apart_mm > 0
    assert next_best_in_words(found.labels.association)[1:] in page
    alone = dataclasses.replace(found.labels.association, second=None)
    assert next_best_in_words(alone) == "no other labelling comes near"


def test_labels_of_a_needle_have_no_part_of_the_page(scanned):
    _, found = scanned
    assert "Which dot" not in report_html(found.calibration, found.observations).decode()


def test_labels_draw_on_any_axis(scanned):
    pytest.importorskip("matplotlib")
    from matplotlib.figure import Figure

    _, found = scanned
    axis = Figure().add_subplot()
    frame, image = next(iter(images_of(found.labels).items()))
    plot_labels(axis, found.calibration, found.labels, frame, image)
    used = (found.labels.frame == frame) & (found.labels.wire >= 0)
    assert len(axis.texts) >= np.count_nonzero(used)
    with pytest.raises(sc.InputError, match="dots"):
        plot_labels(axis, found.calibration, "labels", frame, image)


@pytest.mark.skipif(CHROMIUM is None, reason="no browser")
def test_the_page_is_as_wide_as_its_window(scanned, tmp_path):
    _, found = scanned
    page = tmp_path / "report.html"
    page.write_bytes(
        report_html(
            found.calibration, found.observations, labels=found.labels, images=images_of(found.labels)
        )
    )
    seen = opened(page)
    assert not seen.requests[1:] and not seen.troubles
    assert seen.overflow <= 0 and seen.narrow <= 0
