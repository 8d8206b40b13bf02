"""Rows that say where their target's frame was, and not where in it the target is."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sonocal as sc
from sonocal.calibration.mixed import table_of
from sonocal.errors import InputError, UnsupportedError
from sonocal.observations import observations_csv, parse_observations
from sonocal.observations.poses import POSE_COLUMNS, poses_of, unplaced_rows, with_poses
from tests.builders.motion import random_pose

HEADER = ",".join(["frame,target,u_px,v_px", *POSE_COLUMNS])


def csv(rows, header=HEADER):
    return (header + "\n" + "\n".join(rows) + "\n").encode()


def row(frame, pose, spanning=""):
    cells = "" if pose is None else ",".join(repr(float(x)) for x in pose[:3].ravel())
    return f"{frame},thread,{frame}.5,7,{cells or ',' * 11}{spanning}"


@given(st.integers(0, 10**6))
@settings(max_examples=10)
def test_poses_are_read_and_written_to_the_last_bit(seed):
    poses = np.array([random_pose(seed + i) for i in range(5)])
    table = parse_observations(csv([row(i, pose) for i, pose in enumerate(poses)]), "a.csv")
    np.testing.assert_allclose(poses_of(table), poses[:, :3], atol=1e-12)
    assert unplaced_rows(table).all()
    again = parse_observations(observations_csv(table), "a.csv")
    assert {name: list(cells) for name, cells in again.extra.items()} == {
        name: list(cells) for name, cells in table.extra.items()
    }
    assert "x0_mm" not in observations_csv(table).decode()
    frame = sc.Observations.from_dataframe(table.to_dataframe())
    np.testing.assert_array_equal(poses_of(frame), poses_of(table))


def test_points_beside_a_pose_are_in_the_targets_frame_and_are_carried_once():
    pose, ends = random_pose(3), np.array([[1.0, 2, 3], [4, 5, 60]])
    spanning = "," + ",".join(repr(float(x)) for x in ends.ravel())
    header = HEADER + ",x0_mm,y0_mm,z0_mm,x1_mm,y1_mm,z1_mm"
    table = parse_observations(csv([row(0, pose, spanning), row(1, pose, spanning)], header), "a.csv")
    there = ends @ pose[:3, :3].T + pose[:3, 3]
    np.testing.assert_allclose(table.segments_mm, [there, there], atol=1e-9)
    assert table.lines_only
    again = parse_observations(observations_csv(table), "a.csv")
    np.testing.assert_array_equal(again.segments_mm, table.segments_mm)


def test_rows_with_places_and_rows_without_stand_in_one_table():
    pose = random_pose(4)
    header = HEADER + ",x0_mm,y0_mm,z0_mm,x1_mm,y1_mm,z1_mm"
    text = csv([row(0, pose, "," * 6), row(1, None, ",1,2,3,4,5,6"), row(2, pose, ",1,2,3,,,")], header)
    table = parse_observations(text, "a.csv")
    assert list(unplaced_rows(table)) == [True, False, False]
    assert list(table.spans) == [0, 2, 1]
    assert list(np.isfinite(poses_of(table)[:, 0, 0])) == [True, False, False]
    chosen = table.select([2, 0])
    assert list(unplaced_rows(chosen)) == [False, True]
    with pytest.raises(
        UnsupportedError, match=r"a.csv, line 2: says nothing of where its target 'thread' is"
    ):
        table_of(table)
    assert "2 rows" in repr(chosen)
    assert "sightings" in chosen._repr_html_()


@pytest.mark.parametrize(
    ("rows", "header", "said"),
    [
        ([row(0, random_pose(1) * 2)], HEADER, "a.csv, line 2: probe_from_target is not rigid"),
        ([row(0, random_pose(1)), row(1, None)], HEADER, "line 3: has neither points that span its target nor a pose"),
        (["0,thread,1,2,1," + "," * 10], HEADER, "a.csv, line 2: gives a part of its pose"),
        (["0,thread,1,2,one" + "," * 11], HEADER, "column probe_from_target_00: 'one' is no number of a pose"),
        (["0,thread,1,2,1" + "," * 10], HEADER[:-21], "but for the columns probe_from_target_23"),
        ([row(0, random_pose(1)), row(0, random_pose(1))], HEADER, "line 3: repeats line 2"),
    ],
)  # fmt: skip
def test_poses_that_are_none_are_refused_by_line(rows, header, said):
    with pytest.raises(InputError) as refused:
        parse_observations(csv(rows, header), "a.csv")
    assert said in str(refused.value)


def test_a_pose_in_six_digits_is_a_rotation_again():
    pose = np.round(random_pose(5), 6)
    table = parse_observations(csv([row(0, pose)]), "a.csv")
    turned = poses_of(table)[0, :, :3]
    np.testing.assert_allclose(turned.T @ turned, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(turned, pose[:3, :3], atol=1e-5)


def test_poses_are_put_into_a_table_that_has_none():
    poses = np.array([random_pose(6)[:3], np.full((3, 4), np.nan)])
    known = sc.Observations([[1.0, 2], [3, 4]], np.arange(12.0).reshape(2, 2, 3))
    np.testing.assert_allclose(poses_of(with_poses(known, poses)), poses, atol=1e-12)
