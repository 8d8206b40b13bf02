"""The report: words first, self-contained, opened in a browser; its figures on any axis."""

import dataclasses
import re
import sys

import numpy as np
import pytest

import sonocal as sc
from sonocal import report
from sonocal.calibration.area import in_mm
from sonocal.calibration.diagnostics import Diagnostic
from sonocal.geometry import (
    AxisScaled,
    needle_in_image,
    needle_in_volume,
)
from sonocal.report import (
    FrameImage,
    report_html,
)
from sonocal.report.pictures import (
    MOST_PICTURES,
    picture_svg,
)
from sonocal.simulation.scene import simulate_observations
from sonocal.validation import compare, give_verdict, validate
from tests.builders.browser import CHROMIUM, opened

# Of the task: a page that opens at once and goes through any mail.
MOST_BYTES = 3_000_000


@pytest.fixture(scope="module")
def scan():
    rows = simulate_observations(2, 60, outlier_share=0.1, seed=1).observations
    rows = dataclasses.replace(
        rows, split=np.where(np.arange(60) < 40, "fit", "test"), source="needle <b>.csv"
    )
    return rows, sc.calibrate(rows, fit_split="fit", test_split="test", image_size_px=(500, 500))


def frames_of(rows, count):
    image = np.random.default_rng(0).integers(0, 255, (120, 160), dtype=np.uint8)
    return [
        FrameImage(image, rows.points_px[i : i + 1] / 4, rows.segments_mm[i : i + 1], f"frame {i}")
        for i in range(count)
    ]


@pytest.fixture(scope="module")
def page(scan):
    rows, found = scan
    other = sc.calibrate(rows.select_split("test"))
    return report_html(
        found, rows, validate(found, rows), comparison=compare(found, other), frames=frames_of(rows, 20)
    ).decode()


def test_the_verdict_stands_before_all_numbers_and_the_matrix_after(page):
    body = page[page.index("<body>") :]
    order = [
        body.index(words) for words in ("Use it", "How far off it is", "Where in the image", "The matrix")
    ]
    assert order == sorted(order)
    assert "Expect errors of the calibration up to " in body[: order[1]]


def test_the_page_holds_every_part(page):
    for words in (
        "Held-out rows", "Leave one frame out", "Repeatability, corners", "Predicted error over the image",
        "Arrows in all directions are noise", "Residuals by frame", "Needle poses through the image", "Needle tilts",
        "Loosest motion", "The matrix drawn", "Against the other calibration", "Provenance", "threshold mm",
    ):  # fmt: skip
        assert words in page, words
    assert page.count('class="picture"') == MOST_PICTURES


def test_every_column_has_its_unit_and_the_title_what_was_scanned(page, scan):
    for words in ("median, mm", "95 % below, mm", "max, mm", "error, mm", "spread, mm", "95 % interval, mm"):
        assert f">{words}</th>" in page
    assert re.search(r"\d+ errors<br><small>in \d+ independent frames", page)
    assert f"<td>page written by</td><td>sonocal {sc.__version__}</td>" in page
    _, found = scan
    kept = found.provenance | {"recorded": {"recording": {"input": "sweep.igs.mha"}}}
    of_recording = report_html(dataclasses.replace(found, provenance=kept)).decode()
    assert "<title>Probe calibration from sweep.igs.mha: " in of_recording
    assert "<h1>Probe calibration from sweep.igs.mha, " in of_recording


def test_what_is_not_known_to_be_the_image_is_called_the_area_seen():
    rows = simulate_observations(2, 20, seed=3).observations.with_sound(image_size_px=None)
    page = report_html(sc.calibrate(rows), rows).decode()
    assert "Where in the area seen" in page
    assert page.count("Predicted error over the area seen") == 2
    assert "Predicted error over the image" not in page


def test_nothing_is_fetched_and_names_are_not_markup(page):
    assert len(page) < MOST_BYTES
    references = re.findall(r'(?:href|src)="([^"]*)"', page) + re.findall(r"url\(([^)]*)\)", page)
    assert all(reference.startswith(("#", "data:")) for reference in references)
    assert "<script" not in page
    assert "needle <b>" not in page
    assert "needle &lt;b&gt;.csv" in page


def test_ids_are_not_shared_between_figures(page):
    ids = re.findall(r' id="([^"]*)"', page)
    assert len(ids) == len(set(ids))
    assert {reference[1:] for reference in re.findall(r'href="(#[^"]*)"', page)} <= set(ids)


@pytest.mark.parametrize(("dimension", "needles"), [(2, 4), (2, 12), (3, 12)])
def test_any_calibration_has_a_report(dimension, needles):
    rows = simulate_observations(dimension, needles, seed=3).observations
    found = sc.calibrate(rows)
    page = report_html(found, rows, validate(found, rows)).decode()
    assert "The matrix drawn" in page
    assert "Predicted error over the image" in page
    assert "nan" not in page.lower().replace("provenance", "")


