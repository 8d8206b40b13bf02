"""From images of walls and cross-wires to a calibration, with nobody clicking."""

from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

import sonocal as sc
from sonocal.cli.main import main
from sonocal.detection import Detections
from sonocal.errors import InputError, NoConsensusError, UnsupportedError
from sonocal.recording import ArrayFrames
from sonocal.simulation.sweep_files import write_targets
from sonocal.simulation.target_scenes import scene_of
from sonocal.simulation.target_sweep import TargetOptions, simulate_targets
from sonocal.simulation.ultrasound import BATH
from sonocal.simulation.ultrasound_probe import curvilinear, curvilinear_3d
from sonocal.sweep import Sweep, TargetSweep, calibrate_recording, sweep_of
from sonocal.sweep.options import telling_threshold_mm
from sonocal.targets import Line, Plane, Point

PROBE = curvilinear(250, 250, 0.48)
NEEDLE = Line("needle", "Needle", np.array([[0.0, 0, 0], [0, 0, -300]]))


def simulated(scene, frames=50, seed=1, probe=PROBE, **options):
    found = simulate_targets(scene_of(scene), probe, BATH, TargetOptions(frames=frames, seed=seed, **options))
    held = ArrayFrames(np.stack(list(found.recording.frames)))
    return replace(found, recording=replace(found.recording, frames=held))


@pytest.fixture(scope="module")
def tank():
    return simulated("walls")


def errors_mm(found, truth, side=249.0):
    corners = np.array([[0.0, 0, 0], [side, 0, 0], [0, side, 0], [side, side, 0], [side / 2, side / 2, 0]])
    return np.linalg.norm(found.probe_from_image @ corners - truth @ corners, axis=1)


@pytest.mark.parametrize("scene", ["walls", "cross-wires"])
def test_what_is_fixed_in_the_room_calibrates_a_probe_to_within_what_is_predicted(scene):
    seen = simulated(scene)
    found = calibrate_recording(seen.recording, seen.targets)
    calibration = found.calibration
    assert np.all(
        errors_mm(calibration, seen.truth.probe_from_image) < 1.6 * calibration.predicted_errors()[2]
    )
    assert errors_mm(calibration, seen.truth.probe_from_image)[-1] < 0.8
    assert found.used >= 0.7 * found.sightings
    spans = {"walls": 3, "cross-wires": 1}[scene]
    assert set(found.observations.spans.tolist()) == {spans}


def test_the_chosen_walls_are_the_ones_that_the_images_are_of(tank):
    found = calibrate_recording(tank.recording, tank.targets)
    names = np.array([one.name for one in tank.targets])[tank.truth.target]
    rows = found.observations
    assert np.mean(rows.target == names[rows.frame]) > 0.95
    assert tank.truth.visible[rows.frame].all()


def test_a_scale_that_is_known_is_kept_and_scales_of_their_own_are_found_alike(tank):
    """Whatever the model, candidates are chosen by one scale; what was chosen is fitted by the model."""
    sweep = sweep_of(tank.recording, tank.targets)
    seen = sweep.detect()
    known = sweep_of(tank.recording, tank.targets, scale_mm_per_px=0.48).calibrate(seen).calibration
    assert known.probe_from_image.scales[0] == 0.48
    two = sweep_of(tank.recording, tank.targets, model="anisotropic").calibrate(seen).calibration
    assert two.probe_from_image.scales[:2] == pytest.approx([0.48, 0.48], rel=0.05)


def test_planes_of_volumes_calibrate_a_3d_probe():
    seen = simulated("walls", frames=24, probe=curvilinear_3d(64, 1.8), compact=0.0)
    found = calibrate_recording(seen.recording, seen.targets)
    assert errors_mm(found.calibration, seen.truth.probe_from_image, 63.0)[-1] < 1.0
    rows = found.observations
    assert rows.dimension == 3
    assert np.all(np.bincount(rows.sightings) == 3)


def test_moving_the_room_moves_nothing(tank):
    """Targets and poses in another frame of the room: the same calibration."""
    moved = np.eye(4)
    moved[:3, :3] = sc.Similarity(np.eye(3)[[1, 2, 0]], [30.0, -20, 5], 1.0).rotation
    moved[:3, 3] = [30.0, -20, 5]
    poses = tank.recording.poses["ProbeToTracker"]
    other = replace(poses, matrices=moved @ poses.matrices)
    targets = [replace(one, points_mm=one.points_mm @ moved[:3, :3].T + moved[:3, 3]) for one in tank.targets]
    recording = replace(tank.recording, poses={"ProbeToTracker": other})
    seen = sweep_of(tank.recording, tank.targets).detect()
    one = calibrate_recording(tank.recording, tank.targets, detections=seen).calibration
    two = calibrate_recording(recording, targets, detections=seen).calibration
    np.testing.assert_allclose(two.probe_from_image.matrix, one.probe_from_image.matrix, atol=1e-4)


