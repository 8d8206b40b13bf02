"""Where a target was found with the calibration, drawn in its own frame: how well that is known, and what was said."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sonocal.calibration import Calibration
from sonocal.calibration.found_targets import REACH_MM, FoundTarget
from sonocal.errors import InputError, require
from sonocal.geometry import Array
from sonocal.registration.uncertainty import NORMAL_95
from sonocal.report.style import FITTED, HELD_OUT, INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["plot_place"]

STEPS = 81
PLANE_95 = 2.4477
"""Radius of the circle that 95 % of pairs of normal deviates are within."""


class _Said(NamedTuple):
    """Where a target was said to be, roughly: beside where it was found, in the axes of that.

    Attributes:
        off_mm: (A,): across it, at the middle of what was seen.
        slope: (A, 3 - A): how that grows along it.
        away_mm: (3 - A,): along it, from there to where it was said.
        sigma_mm, sigma_deg: how roughly.
    """

    off_mm: Array
    slope: Array
    away_mm: Array
    sigma_mm: float
    sigma_deg: float


def plot_place(axis: Axes, calibration: Calibration, name: str) -> None:
    """A target's place in its own frame, with what 95 % of errors are within, and where it was said to be.

    A line or plane from its side, along what it is least known along: what is off it is drawn many times enlarged. A
    point in the plane in which it is least known.

    Args:
        axis: to draw on.
        calibration: which found it.
        name: of the target.

    Raises:
        InputError: the calibration found no such target.
    """
    require("calibration", calibration, Calibration)
    if name not in calibration.targets:
        have = ", ".join(calibration.targets) or "none"
        raise InputError(f"the calibration found no target {name!r}; its targets are: {have}"[:200])
    target = calibration.targets[name]
    said = _said(calibration, name, target)
    (_draw_point if target.kind == "point" else _draw_profile)(axis, target, said)
    title = f"{target.kind.capitalize()} {name!r} in the frame {target.frame}"
    axis.set_title(title.replace("$", r"\$"))  # which would be mathematics
    axis.legend(loc="best")


def _draw_point(axis: Axes, target: FoundTarget, said: _Said | None) -> None:
    covariance = np.array(target.covariance)
    first, second = np.linalg.eigh(covariance)[1].T[[2, 1]]
    if said is not None and np.linalg.norm(said.off_mm) > 0:
        first = said.off_mm / np.linalg.norm(said.off_mm)
        rest = np.linalg.svd(first[None])[2][1:]
        second = rest.T @ np.linalg.eigh(rest @ covariance @ rest.T)[1][:, -1]
    shown = np.stack([first, second])
    angle = np.linspace(0, 2 * np.pi, STEPS)
    circle = PLANE_95 * np.stack([np.cos(angle), np.sin(angle)])
    axis.plot(*np.linalg.cholesky(shown @ covariance @ shown.T) @ circle, color=FITTED, linewidth=1.2)
    axis.plot(0, 0, "o", color=FITTED, markersize=4, label="found, 95 %")
    if said is not None:
        there = shown @ said.off_mm
        axis.plot(*(there[:, None] + said.sigma_mm * circle), color=HELD_OUT, linewidth=1.0, linestyle="--")
        axis.plot(*there, "D", color=HELD_OUT, markersize=4, label="where it was said to be, 95 %")
    axis.set_aspect("equal", adjustable="datalim")
    axis.set_xlabel(f"mm along {_in_words(shown[0] @ np.array(target.axes).T)}")
    axis.set_ylabel(f"mm along {_in_words(shown[1] @ np.array(target.axes).T)}")


def _draw_profile(axis: Axes, target: FoundTarget, said: _Said | None) -> None:
    axes, across, along = np.array(target.axes), *_seen_from(target, said)
    where = np.linspace(-REACH_MM, REACH_MM, STEPS)
    half = NORMAL_95 * _sigma_at(target, across, along, where)
    axis.fill_between(where, -half, half, color=FITTED, alpha=0.2, linewidth=0, label="95 %")
    axis.plot(where, 0 * where, color=FITTED, linewidth=1.5, label="found")
    if said is not None:
        there = across @ said.off_mm + where * (across @ said.slope @ along)
        far = where - along @ said.away_mm
        known = NORMAL_95 * np.hypot(said.sigma_mm, far * np.radians(said.sigma_deg))
        axis.plot(
            where, there, color=HELD_OUT, linewidth=1.2, linestyle="--", label="where it was said to be"
        )
        axis.fill_between(where, there - known, there + known, color=HELD_OUT, alpha=0.15, linewidth=0)
    axis.axhline(0, color=INK, linewidth=0.4)
    normals = len(across)
    axis.set_xlabel(f"mm along {_in_words(axes[:, normals:] @ along)}")
    axis.set_ylabel(f"mm along {_in_words(axes[:, :normals] @ across)}")


def _seen_from(target: FoundTarget, said: _Said | None) -> tuple[Array, Array]:
    """Directions across (A,) and along (3 - A,) a line or plane in its axes: as it is least known, or as it is off."""
    normals = 4 - len(target.spanning_mm)
    covariance = np.array(target.covariance)
    turns = covariance[normals:, normals:]
    if target.kind == "line":
        loosest = np.linalg.eigh(covariance[:2, :2] + REACH_MM**2 * turns)[1][:, -1]
        off = None if said is None else said.off_mm + REACH_MM * said.slope[:, 0]
        if off is not None and np.linalg.norm(off) > 0:
            loosest = off / np.linalg.norm(off)
        return loosest, np.ones(1)
    along = np.linalg.eigh(turns)[1][:, -1]
    if said is not None and np.linalg.norm(said.slope) > 0:
        along = said.slope[0] / np.linalg.norm(said.slope)
    return np.ones(1), along


def _sigma_at(target: FoundTarget, across: Array, along: Array, where: Array) -> Array:
    """(W,): standard deviation across a target at places along it; turns are of normals towards what is along it."""
    turns = -where[:, None] * np.kron(across, along)
    linear = np.concatenate([np.broadcast_to(across, (len(where), len(across))), turns], axis=1)
    return np.asarray(np.sqrt(np.einsum("wi,ij,wj->w", linear, np.array(target.covariance), linear)))


def _said(calibration: Calibration, name: str, target: FoundTarget) -> _Said | None:
    given = next((one for one in calibration.options.targets or () if one.name == name), None)
    sigma_mm, sigma_deg = getattr(given, "sigma_mm", np.inf), getattr(given, "sigma_deg", np.inf)
    if given is None or given.spanning_mm is None or not np.isfinite(sigma_mm):
        return None
    spans, axes = len(target.spanning_mm), np.array(target.axes)
    across, along = axes[:, : 4 - spans], axes[:, 4 - spans :]
    middle = given.spanning_mm.mean(axis=0)
    away = middle - target.middle_mm
    slope: Array = np.zeros((4 - spans, spans - 1))
    if spans > 1:
        said_along = np.linalg.svd(given.spanning_mm - middle)[2][: spans - 1].T
        slope = across.T @ said_along @ np.linalg.inv(along.T @ said_along)
    off = across.T @ away - slope @ (along.T @ away)
    return _Said(off, slope, along.T @ away, float(sigma_mm), float(sigma_deg) if spans > 1 else 0.0)


def _in_words(direction: Array) -> str:
    """A direction of a frame as its three numbers."""
    return f"({', '.join(f'{x + 0.0:.2f}' for x in direction)})"