def test_a_calibration_alone_and_one_with_other_rows_have_one_too(scan):
    _, found = scan
    assert "Residuals by frame" not in report_html(found).decode()
    other = simulate_observations(2, 20, seed=8).observations
    assert "Residuals by frame" in report_html(found, other, validate(found, other)).decode()


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium; apt install chromium")
def test_a_browser_opens_it_without_a_request_or_an_error(page, tmp_path):
    (tmp_path / "report.html").write_text(page, encoding="utf-8")
    shown = opened(tmp_path / "report.html")
    assert shown.requests == [(tmp_path / "report.html").as_uri()]
    assert shown.troubles == []
    assert shown.overflow <= 0
    assert shown.narrow <= 1  # borders are rounded
    assert shown.printed.startswith(b"%PDF")


# The verdict


def with_finding(calibration, code, severity="warning"):
    finding = Diagnostic(code=code, severity=severity, message="something was found", advice="do something")
    return dataclasses.replace(calibration, diagnostics=(finding,))


@pytest.fixture(scope="module")
def sound():
    rows = simulate_observations(2, 60, seed=1).observations
    return sc.calibrate(rows, image_size_px=(500, 500))


def test_a_sound_calibration_is_for_use(sound):
    assert sound.warnings == ()
    verdict = give_verdict(sound)
    assert (verdict.level, verdict.headline, verdict.reasons) == ("use", "Use it", ())
    worst, centre = sound.predicted_errors()[2][:-1].max(), sound.predicted_errors()[2][-1]
    assert verdict.expectation == (
        f"Expect errors of the calibration up to {in_mm(worst)} mm at the image's corners and {in_mm(centre)} mm at "
        "its centre (95 %)."
    )


@pytest.mark.parametrize(
    ("code", "severity", "level"),
    [
        ("weak-motion", "warning", "care"),
        ("marker-slipped", "warning", "stop"),
        ("flipped-image", "warning", "stop"),
        ("shared-frame-error", "info", "use"),
    ],
)
def test_findings_weigh_as_they_should(sound, code, severity, level):
    verdict = give_verdict(with_finding(sound, code, severity))
    assert verdict.level == level
    assert verdict.reasons == (("something was found; do something",) if level != "use" else ())


def without_covariance():
    return dataclasses.replace(
        sc.calibrate(simulate_observations(2, 4, seed=3).observations), covariance=None
    )


def test_no_error_to_predict_is_no_calibration_to_use():
    verdict = give_verdict(without_covariance())
    assert (verdict.level, verdict.expectation) == ("stop", "No error can be predicted.")


def test_an_error_far_beyond_what_is_accepted_stops(sound):
    rows = simulate_observations(2, 60, seed=1).observations
    strict = sc.calibrate(rows, image_size_px=(500, 500), tolerance_mm=0.1)
    assert give_verdict(strict).level == "stop"


def test_held_out_rows_that_are_worse_than_explained_call_for_care(sound):
    other = simulate_observations(2, 40, seed=1).observations
    moved = dataclasses.replace(
        other, segments_mm=other.segments_mm + np.array([2.5, 2.5, 2.5]), source="later.csv"
    )
    verdict = give_verdict(sound, validate(sound, moved))
    assert verdict.level == "care"
    assert verdict.reasons[0].startswith("held-out rows are off by ")


# Figures and pictures


def test_figures_draw_on_a_given_axis_and_leave_the_global_state_alone(scan):
    import matplotlib as mpl
    from matplotlib.figure import Figure

    rows, found = scan
    before = dict(mpl.rcParams)
    figure = Figure()
    report.plot_predicted_error(figure.add_subplot(331), found, rows)
    report.plot_residuals_over_image(figure.add_subplot(332), found, rows)
    report.plot_residuals_by_frame(
        figure.add_subplot(333), found, rows.select_split("fit"), rows.select_split("test")
    )
    report.plot_tilts(figure.add_subplot(334, projection="polar"), found, rows)
    for place, plot in enumerate((report.plot_frames, report.plot_weak_motion), start=5):
        plot(figure.add_subplot(3, 3, place, projection="3d"), found)
    report.plot_needles(figure.add_subplot(337, projection="3d"), found, rows)
    report.plot_frame(figure.add_subplot(338), found, frames_of(rows, 1)[0])
    assert all(
        axis.get_title(loc="left") or axis.get_title()
        for axis in figure.axes
        if axis.get_label() != "<colorbar>"
    )
    assert dict(mpl.rcParams) == before