def test_echoes_of_walls_that_are_candidates_too_move_it_by_less_than_it_is_unsure_of(tank):
    """Below by less than the threshold, or by more; where a wall was hidden one may be near by chance."""
    sweep = sweep_of(tank.recording, tank.targets)
    (seen,) = sweep.detect()
    first = seen.select(seen.rank == 0)
    alone = sweep.calibrate([first]).calibration
    places, _, unsure = alone.predicted_errors()
    for further in (9.0, 30.0, 60.0):
        echoes = first.points_px + np.array([0.0, further])
        both = Detections(
            np.concatenate([first.frame, first.frame]),
            np.concatenate([first.points_px, echoes]),
            score=np.concatenate([first.score, 0.8 * first.score]),
            images=seen.images,
        )
        found = sweep.calibrate([both])
        assert np.mean(np.isin(found.observations.points_px[:, 1], first.points_px[..., 1])) > 0.9
        moved = found.calibration.predict(places)[0] - alone.predict(places)[0]
        assert np.all(np.linalg.norm(moved, axis=1) < unsure)


def test_walls_that_are_elsewhere_give_no_calibration(tank):
    random = np.random.default_rng(3)
    scrambled = tank.recording.poses["ProbeToTracker"]
    recording = replace(
        tank.recording,
        poses={"ProbeToTracker": replace(scrambled, matrices=random.permutation(scrambled.matrices))},
    )
    with pytest.raises((NoConsensusError, sc.SonocalError)):
        calibrate_recording(recording, tank.targets)


def test_images_without_a_wall_are_refused_and_it_is_said_why():
    seen = simulated("wall", frames=12, hidden_share=1.0, compact=0.0, interfaces=0.0)
    with pytest.raises(NoConsensusError, match=r"no candidate was found in 12 images \(in \d+ of them "):
        calibrate_recording(seen.recording, seen.targets)


def test_a_needle_and_its_tip_are_looked_for_as_a_needle(tank):
    tip = Point("tip", "Needle", np.zeros(3))
    with pytest.raises(InputError) as alone:
        Sweep.of(tank.recording, [NEEDLE])
    with pytest.raises(InputError) as both:
        sweep_of(tank.recording, [NEEDLE, tip])
    assert str(both.value) == str(alone.value)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"threshold_mm": "auto"}, "threshold_mm 'auto' is for needles and wires alone"),
        ({"latency": "estimate"}, "latency 'estimate' is for needles and wires alone"),
    ],
)
def test_options_of_lines_alone_are_refused_before_an_image_is_decoded(tank, options, says):
    with pytest.raises(UnsupportedError, match=says):
        TargetSweep.of(tank.recording, tank.targets, **options)


def test_beads_in_volumes_are_refused_with_what_to_do():
    seen = simulated("wall", frames=3, probe=curvilinear_3d(32, 3.6))
    with pytest.raises(UnsupportedError, match=r"give the points with --points"):
        sweep_of(seen.recording, [Point("bead", "Tracker", np.zeros(3))])


def test_parallel_walls_near_one_another_are_told_apart_by_a_fifth_of_their_distance():
    floor = Plane("floor", "Tracker", np.array([[0.0, 0, 0], [100, 0, 0], [0, 100, 0]]))
    sheet = replace(floor, name="sheet", points_mm=floor.points_mm + 12.0 * np.eye(3)[2])
    wall = Plane("wall", "Tracker", np.array([[0.0, 0, 0], [100, 0, 0], [0, 0, 100]]))
    assert telling_threshold_mm([floor, wall]) == 5.0
    assert telling_threshold_mm([floor, wall, sheet]) == pytest.approx(2.4)


def test_what_is_no_detection_is_refused(tank):
    with pytest.raises(InputError, match="detections must be"):
        calibrate_recording(tank.recording, tank.targets, detections=[3])
    empty = Detections(np.zeros(0, dtype=int), np.zeros((0, 2, 2)), images=5)
    with pytest.raises(NoConsensusError, match="no candidate was found in 5 images"):
        calibrate_recording(tank.recording, tank.targets, detections=[empty])


def test_from_files_to_a_calibration_with_its_table_sheet_and_report(tank, tmp_path):
    sweep, targets, _ = map(str, write_targets(tank, tmp_path))
    run = CliRunner().invoke(main, ["calibrate", sweep, "--targets", targets, "-o", str(tmp_path / "out")])
    assert run.exit_code == 0, run.output
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "calibration.json",
        "observations.csv",
        "contact-sheet.png",
        "report.html",
    }
    rows = sc.read_observations(tmp_path / "out" / "observations.csv")
    again = sc.calibrate(rows)
    np.testing.assert_allclose(
        again.probe_from_image.matrix,
        sc.load(tmp_path / "out" / "calibration.json").probe_from_image.matrix,
        atol=1e-4,
    )
    table = tmp_path / "candidates.csv"
    sheet = tmp_path / "sheet.png"
    run = CliRunner().invoke(
        main, ["detect", sweep, "--targets", targets, "-o", str(table), "--sheet", str(sheet)]
    )
    assert run.exit_code == 0, run.output
    assert len(sc.read_observations(table)) > len(rows)
    assert sheet.read_bytes()[:4] == b"\x89PNG"
