"""The line through a needle's first echo in a volume.

Reverberations lie behind a needle and pull the middle of what is bright down the beam. A Gaussian pulse,
logarithmically compressed, is a paraboloid of grey levels: fitted to the flank that faces away from the tail, it has
its top where the first echo has. `echo_fit.hpp` does the same in images.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array

__all__ = ["Echo", "first_echo"]

REACH_PX = 3.0
"""What is looked at around the line."""
CORE_PX = 1.5
"""Where the needle's own brightness is."""
LEVEL = 0.7
"""Of the contrast, above which a voxel belongs to the pulse and not to its wings."""
WHITE = 250.0
"""Saturated voxels say nothing of the pulse's shape."""
WINDOW_PX = 3.0
"""Along the line, standard deviation: what takes part in one paraboloid."""
BEYOND_PX = 0.5
"""How far behind the top a voxel still belongs to the flank: voxels lie wide apart."""
ROUNDS = 2
TAIL = 0.3
"""Of the contrast, above which a voxel tells where the tail lies."""
FAINT = 0.3
"""Of the usual contrast: where the needle is fainter it is not looked for."""
FARTHEST_PX = 1.5
TAIL_SLOPE = 3.7
"""Grey levels a voxel by which a simulated tail tilts the flank: it moves the top by slope / (2 curvature)."""
WIDEST_PX = 5.0
"""From a pulse's middle to where its paraboloid reaches the surroundings: what is blunter is none."""


@dataclass(frozen=True, eq=False)
class Echo:
    """The first echo in sections across a line.

    Attributes:
        points_px: (N, 3): its middle, (u, v, w).
        tail: (3,): unit vector across the line to where the tail lies.
        sigma_px: (N,): standard deviation of the middle along the tail.
    """

    points_px: Array
    tail: Array
    sigma_px: Array


@dataclass(frozen=True, eq=False)
class _Tube:
    """Voxels around a line: `station` is the nearest whole voxel along it, `across` (N, 2) lies in `axes` (2, 3)."""

    station: NDArray[np.int64]
    across: Array
    grey: Array
    axes: Array
    stations: Array

    @property
    def count(self) -> int:
        return len(self.stations)


def first_echo(grey: NDArray[np.float32], ends: Array) -> Echo:
    """The first echo along a line that lies within a voxel or so of it.

    Args:
        grey: indexed [w, v, u].
        ends: (2, 3): where the line begins and ends, (u, v, w).

    Returns:
        The echo in sections a voxel apart; none where it is too faint or too blunt.
    """
    tube = _tube(grey, ends)
    distance = np.linalg.norm(tube.across, axis=1)
    around = float(np.median(tube.grey[distance > CORE_PX])) if len(tube.grey) else 0.0
    tube = _tail_first(tube, distance, around)
    top = _tops(tube, distance <= CORE_PX, around)
    shown = top - around > FAINT * np.median(top - around)
    height = top[tube.station]
    pulse = (tube.grey > around + LEVEL * (height - around)) & (tube.grey < WHITE) & shown[tube.station]
    bluntest = (top - around) / WIDEST_PX**2
    middle, curvature, found = _paraboloids(tube, pulse, tube.grey - height, bluntest)
    for _ in range(ROUNDS):
        offset = tube.across - middle[tube.station]
        along_tail = curvature[tube.station, 0]
        flank = (offset * along_tail).sum(axis=1) <= BEYOND_PX * along_tail[:, 0]
        kept = pulse & flank & found[tube.station]
        middle, curvature, better = _paraboloids(tube, kept, tube.grey - height, bluntest)
        found &= better
    keep = found & shown
    return Echo(
        tube.stations[keep] + middle[keep] @ tube.axes,
        tube.axes[0],
        TAIL_SLOPE / (2 * curvature[keep, 0, 0]),
    )