def test_a_matrix_of_other_software_is_drawn_where_it_puts_the_image_beside_ours(scan):
    from matplotlib.figure import Figure

    _, found = scan
    theirs = AxisScaled(np.eye(3), np.array([5.0, -7, 90]), np.array([0.2, 0.3, 0.25]))
    axis = Figure().add_subplot(projection="3d")
    report.plot_matrix(axis, theirs, found.area_px, found)
    lines = {line.get_label(): np.array(line.get_data_3d()).T for line in axis.lines}
    (left, top), (right, bottom) = found.area_px
    corners = np.array([(left, top), (right, top), (right, bottom), (left, bottom), (left, top)])
    np.testing.assert_allclose(lines["this matrix"], theirs @ corners)
    np.testing.assert_allclose(lines["our own calibration"], found.probe_from_image @ corners)
    alone = Figure().add_subplot(projection="3d")
    report.plot_matrix(alone, theirs, found.area_px)
    assert [line.get_label() for line in alone.lines].count("our own calibration") == 0


def test_the_map_shows_the_predicted_error(scan):
    from matplotlib.figure import Figure

    _, found = scan
    axis = Figure().add_subplot()
    report.plot_predicted_error(axis, found)
    (drawn,) = [c for c in axis.collections if c.get_array() is not None]
    below = found.predicted_errors()[2]
    low, high = drawn.get_clim()
    assert low <= below[-1] < below[:-1].max() <= high * 1.2
    assert axis.get_ylim()[0] > axis.get_ylim()[1]  # v points down


def test_without_covariance_there_is_no_map():
    from matplotlib.figure import Figure

    found = without_covariance()
    assert "Predicted error over the image" not in report_html(found).decode()
    with pytest.raises(sc.UnsupportedError):
        report.plot_predicted_error(Figure().add_subplot(), found)
    with pytest.raises(sc.UnsupportedError, match="no weakest motion"):
        report.plot_weak_motion(Figure().add_subplot(projection="3d"), found)


def test_the_needle_is_drawn_where_it_crosses_the_image():
    scene = simulate_observations(2, 20, sigma_px=0, sigma_mm=0, seed=2)
    found = sc.calibrate(scene.observations)
    crossing = needle_in_image(found.probe_from_image, scene.observations.segments_mm)
    np.testing.assert_allclose(crossing, scene.observations.points_px, atol=1e-6)
    above_the_image = (found.probe_from_image @ np.array([[0.0, 0, 20], [100, 0, 20]]))[None]
    met = needle_in_image(found.probe_from_image, above_the_image)
    assert np.isnan(met).all() or np.abs(met).max() > 1e6


def test_the_needle_in_a_volume_passes_through_its_points_and_ends_at_the_walls():
    scene = simulate_observations(3, 20, sigma_px=0, sigma_mm=0, seed=2)
    rows = scene.observations
    found = sc.calibrate(rows, image_size_px=(500, 500, 500))
    start, end = np.moveaxis(needle_in_volume(found.probe_from_image, found.area_px, rows.segments_mm), 1, 0)
    along = (end - start) / np.linalg.norm(end - start, axis=1, keepdims=True)
    away = rows.points_px - start
    np.testing.assert_allclose(away - np.sum(away * along, axis=1, keepdims=True) * along, 0, atol=1e-5)
    ends = np.stack([start, end])
    assert np.all((ends > -1e-6) & (ends < 499 + 1e-6))
    # The needle of 400 mm is longer than the volume's sides of 120 mm: one end or both are at a wall.
    at_wall = np.any(np.isclose(ends, 0, atol=1e-6) | np.isclose(ends, 499, atol=1e-6), axis=2)
    assert np.all(at_wall.any(axis=0))
    beside = rows.segments_mm + 1000.0 * found.probe_from_image.rotation[:, 0]
    assert np.isnan(needle_in_volume(found.probe_from_image, found.area_px, beside)).all()


def test_pictures_of_volumes_show_each_needle_once_as_a_line():
    scene = simulate_observations(3, 20, seed=2)
    found = sc.calibrate(scene.observations, image_size_px=(500, 500, 500))
    here = scene.observations.select(scene.observations.frame == 3)
    frame = FrameImage(np.zeros((500, 500), dtype=np.uint8), here.points_px, here.segments_mm, "frame 3")
    drawn = picture_svg(found, frame)
    assert drawn.count("<circle") == len(here) == 2
    (path,) = re.findall(r'<path d="M([^"]*)"', drawn)
    first, last = (np.array(place.split(), dtype=float) for place in path.split("L"))
    direction = (last - first) / np.linalg.norm(last - first)
    away = here.points_px[:, :2] - first
    assert np.abs(away @ [-direction[1], direction[0]]).max() < 10  # px, with the noise of the sighting


def test_a_missing_library_is_said_with_the_remedy(scan, monkeypatch):
    monkeypatch.setitem(sys.modules, "jinja2", None)
    with pytest.raises(sc.UnsupportedError, match=r"pip install matplotlib jinja2, or --no-report"):
        report_html(scan[1])
