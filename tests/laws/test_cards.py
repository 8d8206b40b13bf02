"""What a notebook shows of an object: words and numbers of it, escaped, without scripts, in the page's own ink."""

import dataclasses
import re
import sys
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import sonocal as sc
from sonocal.calibration.in_session import InSession
from sonocal.errors import WORDS
from sonocal.findings import Diagnostic, Findings
from sonocal.geometry.cards import card, dots_svg, heat_svg, matrix_html
from sonocal.recording.thumbnail import thumbnail
from sonocal.report.session import FIGURES, MATRIX, Report
from sonocal.simulation.scene import simulate_observations
from sonocal.validation import give_verdict, validate
from tests.builders.recordings import random_recording

NASTY = '<script>alert("1")</script> & \'"><img src=x onerror=alert(1)>\x00\x1b[31m'
ROWS = {dimension: simulate_observations(dimension, 20, seed=1).observations for dimension in (2, 3)}


@pytest.fixture(scope="module")
def shown():
    rows = ROWS[2].with_sound(source=NASTY, target=np.full(20, NASTY), extra={NASTY: np.full(20, NASTY)})
    finding = Diagnostic(NASTY, "warning", NASTY, NASTY)
    calibration = sc.calibrate(rows).with_findings([finding])
    recording = random_recording(0, n=3, size=(40, 30))
    return {
        "table": rows,
        "calibration": calibration,
        "calibration of a volume": sc.calibrate(ROWS[3]),
        "calibration of two scales": sc.calibrate(ROWS[2], model="anisotropic"),
        "calibration that predicts nothing": dataclasses.replace(calibration, covariance=None),
        "recording": dataclasses.replace(
            recording, provenance=sc.recording.Provenance(NASTY, NASTY), diagnostics=(finding,) * 50
        ),
        "volumes": random_recording(0, n=2, size=(30, 20, 10), dtype="int16"),
        "poses alone": random_recording(0, n=3, size=None),
        "finding": finding,
        "findings": Findings([finding] * 3),
        "no findings": Findings(),
        "verdict": give_verdict(calibration),
        "validation": validate(calibration, rows, resample=False),
        "report": Report(b"<!doctype html><script>alert(1)</script>"),
    }


def assert_is_harmless(html):
    """Well-formed, without scripts, handlers, outside sources or styles for others."""
    tree = ElementTree.fromstring(f"<div>{html}</div>")
    for element in tree.iter():
        name = element.tag.rpartition("}")[2]
        assert name not in {"script", "style", "link", "object", "embed"}, name
        for attribute, value in element.attrib.items():
            assert not attribute.startswith("on"), attribute
            assert attribute not in {"href"}
            assert attribute != "src" or value.startswith("data:image/png;base64,")
            assert "url(" not in value or attribute == "srcdoc"
        assert name != "iframe" or element.attrib["sandbox"] == ""
    return "".join(tree.itertext())


def test_cards_are_harmless_whatever_files_say(shown):
    for name, one in shown.items():
        assert_is_harmless(one._repr_html_())
        assert len(one._repr_html_()) < 40_000, name


def test_cards_take_the_pages_colours(shown):
    for name, one in shown.items():
        if name != "report":
            assert not re.search(
                r"(?<!-)\b(?:background|color):\s*(?:#fff|white|#000|black)", one._repr_html_()
            ), name


def test_a_card_of_a_calibration_says_the_verdict_and_the_numbers(shown):
    for name in ("calibration", "calibration of a volume", "calibration of two scales"):
        one = shown[name]
        text, verdict = assert_is_harmless(one._repr_html_()), give_verdict(one)
        assert verdict.headline in text
        assert verdict.expectation in text
        assert f"{one.probe_from_image.scales[0]:.5g}" in text
        assert f"{one.fit.inliers} of {one.fit.observations}" in text
        assert f"to {one.predicted_errors()[2].max():.1f} mm (95 %)" in text
        for x in one.probe_from_image.matrix.ravel():
            assert f"{x:.6f}" in text
        assert MATRIX in text
        assert one._repr_html_().count("<svg") == 1
    assert "<svg" not in shown["calibration that predicts nothing"]._repr_html_()


def test_a_card_of_a_table_has_a_dot_a_sighting(shown):
    assert shown["table"]._repr_html_().count("<circle") == 20
    many = simulate_observations(2, 5000, seed=2).observations
    assert 150 <= many._repr_html_().count("<circle") <= 300


def test_a_card_of_a_recording_has_a_picture_where_there_are_images(shown):
    assert shown["recording"]._repr_html_().count("data:image/png") == 1
    assert shown["volumes"]._repr_html_().count("data:image/png") == 1
    assert "data:image/png" not in shown["poses alone"]._repr_html_()


