"""Sweeps of what is fixed in a room: where targets show is where the truth says."""

import numpy as np
import pytest

from sonocal import InputError
from sonocal.simulation.sweep_files import write_targets
from sonocal.simulation.target_scenes import SCENES, scene_of
from sonocal.simulation.target_sweep import TargetOptions, simulate_targets
from sonocal.simulation.truth_file import read_truth
from sonocal.simulation.ultrasound import BATH
from sonocal.simulation.ultrasound_probe import curvilinear
from sonocal.targets import Plane, read_targets

SMALL = curvilinear(200, 200, 0.6)
QUIET = {"compact": 0.0, "interfaces": 0.0, "hidden_share": 0.0, "sigma_px": 0.0, "sigma_mm": 0.0}


@pytest.mark.parametrize("name", SCENES)
def test_the_image_is_bright_where_the_poses_bring_the_target(name):
    sweep = simulate_targets(scene_of(name), SMALL, BATH, TargetOptions(frames=8, **QUIET))
    probe_from_room = sweep.recording.between("Probe", "Tracker").matrices
    for i, image in enumerate(sweep.recording.frames):
        target = sweep.targets[sweep.truth.target[i]]
        points = target.spanning_mm @ probe_from_room[i, :3, :3].T + probe_from_room[i, :3, 3]
        places = (
            (points - sweep.truth.probe_from_image.translation) @ sweep.truth.probe_from_image.rotation / 0.6
        )
        bright = np.argwhere(image > 0.8 * image.max())[:, ::-1]
        spots = np.column_stack([bright, np.zeros(len(bright))])
        if isinstance(target, Plane):
            normal = np.cross(*(places[1:] - places[0]))
            away = np.abs((spots - places[0]) @ normal) / np.linalg.norm(normal)
        elif len(places) == 1:
            away = np.linalg.norm(spots - places[0] * [1, 1, 0], axis=1)
        else:  # other wires show, too
            share = -places[0, 2] / (places[1, 2] - places[0, 2])
            away = np.linalg.norm(spots - places[0] - share * (places[1] - places[0]), axis=1)
        assert away.min() < 2.5


def test_a_wall_is_brightest_across_the_beam_and_has_a_second_echo_below():
    sweep = simulate_targets(scene_of("wall"), SMALL, BATH, TargetOptions(frames=6, **QUIET))
    for image in sweep.recording.frames:
        column = image[:, 100].astype(int)
        first = int(np.argmax(column > 0.7 * column.max()))
        assert (column[first + 5 : first + 13] > 40).any()


def test_the_same_seed_gives_the_same_images_in_any_order_and_another_gives_others():
    one, same, other = (
        simulate_targets(
            scene_of("cross-wires"), SMALL, options=TargetOptions(frames=4, seed=seed)
        ).recording.frames
        for seed in (1, 1, 2)
    )
    backwards = [same[i] for i in (3, 2, 1, 0)][::-1]
    assert all(np.array_equal(a, b) for a, b in zip(one, backwards, strict=True))
    assert not np.array_equal(one[0], other[0])


def test_its_files_hold_what_it_is(tmp_path):
    sweep = simulate_targets(scene_of("walls"), SMALL, options=TargetOptions(frames=3))
    paths = write_targets(sweep, tmp_path)
    planes = read_targets(paths[1]).planes
    assert [one.name for one in planes] == ["floor", "left", "right", "front", "back"]
    np.testing.assert_array_equal(planes[0].points_mm, sweep.targets[0].points_mm)
    np.testing.assert_array_equal(read_truth(paths[2]).probe_from_image, sweep.truth.probe_from_image.matrix)


@pytest.mark.parametrize(
    "wrong", [{"frames": 0}, {"rate_hz": 0.0}, {"sigma_mm": -1.0}, {"hidden_share": 2.0}]
)
def test_options_that_mean_nothing_are_refused(wrong):
    with pytest.raises(InputError, match="got"):
        TargetOptions(**wrong)


def test_a_scene_that_is_none_is_refused_by_name():
    with pytest.raises(InputError, match="no scene 'roof'; there are wall, walls"):
        scene_of("roof")
