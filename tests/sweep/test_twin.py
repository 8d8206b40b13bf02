"""A twin of the needle is never taken for it in silence, and none is seen where there is none."""

import pytest
from benchmarks.simulators.twins import KINDS, twin_scan
from benchmarks.twins import outcomes

from sonocal.sweep import calibrate_recording

SEEDS = range(3)  # of benchmarks/twins.py, which has the table of fifty


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("brighter", [True, False])
@pytest.mark.parametrize("apart_mm", [6.0, 11.0])
@pytest.mark.parametrize("kind", KINDS)
def test_a_twin_is_named(kind, apart_mm, brighter, dimension):
    found = outcomes(SEEDS, kind=kind, apart_mm=apart_mm, brighter=brighter, dimension=dimension)
    assert found["named"] == len(SEEDS)
    assert found["confidently_wrong"] == 0


@pytest.mark.parametrize("brighter", [True, False])
@pytest.mark.parametrize("apart_mm", [3.0, 11.0])
def test_of_a_needle_and_its_echo_the_needle_is_chosen_however_bright_the_echo_is(apart_mm, brighter):
    found = outcomes(SEEDS, kind="echo", apart_mm=apart_mm, brighter=brighter)
    assert found["wrong"] == 0
    one = twin_scan(3, kind="echo", apart_mm=apart_mm, brighter=brighter)
    calibration = calibrate_recording(
        one.recording, one.lines, detections=one.detections, second_look=False
    ).calibration
    (message,) = (finding.message for finding in calibration.warnings if finding.code == "second-needle")
    assert f"{apart_mm:.0f}" in message
    assert "mm deeper: the upper one, which was chosen, is likelier the needle" in message


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_needle_alone_is_not_accused(dimension):
    assert outcomes(range(8), dimension=dimension)["named"] == 0
