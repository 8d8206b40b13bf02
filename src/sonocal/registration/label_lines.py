"""Lines of volumes and the wires that they may be of: as dots of images, each by its two ends."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal.errors import InputError
from sonocal.geometry import Array, segment_directions
from sonocal.registration.label_input import numbers, sorted_by_frame
from sonocal.registration.label_table import LabelTable, Settled, Shifted, distances_from

__all__ = ["FEWEST", "LineTable"]

# Rounds of choosing and fitting, and how many thresholds far is chosen in each.
ROUNDS = (3.0, 2.0, 1.5, 1.0, 1.0, 1.0)
# What one line costs at most, nats: as of dots.
MOST_NATS = 4.5
# A fit has seven unknowns, and a line on a wire tells four.
FEWEST = 2
# Wires nearer to parallel than that, in all volumes, hardly tell where along them a volume lies.
NEARLY_PARALLEL_DEG = 10.0


@dataclass(frozen=True, eq=False)
class LineTable(LabelTable):
    """Lines of volumes, frame by frame.

    Attributes:
        points: (N, 2, 3), px: two points on each, at the ends of what is seen.

    The others are those of `LabelTable`. A line's distance from a wire is that of its ends, root mean square.
    """

    sample: ClassVar[int] = 2
    # Of six wires that are elsewhere four may be met.
    most_hardly_seen: ClassVar[float] = 1 / 4

    @classmethod
    def of(cls, points: ArrayLike, wires: ArrayLike, frame: ArrayLike | None) -> LineTable:
        """The table of what a user gave.

        Raises:
            InputError: shapes differ, a number is not finite, or a frame does not exist.
        """
        lines = numbers("points", points, (2, 3), "(N, 2) px, or (N, 2, 3) px of volumes' lines")
        if (lines[:, 0] == lines[:, 1]).all(axis=-1).any():
            raise InputError("points holds a line whose two points are one; give two places on each")
        return cls(*sorted_by_frame(lines, wires, frame))

    def why_none(self) -> str:
        """Why no answer was found, as far as can be told."""
        if len(self.points) < FEWEST or (widest_deg := self._widest_deg()) > NEARLY_PARALLEL_DEG:
            return super().why_none()
        return (
            f"all lines are parallel to within {widest_deg:.1f} degrees, in every volume: none shows where along them "
            "the probe is; turn the probe by 20 degrees and more from volume to volume, or add a line across the others"
        )

    def settled(self, starts: Array, threshold_mm: float) -> list[Settled]:
        """From rough similarities (K, 4, 4) to labels and least squares, in turn, on all frames."""
        found = (self._settled(start, threshold_mm) for start in starts)
        return [one for one in found if one is not None]

    def mapped_mm(self, matrix: Array) -> Array:
        """(2 N, 3): where a similarity takes the ends."""
        return np.asarray(self.points.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3])

    def distances_mm(self, matrix: Array) -> Array:
        """(N, L): of each line from each wire of its frame."""
        ends = self.mapped_mm(matrix).reshape(-1, 1, 2, 3)
        each = distances_from(ends, self.wires[self.frame][:, :, None])
        return np.asarray(np.sqrt(np.mean(each**2, axis=-1)))

    def box_mm2(self, scale: float) -> float:
        """The area of a side of a cube as large as the box that holds all ends."""
        sides = np.ptp(self.points.reshape(-1, 3), axis=0) * scale if len(self.points) else np.zeros(3)
        return max(float(np.cbrt(np.prod(sides)) ** 2), 1e-9)

    def chance(self, scale: float, within_mm: float) -> float:
        """How many wires both ends of a line are near to that lies anywhere, on average."""
        one = np.pi * within_mm**2 / self.box_mm2(scale)
        return float(self.wires.shape[1] * one**2)

    def shifted(
        self, answers: list[Settled], threshold_mm: float, dot_mm: float, shift_mm: float
    ) -> list[Shifted]:
        """What each of some answers costs, frame by frame, with errors of lines and of frames (standard deviations)."""
        return [self._shifted(one, dot_mm, shift_mm) for one in answers]

    def own_labels(self, distances_mm: Array, within_mm: float) -> NDArray[np.int32]:
        """(N,): the wire of each line, -1 for none: the nearest, and of a frame's lines the nearest one has it."""
        wire = distances_mm.argmin(axis=1)
        least = distances_mm[np.arange(len(wire)), wire]
        labels = np.full(len(wire), -1, dtype=np.int32)
        order = np.argsort(least, kind="stable")
        order = order[least[order] <= within_mm]
        place = self.frame[order] * distances_mm.shape[1] + wire[order]
        keep = order[np.unique(place, return_index=True)[1]]
        labels[keep] = wire[keep]
        return labels

    def _widest_deg(self) -> float:
        """The widest angle of a wire with the one that is farthest from the common direction of all, in any frame."""
        along = segment_directions(self.wires[np.diff(self.first) > 0]).reshape(-1, 3)
        common = np.linalg.eigh(along.T @ along)[1][:, 2]
        farthest = along[np.argmin(np.abs(along @ common))]
        return float(np.degrees(np.arccos(np.clip(np.abs(along @ farthest).min(), 0, 1))))

    def _settled(self, start: Array, threshold_mm: float) -> Settled | None:
        matrix = start
        for reach in ROUNDS:
            labels = self.own_labels(self.distances_mm(matrix), reach * threshold_mm)
            if np.count_nonzero(labels >= 0) < FEWEST:
                return None
            matrix = self._fitted(matrix, labels)
            if not np.isfinite(matrix).all():
                return None
        distances = self.distances_mm(matrix)
        labels = self.own_labels(distances, threshold_mm)
        own = np.where(labels >= 0, distances[np.arange(len(labels)), labels], np.nan)
        return Settled(matrix, labels, own, float(np.nansum(1 - (own / threshold_mm) ** 2)))

    def _fitted(self, matrix: Array, labels: NDArray[np.int32]) -> Array:
        """One step of Gauss and Newton on the ends' distances from their wires."""
        given = np.flatnonzero(labels >= 0)
        mapped = self.mapped_mm(matrix).reshape(-1, 2, 3)[given]
        away, across = self._away(mapped, given, labels)
        middle = mapped.reshape(-1, 3).mean(axis=0)
        arms = mapped - middle
        # Of a point that turns about the middle, moves, and grows away from it.
        turning = np.zeros((*arms.shape[:2], 3, 3))
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            turning[..., i, j], turning[..., i, k] = arms[..., k], -arms[..., j]
        moving = np.broadcast_to(np.eye(3), turning.shape)
        linear = np.concatenate([turning, moving, arms[..., None]], axis=-1)
        linear = np.einsum("nij,nejk->neik", across, linear).reshape(-1, 7)
        step = np.linalg.lstsq(linear, -away.reshape(-1), rcond=1e-9)[0]
        return _moved(matrix, middle, step)

    def _away(self, mapped: Array, given: NDArray[np.intp], labels: NDArray[np.int32]) -> tuple[Array, Array]:
        """Vectors (M, 2, 3) from wires to ends, and (M, 3, 3) what takes the part across a wire."""
        ends = self.wires[self.frame[given], labels[given]]
        along = ends[:, 1] - ends[:, 0]
        along = along / np.linalg.norm(along, axis=1, keepdims=True)
        across = np.eye(3) - along[:, :, None] * along[:, None]
        return np.einsum("nij,nej->nei", across, mapped - ends[:, :1]), across

    def _shifted(self, one: Settled, dot_mm: float, shift_mm: float) -> Shifted:
        """The labels stay: a shift is a part of what tells wires apart."""
        frames, given = len(self.wires), np.flatnonzero(one.labels >= 0)
        mapped = self.mapped_mm(one.matrix).reshape(-1, 2, 3)[given]
        away, across = self._away(mapped, given, one.labels)
        # Both ends of a line err together: they count as one dot.
        normal, side = np.tile(np.eye(3) / shift_mm**2, (frames, 1, 1)), np.zeros((frames, 3))
        np.add.at(normal, self.frame[given], across / dot_mm**2)
        np.add.at(side, self.frame[given], -away.mean(axis=1) / dot_mm**2)
        shifts = np.linalg.solve(normal, side[..., None])[..., 0]
        left = away + np.einsum("nij,nj->ni", across, shifts[self.frame[given]])[:, None]
        distances = np.full(len(one.labels), np.nan)
        distances[given] = np.sqrt(np.mean(np.sum(left**2, axis=-1), axis=-1))
        each = np.where(np.isnan(distances), MOST_NATS, np.minimum(distances**2 / (2 * dot_mm**2), MOST_NATS))
        costs = np.bincount(self.frame, each, minlength=frames).astype(float)
        costs = costs + (shifts**2).sum(axis=1) / (2 * shift_mm**2)
        return Shifted(costs, one.labels, distances, np.asarray(shifts))


def _moved(matrix: Array, middle: Array, step: Array) -> Array:
    """A similarity (4, 4) followed by a small turn about a place, a shift and a growth."""
    from scipy.spatial.transform import Rotation

    out = np.eye(4)
    out[:3, :3] = np.exp(np.clip(step[6], -1, 1)) * Rotation.from_rotvec(step[:3]).as_matrix()
    out[:3, 3] = middle + step[3:6] - out[:3, :3] @ middle
    return np.asarray(out @ matrix)