def _tube(grey: NDArray[np.float32], ends: Array) -> _Tube:
    """The voxels within reach of a line, each once: planes across its main axis hold them."""
    along = ends[1] - ends[0]
    length = float(np.linalg.norm(along))
    along = along / length
    main = int(np.argmax(np.abs(along)))
    first, last = sorted(ends[:, main])
    planes = np.arange(np.ceil(first), np.floor(last) + 1)
    middles = ends[0] + ((planes - ends[0, main]) / along[main])[:, None] * along
    reach = int(np.ceil(REACH_PX / abs(along[main])))
    square = np.moveaxis(np.mgrid[-reach : reach + 1, -reach : reach + 1], 0, -1).reshape(-1, 2)
    voxels = np.rint(middles).astype(int)[:, None] + np.insert(square, main, 0, axis=1)
    voxels = voxels.reshape(-1, 3)
    voxels = voxels[((voxels >= 0) & (voxels < grey.shape[::-1])).all(axis=1)]
    place = (voxels - ends[0]) @ along
    offset = voxels - ends[0] - place[:, None] * along
    station = np.rint(place).astype(int)
    stations = int(length) + 1
    near = (np.linalg.norm(offset, axis=1) <= REACH_PX) & (station >= 0) & (station < stations)
    axes = np.linalg.svd(along[None])[2][1:]
    return _Tube(
        station[near],
        offset[near] @ axes.T,
        grey[tuple(voxels[near].T[::-1])].astype(float),
        axes,
        ends[0] + np.arange(stations)[:, None] * along,
    )


def _tail_first(tube: _Tube, distance: Array, around: float) -> _Tube:
    """The tube with its first axis turned to where the tail lies: beams run as they please through a volume."""
    usual = np.percentile(tube.grey[distance <= CORE_PX], 80) - around
    excess = np.maximum(tube.grey - around - TAIL * usual, 0)
    tail = excess @ tube.across
    tail = tail / max(float(np.linalg.norm(tail)), 1e-12)
    turn = np.array([tail, [-tail[1], tail[0]]])
    return _Tube(tube.station, tube.across @ turn.T, tube.grey, turn @ tube.axes, tube.stations)


def _tops(tube: _Tube, core: NDArray[np.bool_], around: float) -> Array:
    """(stations,): how bright the needle is; a section may meet no voxel near its middle."""
    from scipy.ndimage import gaussian_filter1d, maximum_filter1d

    top = np.full(tube.count, around)
    np.maximum.at(top, tube.station[core], tube.grey[core])
    return np.asarray(gaussian_filter1d(maximum_filter1d(top, 3), 1.0, mode="nearest"))


def _paraboloids(
    tube: _Tube, keep: NDArray[np.bool_], height: Array, bluntest: Array
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """A paraboloid at every station from the voxels near it: top (S, 2), curvature (S, 2, 2), whether it is one."""
    from scipy.ndimage import gaussian_filter1d

    a, b = tube.across[keep].T
    rows = np.stack([np.ones_like(a), a, b, a * a, a * b, b * b, height[keep]])
    products = np.stack([first * second for first in rows for second in rows])
    sums = np.stack([np.bincount(tube.station[keep], one, tube.count) for one in products])
    normal = gaussian_filter1d(sums, WINDOW_PX, mode="constant").T.reshape(-1, 7, 7)
    ridge = 1e-9 * (1 + np.trace(normal, axis1=1, axis2=2))[:, None, None] * np.eye(6)
    c = np.linalg.solve(normal[:, :6, :6] + ridge, normal[:, :6, 6:])[..., 0]
    curvature = -np.stack([c[:, 3], c[:, 4] / 2, c[:, 4] / 2, c[:, 5]], axis=-1).reshape(-1, 2, 2)
    steep = np.linalg.eigvalsh(curvature)[:, 0] > np.maximum(bluntest, 1e-6)
    curvature[~steep] = np.eye(2)
    top = 0.5 * np.linalg.solve(curvature, c[:, 1:3, None])[..., 0]
    return top, curvature, steep & (np.abs(top) < FARTHEST_PX).all(axis=1)
