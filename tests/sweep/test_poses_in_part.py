"""Poses that are written otherwise in a part of a recording are named; clutter is not taken for that."""

import dataclasses

import numpy as np
import pytest
from benchmarks.simulators.trust_faults import Case
from benchmarks.simulators.trust_judge import NEEDLE, candidates, recording
from benchmarks.simulators.trust_scans import sound

import sonocal as sc
from sonocal.sweep import calibrate_points
from sonocal.validation import give_verdict

COUNT = 100
PARTS = {"the last quarter": np.arange(COUNT) >= 3 * COUNT // 4, "every third": np.arange(COUNT) % 3 == 0}


def scanned(seed):
    scan = sound(seed, COUNT)
    return recording(scan), candidates(Case(scan))


def inverted(made, tools, part):
    """The recording with the poses of tools inverted in part of it."""
    poses = dict(made.poses)
    for name, one in made.poses.items():
        if one.source in tools:
            matrices = one.matrices.copy()
            matrices[part] = np.linalg.inv(matrices[part])
            poses[name] = dataclasses.replace(one, matrices=matrices)
    return dataclasses.replace(made, poses=poses)


@pytest.mark.parametrize("tools", [("Probe",), ("Needle",), ("Probe", "Needle")])
@pytest.mark.parametrize("part", PARTS)
def test_poses_that_are_inverted_in_part_are_named(tools, part):
    for seed in range(2):
        made, seen = scanned(seed)
        found = calibrate_points(inverted(made, tools, PARTS[part]), [NEEDLE], seen)[0]
        assert found.warnings[0].code == "wrong-poses"
        said = " and the ".join(f"{tool}'s" for tool in tools)
        assert f"the {said} poses fit when they are inverted in part" in found.warnings[0].message
        assert give_verdict(found).level == "stop"


def test_images_of_something_else_are_no_inverted_poses():
    for seed in range(3):
        made, seen = scanned(seed)
        rng = np.random.default_rng(seed)
        places = seen.points_px.copy()
        clutter = np.flatnonzero(rng.random(len(places)) < 0.4)
        places[clutter] = rng.uniform(20, 480, places[clutter].shape)
        found = calibrate_points(made, [NEEDLE], dataclasses.replace(seen, points_px=places))[0]
        assert "wrong-poses" not in {one.code for one in found.warnings}


@pytest.mark.parametrize("axis", [0, 1])
def test_one_axis_in_shares_of_the_image_leads_the_refusal(axis):
    made, seen = scanned(0)
    places = seen.points_px.copy()
    places[..., axis] /= 1.02 * places[..., axis].max()
    with pytest.raises(sc.SonocalError, match=f"^is {'uv'[axis]} in pixels") as refused:
        calibrate_points(made, [NEEDLE], dataclasses.replace(seen, points_px=places))
    assert refused.value.diagnostics[0].code == "implausible-units"
