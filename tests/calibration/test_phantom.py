"""A phantom of known shape and unknown place: its six numbers are found with the calibration."""

import numpy as np
import pytest
from benchmarks.phantom_places import corners_covered, error_mm, place_off, said_of, table, wires_of
from benchmarks.simulators.phantom_sweep import N_WIRES, PARALLEL, THREE, phantom_sweep

import sonocal as sc
from sonocal.calibration.found_phantom import phantom_in_words
from sonocal.errors import DegenerateGeometryError, NoConsensusError, UnsupportedError
from sonocal.targets import Phantom, Unplaced

EXACT = {"px": 0.0, "mm": 0.0, "deg": 0.0}


@pytest.mark.parametrize("wires", [N_WIRES, THREE], ids=["seven", "three"])
def test_without_noise_the_calibration_and_the_place_are_exact(wires):
    scene = phantom_sweep(1, wires, frames=25, tilt_deg=40, turn_deg=40, **EXACT)
    found = sc.calibrate(table(scene), targets=wires_of(wires))
    assert error_mm(found, scene).max() < 1e-4
    np.testing.assert_allclose(found.phantom.place, scene.place, atol=1e-4)


def test_a_sweep_with_noise_gives_what_it_states_and_agrees_with_landmarks(tmp_path):
    scene = phantom_sweep(0, frames=40)
    found = sc.calibrate(table(scene), targets=wires_of(N_WIRES, said=said_of(scene, 0)))
    assert error_mm(found, scene).max() < 2.0
    assert corners_covered(found, scene).all()
    assert (place_off(found, scene) < 1.6).all()
    assert found.phantom.agrees
    assert "which agrees within what both are unsure of" in phantom_in_words(found.phantom)
    # Each wire is where the phantom has it.
    for k, ends in enumerate(N_WIRES):
        there = ends @ np.array(found.phantom.place)[:3, :3].T + np.array(found.phantom.place)[:3, 3]
        target = found.targets[f"wire {k}"]
        off = (there - target.middle_mm) @ np.array(target.axes)[:, :2]
        np.testing.assert_allclose(off, 0, atol=1e-6)
    found.save(tmp_path / "a.json")
    again = sc.load(tmp_path / "a.json")
    assert again.phantom == found.phantom


def test_moving_what_the_phantom_is_fixed_to_moves_its_place_and_nothing_else():
    scene = phantom_sweep(1, THREE, frames=25, tilt_deg=40, turn_deg=40, **EXACT)
    step = np.array([[0, -1, 0, 30.0], [1, 0, 0, -40], [0, 0, 1, 90], [0, 0, 0, 1]])
    moved = type(scene)(**{**vars(scene), "poses": scene.poses @ np.linalg.inv(step)})
    here, there = (sc.calibrate(table(one), targets=wires_of(THREE)) for one in (scene, moved))
    np.testing.assert_allclose(here.probe_from_image.matrix, there.probe_from_image.matrix, atol=1e-4)
    np.testing.assert_allclose(there.phantom.place, step @ np.array(here.phantom.place), atol=1e-4)


def test_landmarks_that_are_elsewhere_and_wires_that_are_misplaced_are_findings():
    scene = phantom_sweep(0, frames=40)
    said = said_of(scene, 0)
    said[:3, 3] += [6.0, 0, 0]
    found = sc.calibrate(table(scene), targets=wires_of(N_WIRES, said=said))
    assert found.phantom.agrees is False
    assert "phantom-elsewhere" in [one.code for one in found.diagnostics]
    wrong = N_WIRES.copy()
    wrong[1, 1] += [2.0, 0, 2.0]
    found = sc.calibrate(table(scene), targets=wires_of(wrong))
    assert "phantom-shape" in [one.code for one in found.diagnostics]


def test_what_has_no_answer_is_refused_by_name():
    scene = phantom_sweep(1, PARALLEL, frames=20)
    with pytest.raises(DegenerateGeometryError, match=r"free to slide along \(0.00, 1.00, 0.00\)") as caught:
        sc.calibrate(table(scene), targets=wires_of(PARALLEL))
    assert caught.value.code == "phantom-free"
    scene = phantom_sweep(1, THREE, frames=25)
    others = [*wires_of(THREE)[:2], Unplaced("line", "wire 2", "Tracker")]
    with pytest.raises(UnsupportedError, match="with targets beside it"):
        sc.calibrate(table(scene), targets=others)
    two = [*wires_of(THREE)[:2], wires_of(THREE)[2]]
    assert isinstance(two[2].phantom, Phantom)
    with pytest.raises(UnsupportedError, match="with two phantoms"):
        sc.calibrate(table(scene), targets=two)
    with pytest.raises((NoConsensusError, DegenerateGeometryError)):
        sc.calibrate(table(phantom_sweep(1, THREE, frames=25)), targets=wires_of(THREE * [1, -3, 1]))


def test_images_alone_do_not_name_the_wires():
    from sonocal.simulation.sweep import SweepOptions, simulate_sweep
    from sonocal.simulation.ultrasound import BATH
    from sonocal.simulation.ultrasound_probe import curvilinear

    sweep = simulate_sweep(curvilinear(100, 100, 0.9), BATH, SweepOptions(frames=3, seed=1))
    with pytest.raises(UnsupportedError, match="name the wires with --points"):
        sc.calibrate_recording(sweep.recording, wires_of(THREE))
