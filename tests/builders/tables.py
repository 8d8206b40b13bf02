"""Poses in tables, in each form that a tracker may export."""

import csv

import numpy as np
from scipy.spatial.transform import Rotation

N = 12


TIMES = np.arange(N) * 0.1


def quaternions_xyzw(matrices):
    return Rotation.from_matrix(matrices[:, :3, :3]).as_quat()


def write_table(path, header, rows):
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(header)
        writer.writerows(rows)


def matrices_in(form, path, matrices, blank=()):
    """One recording in each form a tracker may export."""
    q, p = quaternions_xyzw(matrices), matrices[:, :3, 3]
    if form == "cells":
        header = ["Timestamp", "NeedleToTrackerTransform", "NeedleToTrackerTransformStatus"]
        rows = [
            [t, " ".join(map(repr, m.ravel().tolist())), "OK"] for t, m in zip(TIMES, matrices, strict=True)
        ]
    elif form == "matrix":
        header = ["time_s", *(f"Needle_m{i}{j}" for i in range(4) for j in range(4))]
        rows = [[t, *m.ravel().tolist()] for t, m in zip(TIMES, matrices, strict=True)]
    else:
        unit, scale = ("_m", 1e-3) if form == "metres" else ("_mm", 1.0)
        header = [
            "time_s",
            *(f"Needle_{k}" for k in ("qx", "qy", "qz", "qw")),
            *(f"Needle_{a}{unit}" for a in "xyz"),
        ]
        rows = [[t, *a.tolist(), *(scale * b).tolist()] for t, a, b in zip(TIMES, q, p, strict=True)]
    for row in blank:
        rows[row][1:] = [""] * (len(header) - 1)
    write_table(path, header, rows)


def motive(path, matrices, unit="Meters", blank=(), kind="Quaternion"):
    scale = 1e-3 if unit == "Meters" else 1.0
    rows = [
        ["Format Version", "1.23", "Take Name", "Take 1", "Rotation Type", kind, "Length Units", unit],
        [],
        ["", "Type", *["Rigid Body"] * 8, *["Rigid Body Marker"] * 3],
        ["", "Name", *["Needle"] * 8, *["Needle:Marker1"] * 3],
        ["", "ID", *["8A"] * 8, *["8B"] * 3],
        ["", "", *["Rotation"] * 4, *["Position"] * 3, "Mean Marker Error", *["Position"] * 3],
        ["Frame", "Time (Seconds)", *"XYZW", *"XYZ", "", *"XYZ"],
    ]
    for i, (q, p) in enumerate(zip(quaternions_xyzw(matrices), scale * matrices[:, :3, 3], strict=True)):
        cells = [""] * 11 if i in blank else [*q.tolist(), *p.tolist(), 0.1, 1, 2, 3]
        rows.append([i, TIMES[i], *cells])
    with path.open("w", newline="") as file:
        csv.writer(file).writerows(rows)


def moving(step_mm=1.0):
    matrices = np.tile(np.eye(4), (N, 1, 1))
    matrices[:, 0, 3] = step_mm * np.arange(N)
    return matrices
