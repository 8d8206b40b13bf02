"""Tools whose poses are in another unit are doubted by its name, before anything else is said of them."""

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from sonocal import InputError
from sonocal.cli.main import main
from sonocal.geometry.units import tip_hints
from sonocal.recording import Poses, Recording
from sonocal.tools import calibrate_tool, pivot_doubts
from tests.builders.tracked_tools import pivoting, spinning

UNITS = {"centimetres": 10.0, "inches": 25.4, "metres": 1000.0}
CODE = "implausible-units"


def recorded(poses, mm=1.0):
    scaled = poses.copy()
    scaled[:, :3, 3] /= mm
    made = Poses.of("Needle", "Tracker", scaled)
    return Recording(times=np.arange(len(made)) / 20, poses={made.name: made})


@pytest.mark.parametrize("unit", UNITS)
def test_a_pivot_and_a_spin_in_another_unit_are_doubted_by_it_and_not_by_the_length(unit):
    for seed in range(5):
        rng = np.random.default_rng(seed)
        pivot, spin = recorded(pivoting(rng), UNITS[unit]), recorded(spinning(rng), UNITS[unit])
        found = calibrate_tool("Needle", pivot)
        assert CODE in [one.code for one in found.diagnostics]
        with pytest.raises(
            InputError, match=rf"^.*are these .*{unit}.*refused as it stands.*--length"
        ) as refusal:
            calibrate_tool("Needle", pivot, spin=spin)
        assert f"{UNITS[unit]:g}" in str(refusal.value)
        assert [one.code for one in pivot_doubts(pivot)] == [CODE]


def test_sound_tools_are_not_doubted():
    for seed in range(20):
        rng = np.random.default_rng(seed)
        pivot, spin = recorded(pivoting(rng)), recorded(spinning(rng))
        assert not pivot_doubts(pivot)
        assert CODE not in [one.code for one in calibrate_tool("Needle", pivot, spin=spin).diagnostics]


def test_what_is_no_pivot_is_not_doubted():
    assert not pivot_doubts(recorded(spinning(np.random.default_rng(0)), 10.0))


@given(st.floats(5, 400), st.floats(0.08, 2))
def test_a_sensor_near_the_tip_is_not_doubted(tip_mm, rms_mm):
    assert not tip_hints(tip_mm, rms_mm)


@given(st.floats(31, 400), st.floats(0, 2))
def test_a_tracker_of_high_precision_is_not_doubted(tip_mm, rms_mm):
    assert not tip_hints(tip_mm, rms_mm)


def test_info_doubts_a_pivot(tmp_path):
    poses = pivoting(np.random.default_rng(0))
    names = [f"Needle_m{row}{column}" for row in range(3) for column in range(4)]
    for mm, doubted in ((1.0, False), (10.0, True)):
        matrices = recorded(poses, mm).tool("Needle").matrices[:, :3].reshape(-1, 12)
        table = np.column_stack([np.arange(len(poses)) * 0.05, matrices])
        np.savetxt(tmp_path / "a.csv", table, delimiter=",", header=",".join(["time_s", *names]), comments="")
        said = CliRunner().invoke(main, ["info", str(tmp_path / "a.csv")])
        assert said.exit_code == 0, said.output
        assert ("re these centimetres?" in " ".join(said.output.split())) == doubted
