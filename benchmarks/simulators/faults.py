"""Scans made wrong in one way each, and what the checks find in them."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Iterable

import numpy as np
from scipy.spatial.transform import Rotation

import sonocal as sc
from benchmarks.simulators.scans import (
    SCALE,
    scan,
)
from sonocal.calibration import evidence_of, point_line_rows
from sonocal.findings import Diagnostic
from sonocal.setup_checks import (
    check_flip,
    check_needle_end,
    check_scale,
    check_setup,
    check_slip,
    check_tool_frame,
)

Findings = Iterable[Diagnostic]

CODES = (
    "scale-differs-from-scanner",
    "flipped-image",
    "marker-slipped",
    "wrong-tool-frame",
    "wrong-end-of-needle",
    "latency",
    "anisotropic-scale",
)


@functools.cache
def sound(seed, dimension=2):
    """A scan with nothing wrong, and its calibration."""
    one = scan(seed, dimension=dimension)
    return one, sc.calibrate(one.observations)


def evidence_of_sound(seed, dimension=2):
    """A scan with nothing wrong, as the checks take it."""
    one, found = sound(seed, dimension)
    return evidence_of(found, one.observations)


def altered(rows, **columns):
    """The rows with some columns replaced."""
    return dataclasses.replace(rows, **columns)


def carried(rows, poses):
    """The lines, each carried by its row's pose."""
    moved = np.einsum("nij,nkj->nki", poses[:, :3, :3], rows.segments_mm) + poses[:, None, :3, 3]
    return altered(rows, segments_mm=moved)


def rough(rotation, seed):
    """A known orientation as a user knows it: off by some 15 degrees."""
    return rotation @ Rotation.from_rotvec(np.random.default_rng(seed).normal(scale=0.15, size=3)).as_matrix()


def findings_of_sound(seed, dimension):
    """Everything that is found in a sound scan of which everything is known."""
    one, found = sound(seed, dimension)
    findings = check_setup(
        evidence_of(found, one.observations),
        scanner_mm_per_px=SCALE,
        expected_rotation=rough(one.truth.rotation, seed),
        tracker_from_probe=one.tracker_from_probe,
    )
    return (*findings, *found.diagnostics)


def other_scale(seed):
    """The scanner says 4 % more or less."""
    return check_scale(evidence_of_sound(seed), SCALE * (1.04 if seed % 2 else 0.96))


def flipped(seed, flip):
    """A mirrored or turned 2D image; the orientation is roughly known."""
    one, _ = sound(seed)
    rows = altered(one.observations, points_px=250 + (one.observations.points_px - 250) * flip)
    return check_flip(
        evidence_of(sc.calibrate(rows), rows), expected_rotation=rough(one.truth.rotation, seed)
    )


def upside_down(seed):
    """An upside-down 2D image; the marker is known to be on the handle."""
    rows = sound(seed)[0].observations
    rows = altered(rows, points_px=[0, 500] + rows.points_px * np.array([1, -1]))
    return check_flip(evidence_of(sc.calibrate(rows), rows), marker_above_image=True)


def mirrored_volume(seed):
    """A volume mirrored along one axis."""
    rows = sound(seed, 3)[0].observations
    mirror = np.ones(3)
    mirror[seed % 3] = -1
    rows = altered(rows, points_px=250 + (rows.points_px - 250) * mirror)
    return check_flip(evidence_of(sc.calibrate(rows), rows))


def slipped(seed):
    """The marker turns by 2 degrees and moves by 4 mm at some moment in the middle third."""
    rng = np.random.default_rng(seed)
    turn, shift = rng.normal(size=(2, 3))
    slip = (np.radians(2) * turn / np.linalg.norm(turn), 4 * shift / np.linalg.norm(shift))
    rows = scan(seed, slip=slip, slip_at=rng.uniform(0.35, 0.65)).observations
    return check_slip(evidence_of(sc.calibrate(rows), rows))


def other_frame(seed, *, poses_known):
    """The lines are in the tracker's frame, or carried the wrong way round."""
    one, _ = sound(seed)
    poses = one.tracker_from_probe if seed % 2 else np.linalg.inv(one.tracker_from_probe)
    known = {"tracker_from_probe": one.tracker_from_probe} if poses_known else {}
    return check_tool_frame(point_line_rows(carried(one.observations, poses)), **known)


def other_end(seed):
    """The needle's far end has the wrong sign: the same line, on the other side of its marker."""
    rows = sound(seed)[0].observations
    wrong = rows.segments_mm.copy()
    wrong[:, 1] = 2 * wrong[:, 0] - wrong[:, 1]
    rows = altered(rows, segments_mm=wrong)
    return check_needle_end(evidence_of(sc.calibrate(rows), rows))


def late(seed, latency_s):
    """Tracker or image come late."""
    rows = scan(seed, latency_s=latency_s).observations
    return check_setup(evidence_of(sc.calibrate(rows), rows))


def unequal_pixels(seed):
    """Pixels 6 % wider than high."""
    rows = sound(seed)[0].observations
    return sc.calibrate(altered(rows, points_px=rows.points_px * [1, 1.06])).diagnostics


FAULTS: dict[str, tuple[str, Callable[[int], Findings]]] = {
    "mm/px 4 % off the scanner's": ("scale-differs-from-scanner", other_scale),
    "left and right exchanged": ("flipped-image", lambda seed: flipped(seed, (-1, 1))),
    "top and bottom exchanged": ("flipped-image", lambda seed: flipped(seed, (1, -1))),
    "half a turn": ("flipped-image", lambda seed: flipped(seed, (-1, -1))),
    "upside down, marker on the handle": ("flipped-image", upside_down),
    "mirrored volume": ("flipped-image", mirrored_volume),
    "marker slips by 2 deg and 4 mm": ("marker-slipped", slipped),
    "lines in another frame, poses known": (
        "wrong-tool-frame",
        lambda seed: other_frame(seed, poses_known=True),
    ),
    "lines in another frame": ("wrong-tool-frame", lambda seed: other_frame(seed, poses_known=False)),
    "wrong end of the needle": ("wrong-end-of-needle", other_end),
    "tracker late by 100 ms": ("latency", lambda seed: late(seed, 0.1)),
    "image late by 100 ms": ("latency", lambda seed: late(seed, -0.1)),
    "pixels 6 % wider than high": ("anisotropic-scale", unequal_pixels),
}


def raised(findings: Findings, code: str) -> bool:
    """Whether a code is among the findings, once."""
    return [finding.code for finding in findings].count(code) == 1


def is_found(name: str, seed: int) -> bool:
    """Whether a fault put into a scan is found."""
    code, findings = FAULTS[name]
    return raised(findings(seed), code)


def false_alarms(dimension: int, seeds: Iterable[int]) -> dict[str, int]:
    """How many sound scans raise each code."""
    counts = dict.fromkeys(CODES, 0)
    for seed in seeds:
        for code in {finding.code for finding in findings_of_sound(seed, dimension)} & set(CODES):
            counts[code] += 1
    return counts
