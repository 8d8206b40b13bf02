"""The one verdict: monotone in everything it weighs, and the same through every door."""

import dataclasses
import html
import json
from xml.etree import ElementTree

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

import sonocal as sc
from sonocal.calibration.held_out import FAR
from sonocal.cli.main import main
from sonocal.export.itk import itk_tfm
from sonocal.export.plus import plus_xml
from sonocal.findings import Diagnostic, reading_order
from sonocal.simulation.scene import simulate_observations
from sonocal.validation import Validation, give_verdict, validate
from sonocal.validation.verdict import HEADLINES, SPOILING
from tests.builders.calibrations import parted_rows, slipped_rows, sound_calibration

LEVELS = list(HEADLINES)  # from the best to the worst
CODES = [*sorted(SPOILING), "weak-motion", "many-outliers", "latency", "held-out-rows-off", "anything-new"]
findings = st.lists(
    st.builds(
        Diagnostic,
        code=st.sampled_from(CODES),
        severity=st.sampled_from(["warning", "info"]),
        message=st.just("something was found"),
        advice=st.just("do something"),
    ),
    max_size=5,
)


def rank(verdict):
    return LEVELS.index(verdict.level)


def with_found(found, *parts):
    return dataclasses.replace(found, diagnostics=tuple(one for part in parts for one in part))


def less_sure(found, factor):
    return dataclasses.replace(found, covariance=found.covariance * factor**2)


@given(findings, findings)
def test_more_findings_never_make_it_better(some, more):
    found = sound_calibration()
    less, all_of_them = with_found(found, some), with_found(found, some, more)
    assert rank(give_verdict(less)) <= rank(give_verdict(all_of_them))


@given(findings, st.floats(0.1, 20), st.floats(0.1, 20))
def test_a_larger_predicted_error_never_makes_it_better(some, one, other):
    found = with_found(sound_calibration(), some)
    less, more = sorted([one, other])
    assert rank(give_verdict(less_sure(found, less))) <= rank(give_verdict(less_sure(found, more)))


@given(findings, st.floats(0.05, 10), st.floats(0.05, 10))
def test_who_accepts_more_never_gets_a_worse_one(some, one, other):
    found = with_found(sound_calibration(), some)
    strict, lenient = (
        dataclasses.replace(found, options=dataclasses.replace(found.options, tolerance_mm=mm))
        for mm in sorted([one, other])
    )
    assert rank(give_verdict(lenient)) <= rank(give_verdict(strict))


@given(findings, findings)
def test_it_does_not_matter_who_found_it(own, others):
    found = sound_calibration()
    together = give_verdict(with_found(found, own, others))
    assert give_verdict(with_found(found, own), Validation((), tuple(others))) == together


@given(findings, st.permutations(range(5)))
def test_the_order_of_findings_changes_no_level(some, order):
    found = sound_calibration()
    shuffled = [some[i] for i in order if i < len(some)]
    one, other = give_verdict(with_found(found, some)), give_verdict(with_found(found, shuffled))
    assert (one.level, sorted(one.codes)) == (other.level, sorted(other.codes))


@given(findings)
def test_each_warning_is_a_reason_with_its_code_and_nothing_else_is(some):
    verdict = give_verdict(with_found(sound_calibration(), some))
    warned = [finding.code for finding in some if finding.severity == "warning"]
    assert list(verdict.codes) == sorted(warned, key=reading_order)
    assert verdict.reasons == ("something was found; do something",) * len(warned)
    assert (verdict.level == "use") == (not warned)
    assert (verdict.level == "stop") == bool(SPOILING & set(warned))
    assert verdict.headline == HEADLINES[verdict.level]


@given(findings, st.floats(0.1, 20))
def test_what_names_a_cause_leads_and_what_it_does_comes_last(some, factor):
    codes = give_verdict(less_sure(with_found(sound_calibration(), some), factor)).codes
    assert list(codes) == sorted(codes, key=reading_order)
    if "marker-slipped" in codes and codes[-1] in ("weak-motion", "predicted-error-beyond-tolerance"):
        assert codes.index("marker-slipped") < codes.index(codes[-1])


@given(findings, st.floats(0.1, 20))
def test_the_remark_is_a_line_that_any_comment_holds(some, factor):
    verdict = give_verdict(less_sure(with_found(sound_calibration(), some), factor))
    assert verdict.headline in verdict.remark
    assert verdict.expectation in verdict.remark
    assert all(code in verdict.remark for code in verdict.codes)
    assert not {"\n", "--", "<", ">"} & {verdict.remark[i : i + n] for i in range(999) for n in (1, 2)}


def test_it_stops_just_beyond_what_is_hopeless():
    found = sound_calibration()
    worst = float(found.predicted_errors()[2][:-1].max())

    def accepted(mm):
        options = dataclasses.replace(found.options, tolerance_mm=mm)
        return give_verdict(dataclasses.replace(found, options=options))

    assert accepted(1.001 * worst / FAR).level == "use"
    stopped = accepted(0.999 * worst / FAR)
    assert (stopped.level, stopped.codes) == ("stop", ("predicted-error-beyond-tolerance",))
    assert stopped.reasons[0].startswith("the predicted error is over 3 times the ")