@given(st.integers(1, 900), st.integers(1, 900), st.sampled_from(["uint8", "int16", "float32"]))
def test_a_thumbnail_is_small_whatever_the_image(rows, columns, dtype):
    frames = sc.recording.ArrayFrames(np.zeros((3, rows, columns), dtype=dtype))
    assert len(thumbnail(frames, 2)) < 5000


@given(st.text(), st.text(), st.lists(st.tuples(st.text(), st.text()), max_size=3))
def test_a_card_of_any_words_is_harmless(head, text, rows):
    said = assert_is_harmless(card(head, text, rows, below=matrix_html(head, np.eye(4))))
    for words in (head, text, *(word for row in rows for word in row)):
        assert not words.isprintable() or words in said


@given(st.floats(0.1, 1e6), st.floats(0.1, 1e6), st.integers(1, 12), st.integers(0, 2**32))
def test_pictures_stay_in_their_frames(wide, high, count, seed):
    rng = np.random.default_rng(seed)
    area = np.array([[0.0, 0.0], [wide, high]]) + rng.normal(size=2)
    points = area[0] + rng.uniform(size=(count, 2)) * np.ptp(area, axis=0)
    for svg in (dots_svg(area, points, "a"), heat_svg(area, rng.uniform(size=(count, 3)), "b", "a", area)):
        width, height = (float(x) for x in re.search(r'width="([\d.]+)" height="([\d.]+)"', svg).groups())
        assert_is_harmless(svg)
        for x in re.findall(r'\bc?x="([\d.]+)"', svg):
            assert 0 <= float(x) <= width
        for y in re.findall(r'\bcy="([\d.]+)"', svg):
            assert 0 <= float(y) <= height


def test_the_report_of_a_calibration_is_the_page_that_the_command_writes(tmp_path):
    pytest.importorskip("jinja2")
    found = sc.calibrate(ROWS[2])
    page = found.report(ROWS[2])
    assert isinstance(page, sc.report.Report)
    assert page.content.startswith(b"<!doctype html>")
    assert b"by_frame-" in page.content
    assert b"by_frame-" not in found.report().content
    assert page.save(tmp_path / "report.html").read_bytes() == page.content
    assert re.fullmatch(
        r'<Report of \d+ kB: save\("report.html"\) keeps it, to open in a browser>', repr(page)
    )
    with pytest.raises(sc.InputError, match="observations must be a table of sightings"):
        found.report("needle.csv")


@pytest.fixture
def pyplot():
    mpl = pytest.importorskip("matplotlib")
    mpl.use("agg")
    from matplotlib import pyplot as plt

    yield plt
    plt.close("all")


@pytest.mark.parametrize("what", FIGURES)
@pytest.mark.parametrize("dimension", [2, 3])
def test_plot_makes_its_own_axis_or_draws_on_the_one_that_it_is_given(pyplot, what, dimension):
    found = sc.calibrate(ROWS[dimension])
    axis = found.plot(what, ROWS[dimension])
    assert axis.get_title(loc="left") or axis.get_title()
    axis.figure.canvas.draw()
    own = pyplot.figure().add_subplot(projection=FIGURES[what][1])
    assert found.plot(what, ROWS[dimension], axis=own) is own
    assert own.get_title(loc="left") or own.get_title()


def test_plot_names_what_is_wrong(pyplot, monkeypatch):
    found = sc.calibrate(ROWS[2])
    assert found.plot().get_title().startswith("Predicted error")
    with pytest.raises(sc.InputError, match="observations must be given for 'tilts'"):
        found.plot("tilts")
    with pytest.raises(sc.InputError, match="what must be one of predicted_error, "):
        found.plot("matrix")
    with pytest.raises(sc.InputError, match="axis must be an axis of matplotlib"):
        found.plot(axis=3)
    with pytest.raises(sc.InputError, match="observations must be a table"):
        found.plot("tilts", "needle.csv")
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(
        sc.UnsupportedError, match="needs matplotlib, which is not installed; pip install matplotlib"
    ):
        found.plot()
    assert found._repr_html_()  # needs nothing


def test_dir_lists_what_there_is_to_ask():
    found = sc.calibrate(ROWS[2])
    assert {"plot", "report", "predict", "save", "diagnostics", "probe_from_image"} <= set(dir(found))
    assert {"from_dataframe", "to_dataframe", "select", "points_px"} <= set(dir(ROWS[2]))
    assert issubclass(sc.Calibration, InSession)
    assert "Calibration" in WORDS
