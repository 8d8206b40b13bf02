"""Logs of trackers, as their own programs write them, from poses (N, 4, 4) in mm."""

import csv
import io
import warnings

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.builders.tables import TIMES, quaternions_xyzw

SHAPE = np.array([[0.0, 0, 0], [80, 0, 5], [0, 60, -5], [35, 30, 40]])
"""Where four markers are in their tool's frame, mm."""


def text_of(rows, separator=","):
    text = io.StringIO(newline="")
    csv.writer(text, delimiter=separator, lineterminator="\n").writerows(rows)
    return text.getvalue()


def ndi_capi(tools, lost=(), times=True, markers=0):
    """The Combined API sample's CSV; a tool that is lost has no markers, so that its row is shorter."""
    stamps = ["timespec_s", "timespec_ns"] if times else []
    pose = ["TransformStatus", "Q0", "Qx", "Qy", "Qz", "Tx", "Ty", "Tz", "Error", "#Markers"]
    seen = [cell for m in range(markers) for cell in (f"Marker{m}.Status", "Tx", "Ty", "Tz")]
    header = ["ToolCount"]
    for _ in tools:
        header += ["ToolInfo", "Frame#", "PortHandle", "Face#", *stamps, *pose, *seen]
    rows = [header]
    for i in range(len(next(iter(tools.values())))):
        row = [len(tools)]
        for port, (name, matrices) in enumerate(tools.items(), 1):
            at = 1_700_000_000 + TIMES[i]
            stamp = [int(at), round(1e9 * (at % 1))] if times else []
            row += [name, 3 * i, f"Port:{port}", 1, *stamp]
            if i in lost and port == 1:
                row += ["Missing", *[""] * 8, 0]
                continue
            q = np.roll(quaternions_xyzw(matrices[i : i + 1])[0], 1)
            row += ["OK", *q.tolist(), *matrices[i, :3, 3].tolist(), 0.1, markers]
            row += markers * ["OK", 1.0, 2.0, 3.0]
        rows.append(row)
    return text_of(rows)


def ndi_toolbox(tools, lost=(), separator="\t", euler=False, markers=1):
    """ToolBox's CSV or TSV, whose rows are all of one length."""
    turn = ["Rz", "Ry", "Rx"] if euler else ["Q0", "Qx", "Qy", "Qz"]
    rows = [["Tools"]]
    for name in tools:
        rows[0] += [name, "Frame", "Time [sec]", "Face", "State", *turn, "Tx", "Ty", "Tz", "Error", "Markers"]
        rows[0] += markers * ["State", "Tx", "Ty", "Tz"]
    for i in range(len(next(iter(tools.values())))):
        row = [len(tools)]
        for name, matrices in tools.items():
            row += [name, 3 * i, repr(float(TIMES[i])), 1]
            rotation = Rotation.from_matrix(matrices[i, :3, :3])
            numbers = rotation.as_euler("ZYX", degrees=True) if euler else np.roll(rotation.as_quat(), 1)
            if i in lost:
                row += ["Missing", *["-3.697314E+28"] * (len(turn) + 3), "", markers]
            else:
                row += ["OK", *numbers.tolist(), *matrices[i, :3, 3].tolist(), 0.2, markers]
            row += markers * ["OK", 1.0, 2.0, 3.0]
        rows.append(row)
    return text_of(rows, separator)


def tum(matrices, comment="# timestamp tx ty tz qx qy qz qw\n"):
    rows = np.column_stack([TIMES[: len(matrices)], matrices[:, :3, 3] / 1000, quaternions_xyzw(matrices)])
    return comment + "".join(" ".join(map(repr, row)) + "\n" for row in rows.tolist())


def vicon_bodies(tools, kind="quaternion", unit="mm", title="Objects", lost=(), rate=100):
    """Objects or segments; `kind` "quaternion", "vector" or an order of axes, degrees."""
    axes = ["RX", "RY", "RZ", *(["RW"] if kind == "quaternion" else []), "TX", "TY", "TZ"]
    turn = [""] * 4 if kind == "quaternion" else ["deg"] * 3
    names, header, units = ["", ""], ["Frame", "Sub Frame"], ["", ""]
    for name in tools:
        names += [f"{name}:{name}", *[""] * (len(axes) - 1)]
        header += axes
        units += [*turn, *[unit] * 3]
    rows = [[title], [rate], names, header, units]
    for i in range(len(next(iter(tools.values())))):
        row = [i + 1, 0]
        for matrices in tools.values():
            rotation = Rotation.from_matrix(matrices[i, :3, :3])
            if kind == "quaternion":
                numbers = rotation.as_quat()
            elif kind == "vector":
                numbers = np.rad2deg(rotation.as_rotvec())
            else:
                order = [kind.lower().index(axis) for axis in "xyz"]
                numbers = rotation.as_euler(kind, degrees=True)[order]
            place = matrices[i, :3, 3] / {"mm": 1, "m": 1000}[unit]
            row += [""] * len(axes) if i in lost else [*numbers.tolist(), *place.tolist()]
        rows.append(row)
    return text_of(
        [*rows, [], ["Joints"], [rate], ["", "", "a"], ["Frame", "Sub Frame", "RX"], ["", "", "deg"]]
    )


def marker_places(matrices, shape=SHAPE):
    """(N, M, 3): where the markers of a shape are."""
    return shape @ np.swapaxes(matrices[:, :3, :3], 1, 2) + matrices[:, None, :3, 3]


def vicon_markers(places, labels, hidden=()):
    """Trajectories of markers (N, M, 3); `hidden` are pairs of frame and marker."""
    names = ["", "", *(cell for label in labels for cell in (label, "", ""))]
    rows = [["Trajectories"], [100], names, ["Frame", "Sub Frame", *"XYZ" * len(labels)]]
    rows.append(["", "", *["mm"] * 3 * len(labels)])
    for i, frame in enumerate(places):
        cells = [["", "", ""] if (i, m) in hidden else place.tolist() for m, place in enumerate(frame)]
        rows.append([i + 1, 0, *(number for cell in cells for number in cell)])
    return text_of(rows)


def c3d_file(path, places, labels, unit="mm", hidden=(), rate=100.0):
    """A C3D file of markers (N, M, 3) in mm, written by the package c3d."""
    c3d = pytest.importorskip("c3d", reason="the package c3d is not installed")
    writer = c3d.Writer(point_rate=rate, analog_rate=0, point_scale=-1.0)
    scale = {"mm": 1.0, "m": 1e-3, "cm": 0.1, "in": 1 / 25.4}[unit]
    for i, frame in enumerate(places):
        points = np.zeros((len(labels), 5), np.float32)
        points[:, :3] = scale * frame
        for m in range(len(labels)):
            if (i, m) in hidden:
                points[m] = [0, 0, 0, -1, -1]
        writer.add_frames([(points, np.empty((0, 0)))])
    writer.set_point_labels(labels)
    writer.point_group.set_str("UNITS", "of lengths", unit, len(unit))
    with path.open("wb") as handle, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that there are no analog data
        writer.write(handle)
