"""A file of lines in another unit than the poses is named by the factor that makes them one."""

import dataclasses

import numpy as np
import pytest
from benchmarks.simulators.trust_faults import Case
from benchmarks.simulators.trust_judge import NEEDLE, candidates, recording
from benchmarks.simulators.trust_scans import sound

import sonocal as sc
from sonocal.sweep import calibrate_points
from sonocal.validation import give_verdict
from tests.builders.sweeps import with_marker_moved

MM = {"mm": 1.0, "cm": 10.0, "inches": 25.4}
OFFSET = np.array([30.0, 20.0, 40.0])


def scanned(seed, poses="mm", lines="mm"):
    """A recording and its needle beside its marker, each in a unit, and the points seen."""
    scan = sound(seed, 100)
    beside = np.eye(4)
    beside[:3, 3] = OFFSET
    made = with_marker_moved(recording(scan), "Needle", beside)
    scaled = {}
    for name, one in made.poses.items():
        matrices = one.matrices.copy()
        matrices[:, :3, 3] /= MM[poses]
        scaled[name] = dataclasses.replace(one, matrices=matrices)
    needle = dataclasses.replace(NEEDLE, segment_mm=(NEEDLE.segment_mm - OFFSET) / MM[lines])
    return dataclasses.replace(made, poses=scaled), [needle], candidates(Case(scan))


def said(given):
    """The finding of a refusal, or of a calibration that was found all the same; none of a sound one."""
    try:
        found = calibrate_points(*given)[0]
    except sc.SonocalError as refusal:
        assert str(refusal).startswith(refusal.diagnostics[0].message)
        return refusal.diagnostics[0]
    assert not found.warnings or give_verdict(found).level == "stop"
    return next(iter(found.warnings), None)


@pytest.mark.parametrize(("poses", "lines"), [("mm", "cm"), ("mm", "inches"), ("cm", "mm"), ("inches", "mm")])
def test_the_factor_between_two_units_is_named(poses, lines):
    for seed in range(3):
        finding = said(scanned(seed, poses, lines))
        assert finding.code == "implausible-units"
        factor = f"{MM[lines] / MM[poses]:.4g}"
        assert f"multiplied by {factor} ({lines}, where poses are in {poses})" in finding.message
        assert "in mm, both" in finding.advice


def test_one_unit_is_not_doubted():
    assert [said(scanned(seed)) for seed in range(3)] == [None] * 3
