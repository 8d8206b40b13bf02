"""The report says of any calibration what every other door says, with the threshold that was used."""

import dataclasses
import html
import io
import re

import numpy as np
import pytest
from rich.console import Console

import sonocal as sc
from sonocal.calibration import calibration_json, parse_calibration
from sonocal.cli.screen.calibration import print_calibration
from sonocal.registration.lazy import Lazy
from sonocal.registration.uncertainty import quantile_95
from sonocal.report import plot_residuals_by_frame, plot_residuals_over_image, plot_tilts, report_html
from sonocal.report.templates import EXPLAINED
from sonocal.simulation.scene import simulate_observations
from sonocal.validation import give_verdict, validate
from tests.builders.calibrations import parted_rows, slipped_rows


def page(*arguments):
    return html.unescape(report_html(*arguments).decode())


def typeset(sentence):
    return sentence.replace("+-", "±")


def shown(text):
    """The verdict, what to expect and the reasons of a page."""
    block = text[text.index('<div class="verdict') : text.index("</div>")]
    reasons = re.findall(r"<li>(.*?)\. <span", block)
    return re.search(r"<strong>(.*?)</strong>\s*<p>(.*?)</p>", block).groups(), reasons


def scans():
    outliers = simulate_observations(2, 40, outlier_share=0.3, seed=2).observations
    return {
        "outliers": (outliers, {}),
        "auto": (outliers, {"threshold_mm": "auto"}),
        "slipped": (slipped_rows(), {}),
        "held out": (parted_rows(moved_mm=4.0), {"test_split": "test"}),
        "3D": (simulate_observations(3, 12, seed=2).observations, {"threshold_mm": "auto"}),
    }


@pytest.mark.parametrize("name", ["outliers", "auto", "slipped", "held out", "3D"])
def test_the_report_gives_the_one_verdict_with_its_reasons_with_and_without_rows(name):
    rows, options = scans()[name]
    found = sc.calibrate(rows, **options)
    verdict = give_verdict(found)
    expected = (
        (verdict.headline, verdict.expectation),
        [typeset(r[0].upper() + r[1:]) for r in verdict.reasons],
    )
    whole = page(found, rows, validate(found, rows, resample=False))
    assert shown(whole) == expected
    assert shown(page(found)) == expected


@pytest.mark.parametrize("name", ["outliers", "auto", "slipped", "held out", "3D"])
def test_a_finding_is_told_once_with_the_section_that_explains_it(name):
    rows, options = scans()[name]
    found = sc.calibrate(rows, **options)
    whole = page(found, rows, validate(found, rows, resample=False))
    for finding in found.diagnostics:
        assert whole.count(f'title="{finding.anchor}">{finding.code}<') == 1
        assert whole.count(typeset(finding.message[1:])) == whole.count(typeset(finding.advice[1:])) == 1
    assert whole.count(EXPLAINED) == bool(found.diagnostics)


@pytest.mark.parametrize("threshold_mm", [3.0, 5.0, "auto"])
def test_rows_beyond_the_threshold_that_was_used_are_marked(threshold_mm):
    from matplotlib.figure import Figure

    rows, _ = scans()["outliers"]
    found = sc.calibrate(rows, threshold_mm=threshold_mm)
    axis = Figure().add_subplot()
    plot_residuals_by_frame(axis, found, rows)
    drawn = {line.get_label(): len(line.get_xdata()) for line in axis.get_lines()}
    assert drawn["rows"] == found.fit.inliers
    assert drawn[f"beyond {found.threshold_mm:g} mm"] == len(rows) - found.fit.inliers


def test_the_rms_is_on_the_axis_where_all_rows_are_far_off():
    from matplotlib.figure import Figure

    rows, _ = scans()["outliers"]
    found = sc.calibrate(rows)
    axis = Figure().add_subplot()
    plot_residuals_by_frame(axis, found, dataclasses.replace(rows, segments_mm=rows.segments_mm + 500.0))
    assert found.fit.rms_mm < axis.get_ylim()[1]


def test_figures_of_a_file_read_back_are_the_same():
    from matplotlib.figure import Figure

    rows, options = scans()["auto"]
    found = sc.calibrate(rows, **options)
    again = parse_calibration(calibration_json(found), "c.json")
    drawn = []
    for one in (found, again):
        axes = [Figure().add_subplot(), Figure().add_subplot(projection="polar")]
        plot_residuals_over_image(axes[0], one, rows)
        plot_tilts(axes[1], one, rows)
        arrows = axes[0].collections[0]
        drawn.append(np.column_stack([arrows.U, arrows.V]))
        assert len(axes[1].get_lines()[0].get_xdata()) == one.fit.inliers
    np.testing.assert_allclose(*drawn, atol=1e-9)


def test_what_other_rows_say_stands_in_the_verdict_and_among_the_findings():
    rows = simulate_observations(2, 40, seed=2).observations
    found = sc.calibrate(rows, image_size_px=(500, 500))
    other = dataclasses.replace(
        rows, segments_mm=rows.segments_mm + np.array([4.0, 4, 4]), source="later.csv"
    )
    text = page(found, other, validate(found, other))
    assert shown(text)[0][0] != "Use it"
    assert text.count(">held-out-rows-off<") == 1


@pytest.mark.parametrize("needles", [8, 50])
def test_the_scale_has_one_uncertainty_wherever_it_is_told(needles):
    rows = simulate_observations(2, needles, seed=4).observations
    found = sc.calibrate(rows, image_size_px=(500, 500))
    # The image grows about its centre, and little else is loose: then the loosest motion is the scale.
    transform = found.probe_from_image
    centre = (transform @ [[250.0, 250.0]])[0] - transform.translation
    growth = np.r_[0, 0, 0, -0.03 * centre, 0.03]
    loose = dataclasses.replace(
        found,
        covariance=np.outer(growth, growth) + 1e-6 * np.eye(7),
        diagnostics=(),
        _models=Lazy(tuple),  # which tell how far axes are apart, another number
    )
    text = page(loose)
    screen = io.StringIO()
    print_calibration(Console(file=screen, width=200), loose)
    told = re.findall(r"(?:±|\+-) ?([\d.]+) %", text + screen.getvalue())
    assert len(told) == 3
    assert set(told) == {f"{100 * quantile_95(found.noise.freedom) * (0.03**2 + 1e-6) ** 0.5:.2g}"}
    assert "+-" not in text


@pytest.mark.parametrize("seed", range(4))
def test_no_arrow_of_a_residual_leaves_its_axis(seed):
    from matplotlib.figure import Figure

    rows = simulate_observations(2, 40, outlier_share=0.3, seed=seed).observations
    axis = Figure().add_subplot()
    plot_residuals_over_image(axis, sc.calibrate(rows), rows)
    arrows = axis.collections[0]
    tips = arrows.get_offsets() + np.column_stack([arrows.U, arrows.V]) / arrows.scale
    for ends, limits in zip(tips.T, (axis.get_xlim(), axis.get_ylim()), strict=True):
        assert min(limits) <= ends.min()
        assert ends.max() <= max(limits)


def test_both_outlines_of_the_loosest_motion_are_named():
    text = page(sc.calibrate(scans()["outliers"][0]))
    assert "moved one way" in text
    assert "and the other" in text
