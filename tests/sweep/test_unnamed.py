"""Points of several wires of which nobody says which is of which, given beside a recording."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.simulators import phantoms
from scipy.spatial.transform import Rotation

from sonocal.detection import Detections
from sonocal.errors import DegenerateGeometryError, InputError, NoConsensusError
from sonocal.recording import Poses, Recording
from sonocal.sweep import calibrate_points
from sonocal.targets import Line


def given(dots, wires):
    """The recording, wires and points of a scan; a pose brings the phantom's wires where the scan had them."""
    poses = []
    for there in dots.wires:
        ends, seen = wires.reshape(-1, 3), there.reshape(-1, 3)
        turn = Rotation.align_vectors(seen - seen.mean(axis=0), ends - ends.mean(axis=0))[0].as_matrix()
        place = seen.mean(axis=0) - turn @ ends.mean(axis=0)
        poses.append(np.block([[turn, place[:, None]], [np.zeros((1, 3)), 1]]))
    recording = Recording(
        times=np.arange(len(poses)) / 10.0,
        poses={"PhantomToProbe": Poses.of("Phantom", "Probe", np.array(poses))},
    )
    lines = [Line(f"wire {i}", "Phantom", ends) for i, ends in enumerate(wires)]
    points = Detections(
        dots.frame, dots.points.reshape(len(dots.points), -1, dots.points.shape[-1]), source="points.csv"
    )
    return recording, lines, points


def scanned(scan=phantoms.scan, seed=3, frames=20, spoil=(0.2, 0.5)):
    rng = np.random.default_rng(seed)
    wires = phantoms.random_wires(rng, 6)
    return wires, phantoms.spoilt(rng, scan(rng, wires, frames), *spoil)


@pytest.mark.parametrize("scan", [phantoms.scan, phantoms.scan_volumes])
def test_points_without_names_calibrate_as_those_with_them_do(scan):
    wires, dots = scanned(scan)
    recording, lines, points = given(dots, wires)
    found, rows = calibrate_points(recording, lines, points)
    mine = dots.truth >= 0
    names = np.array([line.name for line in lines])[dots.truth[mine]]
    named = replace(points.select(np.flatnonzero(mine)), target=names)
    told, _ = calibrate_points(recording, lines, named)
    every = np.array([[0.0, 0, 0], [400, 0, 0], [0, 400, 0], [400, 400, 0]])
    apart = np.linalg.norm(found.probe_from_image @ every - told.probe_from_image @ every, axis=1)
    assert apart.max() < told.predicted_errors()[2].max()
    assert "labels-given" in [one.code for one in found.diagnostics]
    assert "contact sheet" not in str(
        [one.message for one in found.diagnostics if one.code == "labels-given"]
    )
    right = {
        (int(f), *map(float, p)): n for f, p, n in zip(named.frame, named.points_px[:, 0], names, strict=True)
    }
    each = points.points_each
    given_names = [
        right.get((int(f), *map(float, p)), name)
        for f, p, name in zip(rows.frame[::each], rows.points_px[::each], rows.target[::each], strict=True)
    ]
    assert np.mean(np.array(given_names) != rows.target[::each]) <= 0.02


def test_points_of_other_wires_are_no_calibration():
    wires, dots = scanned()
    recording, lines, points = given(dots, wires)
    away = np.random.default_rng(0).normal(size=(6, 1, 3)) * 8
    elsewhere = [
        replace(line, segment_mm=line.segment_mm + shift) for line, shift in zip(lines, away, strict=True)
    ]
    with pytest.raises(
        NoConsensusError, match=r"points\.csv: its points name no line, and no labels of the 6 lines fit"
    ):
        calibrate_points(recording, elsewhere, points)


def test_all_points_name_their_line_or_none_does():
    wires, dots = scanned()
    recording, lines, points = given(dots, wires)
    some = replace(points, target=np.where(np.arange(len(points)) < 10, "wire 1", ""))
    with pytest.raises(
        InputError,
        match=rf"{len(points) - 10} of {len(points)} points name none of the lines wire 0, .*or none",
    ):
        calibrate_points(recording, lines, some)


@pytest.mark.parametrize("seed", range(4))
def test_wires_that_are_scanned_along_themselves_are_no_wires_in_another_unit(seed):
    rng = np.random.default_rng(seed)
    wires = phantoms.symmetric(rng)
    dots = phantoms.scan(rng, wires, 20, turn_rad=0.002, shift_mm=(0.3, 0.3, 20.0))
    recording, lines, points = given(dots, wires)
    with pytest.raises(
        (DegenerateGeometryError, NoConsensusError), match=r"^all needles lie|which candidate is of which"
    ):
        calibrate_points(recording, lines, points)
    points = replace(points, target=np.array([line.name for line in lines])[dots.truth])
    with pytest.raises(
        DegenerateGeometryError, match=r"^all needles lie within 0\.\d+ deg of one direction"
    ) as refused:
        calibrate_points(recording, lines, points)
    assert refused.value.code == "parallel-lines"