def test_without_a_predicted_error_there_is_nothing_to_use():
    verdict = give_verdict(dataclasses.replace(sound_calibration(), covariance=None))
    assert (verdict.level, verdict.codes) == ("stop", ("no-predicted-error",))


# Through every door


def few_rows():
    return simulate_observations(2, 4, seed=3).observations


SCANS = {
    "sound": (lambda: simulate_observations(2, 40, seed=5).observations, (), "use"),
    "many outliers": (
        lambda: simulate_observations(2, 40, outlier_share=0.4, seed=5).observations,
        (),
        "care",
    ),
    "a slipped marker": (slipped_rows, (), "stop"),
    "a slipped marker, auto": (slipped_rows, ("--threshold-mm", "auto"), "stop"),
    "held-out rows off": (lambda: parted_rows(moved_mm=4.0), ("--test-split", "test"), "care"),
    "held-out rows sound": (parted_rows, ("--test-split", "test"), "use"),
    "nothing to spare": (few_rows, (), "stop"),
    "another scale": (
        lambda: simulate_observations(2, 40, seed=5).observations,
        ("--scanner-mm-per-px", "0.3"),
        "care",
    ),
}


def run(*arguments):
    done = CliRunner(env={"COLUMNS": "999", "TERM": "dumb"}).invoke(main, [str(a) for a in arguments])
    assert done.exit_code == 0, done.output
    return done.output


def words(verdict):
    return f"{verdict['headline']}. {verdict['expectation']}"


@pytest.fixture(scope="module", params=SCANS)
def scanned(request, tmp_path_factory):
    """A folder with a table and its calibration, the options it was made with, and the level it must have."""
    folder = tmp_path_factory.mktemp("scan")
    make, options, level = SCANS[request.param]
    sc.write_observations(make(), folder / "a.csv")
    run("calibrate", folder / "a.csv", "-o", folder, *options)
    return folder, options, level


def test_every_door_gives_the_same_verdict(scanned):
    folder, options, level = scanned
    calibration, table = folder / "calibration.json", folder / "a.csv"
    printed = run("calibrate", table, "-o", folder / "again", "--no-report", *options)
    of_calibrate = json.loads(
        run("calibrate", table, "-o", folder / "again", "--json", "--no-report", "--overwrite", *options)
    )
    of_validate = json.loads(run("validate", calibration, table, "--json", "--no-report"))
    verdict = of_calibrate["verdict"]
    assert verdict == of_validate["verdict"]
    assert verdict["level"] == level
    assert words(verdict) in printed
    assert words(verdict) in run("validate", calibration, table, "--no-report")
    assert words(verdict) in run("info", calibration)
    page = html.unescape((folder / "report.html").read_text(encoding="utf-8"))
    assert f"<strong>{verdict['headline']}</strong>\n<p>{verdict['expectation']}</p>" in page
    python = give_verdict(sc.load(calibration))
    assert dataclasses.asdict(python) == verdict | {
        name: tuple(verdict[name]) for name in ("reasons", "codes")
    }


@pytest.mark.parametrize(("form", "name"), [("plus", "a.xml"), ("itk", "a.tfm"), ("slicer", "b.tfm")])
def test_every_export_says_it_and_carries_it(scanned, form, name):
    folder, _, _ = scanned
    verdict = give_verdict(sc.load(folder / "calibration.json"))
    forced = ["--force"] if verdict.level == "stop" else []
    said = run("export", folder / "calibration.json", "--to", form, "-o", folder / name, *forced)
    assert f"{verdict.headline}. {verdict.expectation}" in said
    assert verdict.remark in (folder / name).read_text(encoding="utf-8")


def test_python_has_the_verdict_that_the_command_has(tmp_path):
    sc.write_observations(slipped_rows(), tmp_path / "a.csv")
    of_command = json.loads(run("calibrate", tmp_path / "a.csv", "-o", tmp_path, "--json", "--no-report"))
    found = sc.calibrate(sc.read_observations(tmp_path / "a.csv"))
    verdict = give_verdict(found)
    assert verdict.level == "stop"
    assert "marker-slipped" in verdict.codes
    assert of_command["verdict"]["codes"] == list(verdict.codes)
    assert of_command["verdict"]["expectation"] == verdict.expectation


def test_other_rows_can_make_it_worse_and_not_better():
    found, other = sound_calibration(), dataclasses.replace(slipped_rows(), source="other.csv")
    assert give_verdict(found).level == "use"
    assert give_verdict(found, validate(found, other, resample=False)).level != "use"
    slipped = sc.calibrate(slipped_rows())
    rows = simulate_observations(2, 40, seed=7).observations
    assert give_verdict(slipped, validate(slipped, rows, resample=False)).level == "stop"


def test_comments_stay_comments():
    found = sc.calibrate(slipped_rows())
    assert ElementTree.fromstring(plus_xml(found)).find(".//Transform[@From='Image']") is not None
    lines = itk_tfm(found).decode().splitlines()
    assert [line for line in lines if "verdict" in line] == [f"# {give_verdict(found).remark}"]
    numbers = [float(x) for x in lines[-2].split()[1:]]
    np.testing.assert_array_equal(numbers[9:], found.probe_from_image.translation)
