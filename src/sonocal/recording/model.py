"""A recording: images, the poses of tracked tools, and when they were taken."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal.errors import InputError
from sonocal.geometry import Array
from sonocal.recording.findings import Diagnostic
from sonocal.recording.frames import Frames, SelectedFrames, no_frames

__all__ = ["ImageGeometry", "Poses", "Provenance", "Recording", "rigidity_error"]

Mask = NDArray[np.bool_]
OnInvalid = Literal["raise", "skip"]

# Files hold matrices rounded to four digits or more; what is further from a rotation is no pose.
RIGID_TOLERANCE = 5e-3


@dataclass(frozen=True, eq=False)
class Poses:
    """One tracked tool: ``target_from_source``, one 4 x 4 matrix an item of the recording.

    Attributes:
        source: what is tracked, such as "Probe".
        target: in whose frame, such as "Tracker".
        matrices: (N, 4, 4); NaN where the file has no pose.
        valid: (N,): the tracker vouches for it (status OK) and every number is finite.
        status: (N,) the status as the file spells it, None where it has none.
    """

    source: str
    target: str
    matrices: Array
    valid: Mask
    status: tuple[str | None, ...] | None = None

    def __post_init__(self) -> None:
        if self.matrices.ndim != 3 or self.matrices.shape[1:] != (4, 4):
            raise InputError(f"{self.name}: poses must have shape (N, 4, 4); got {self.matrices.shape}")
        if self.valid.shape != (len(self.matrices),):
            raise InputError(
                f"{self.name}: valid must have shape ({len(self.matrices)},); got {self.valid.shape}"
            )

    @classmethod
    def of(cls, source: str, target: str, matrices: ArrayLike) -> Poses:
        """Poses of which every finite one is valid."""
        array = np.asarray(matrices, dtype=float)
        return cls(source, target, array, np.isfinite(array).all(axis=(-2, -1)))

    @property
    def name(self) -> str:
        """Such as ``tracker_from_probe``."""
        return f"{_snake(self.target)}_from_{_snake(self.source)}"

    @property
    def plus_name(self) -> str:
        """Such as ``ProbeToTracker``."""
        return f"{self.source}To{self.target}"

    def __len__(self) -> int:
        return len(self.matrices)

    def inverse(self) -> Poses:
        """``source_from_target``."""
        return Poses(self.target, self.source, _inverted(self.matrices, self.valid), self.valid)

    def select(self, rows: ArrayLike) -> Poses:
        """The poses of some items."""
        index = np.arange(len(self))[np.asarray(rows)]
        status = None if self.status is None else tuple(self.status[i] for i in index)
        return replace(self, matrices=self.matrices[index], valid=self.valid[index], status=status)

    def usable(self, source: str, on_invalid: OnInvalid = "raise") -> Poses:
        """The poses with those that are not rigid refused or, with "skip", marked invalid.

        Args:
            source: the recording's name, for the message.
            on_invalid: "raise" or "skip".

        Raises:
            InputError: a valid pose is not rigid.
        """
        bad = self.valid & ~(rigidity_error(self.matrices) <= RIGID_TOLERANCE)
        if on_invalid == "raise" and bad.any():
            frame = int(np.flatnonzero(bad)[0])
            raise InputError(
                f"{source}, frame {frame}: {self.plus_name} is not rigid "
                f"(det R = {np.linalg.det(self.matrices[frame, :3, :3]):.3g}); "
                "drop such frames with --on-invalid skip"
            )
        return replace(self, valid=self.valid & ~bad)


@dataclass(frozen=True, eq=False)
class ImageGeometry:
    """What the images are.

    Attributes:
        size_px: (u, v) or (u, v, w), after they were brought to MF.
        channels: 1, or 3 for colour.
        dtype: of the pixels, such as "uint8".
        orientation: as the file spells it, such as "MFA"; "XX" or "" where it does not say.
        image_from_file: (4, 4): pixels of the MF images from pixels as stored.
        spacing_mm: mm per px along (u, v[, w]) where the file says, else None. PLUS writes 1 into
            tracked sequences for "not known"; such a spacing is None here.
    """

    size_px: tuple[int, ...]
    channels: int
    dtype: str
    orientation: str
    image_from_file: Array
    spacing_mm: tuple[float, ...] | None = None

    @property
    def dimension(self) -> int:
        """2 for images, 3 for volumes."""
        return len(self.size_px)


@dataclass(frozen=True)
class Provenance:
    """Where a recording came from.

    Attributes:
        name: of the file or folder, for messages.
        format: such as "MetaIO sequence".
        paths: every file read.
    """

    name: str = "recording"
    format: str = "memory"
    paths: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Recording:
    """Images and poses on one time line of N items.

    Attributes:
        times: (N,) s, in the recorder's clock; NaN where the file has none.
        frames: N images, decoded when asked for; none in a recording of a tracker alone.
        poses: by name, such as ``poses["tracker_from_probe"]``.
        image: what the images are; None without images.
        image_valid: (N,): the recorder vouches for the image.
        fields: header fields that sonocal does not interpret, kept for writing.
        item_fields: the same of every item, None where an item lacks the field.
        provenance: where it came from.
        diagnostics: what the reader noticed.
    """

    times: Array
    frames: Frames = field(default_factory=no_frames)
    poses: Mapping[str, Poses] = field(default_factory=dict)
    image: ImageGeometry | None = None
    image_valid: Mask = field(default=None)  # type: ignore[arg-type]
    fields: Mapping[str, str] = field(default_factory=dict)
    item_fields: Mapping[str, tuple[str | None, ...]] = field(default_factory=dict)
    provenance: Provenance = Provenance()
    diagnostics: tuple[Diagnostic, ...] = ()

    def __post_init__(self) -> None:
        n = len(self.times)
        if self.image_valid is None:
            object.__setattr__(self, "image_valid", np.full(n, len(self.frames) > 0))
        columns: dict[str, Any] = {"frames": self.frames} if len(self.frames) else {}
        columns |= {"image_valid": self.image_valid, **self.poses, **self.item_fields}
        for name, column in columns.items():
            if len(column) != n:
                raise InputError(f"{self.name}: {name} has {len(column)} entries, the time line {n}")

    def __len__(self) -> int:
        return len(self.times)

    @property
    def name(self) -> str:
        """How messages call it."""
        return self.provenance.name

    @property
    def tools(self) -> tuple[str, ...]:
        """What is tracked, such as ("Probe", "Needle")."""
        return tuple(dict.fromkeys(poses.source for poses in self.poses.values()))

    def tool(self, source: str, target: str | None = None) -> Poses:
        """The poses of one tool, as recorded.

        Args:
            source: its name, such as "Needle"; case has no meaning.
            target: in whose frame, where it is recorded in several.

        Raises:
            InputError: there is no such tool, or several; the sentence names those there are.
        """
        found = [
            poses
            for poses in self.poses.values()
            if poses.source.lower() == source.lower()
            and (target is None or poses.target.lower() == target.lower())
        ]
        if len(found) == 1:
            return found[0]
        have = ", ".join(poses.plus_name for poses in self.poses.values()) or "none"
        wanted = source if target is None else f"{source} in {target}"
        problem = "has no" if not found else "has several"
        raise InputError(f"{self.name}: {problem} transforms of {wanted}; the transforms in it are {have}")

    def between(
        self,
        target: str,
        source: str,
        fixed: Mapping[tuple[str, str], ArrayLike] | None = None,
        on_invalid: OnInvalid = "raise",
    ) -> Poses:
        """``target_from_source`` for every item, chained through whatever frames connect the two.

        Args:
            target: such as "Probe".
            source: such as "Phantom".
            fixed: constant ``(target, source) -> (4, 4)`` beside the recording's, such as a device set's.
            on_invalid: what to do with poses marked valid that are not rigid: "raise" or "skip".

        Returns:
            An item is valid where every pose of the chain is.

        Raises:
            InputError: nothing connects the two, or a pose is not rigid.
        """
        edges = [
            poses
            for poses in self.poses.values()
            if "image" not in (poses.source.lower(), poses.target.lower())
        ]
        edges += [
            Poses.of(b, a, np.broadcast_to(np.asarray(matrix, dtype=float), (len(self), 4, 4)))
            for (a, b), matrix in (fixed or {}).items()
        ]
        chain = _path(edges, target.lower(), source.lower())
        if chain is None:
            have = ", ".join(poses.plus_name for poses in edges) or "none"
            raise InputError(f"{self.name}: nothing connects {source} to {target}; the transforms are {have}")
        matrices, valid = np.tile(np.eye(4), (len(self), 1, 1)), np.ones(len(self), dtype=bool)
        for poses, inverted in chain:
            step = poses.usable(self.name, on_invalid)
            step = step.inverse() if inverted else step
            valid &= step.valid
            matrices = matrices @ step.matrices
        return Poses(source, target, np.where(valid[:, None, None], matrices, np.nan), valid)

    def select(self, rows: ArrayLike) -> Recording:
        """The recording of some items, given by a mask, a slice's range or indices."""
        index = np.arange(len(self))[np.asarray(rows)]
        return replace(
            self,
            times=self.times[index],
            frames=SelectedFrames(self.frames, index.tolist()) if len(self.frames) else self.frames,
            poses={name: poses.select(index) for name, poses in self.poses.items()},
            image_valid=self.image_valid[index],
            item_fields={name: tuple(c[i] for i in index) for name, c in self.item_fields.items()},
        )


def by_name(poses: Iterator[Poses] | list[Poses], name: str) -> dict[str, Poses]:
    """Poses by their name.

    Raises:
        InputError: two transforms differ only in spelling.
    """
    found: dict[str, Poses] = {}
    for one in poses:
        if one.name in found:
            raise InputError(
                f"{name}: {found[one.name].plus_name} and {one.plus_name} are one transform twice; rename one"
            )
        found[one.name] = one
    return found


def rigidity_error(matrices: ArrayLike) -> Array:
    """(...): how far matrices (..., 4, 4) are from rigid; NaN for those that are not finite.

    The largest entry of ``|R^T R - I|`` and of the last row's difference from 0 0 0 1; a mirroring
    matrix gives infinity.
    """
    array = np.asarray(matrices, dtype=float)
    rotation = array[..., :3, :3]
    with np.errstate(invalid="ignore", over="ignore"):
        error = np.abs(np.swapaxes(rotation, -1, -2) @ rotation - np.eye(3)).max(axis=(-2, -1), initial=0.0)
        error = np.maximum(error, np.abs(array[..., 3, :] - [0, 0, 0, 1]).max(axis=-1, initial=0.0))
        mirrored = np.linalg.det(np.where(np.isfinite(rotation), rotation, 0.0)) < 0
    return np.asarray(np.where(mirrored & np.isfinite(error), np.inf, error))


def _path(edges: list[Poses], target: str, source: str) -> list[tuple[Poses, bool]] | None:
    """The shortest chain of ``(poses, inverted)`` whose product is target_from_source."""
    queue: deque[tuple[str, list[tuple[Poses, bool]]]] = deque([(target, [])])
    seen = {target}
    while queue:
        frame, chain = queue.popleft()
        if frame == source:
            return chain
        for poses in edges:
            for here, there, inverted in (
                (poses.target.lower(), poses.source.lower(), False),
                (poses.source.lower(), poses.target.lower(), True),
            ):
                if here == frame and there not in seen:
                    seen.add(there)
                    queue.append((there, [*chain, (poses, inverted)]))
    return None


def _inverted(matrices: Array, valid: Mask) -> Array:
    # The general inverse, not the transpose: files round rotations, and a chain should undo what they state.
    inverse = np.full_like(matrices, np.nan)
    inverse[valid] = np.linalg.inv(matrices[valid])
    return inverse


def _snake(name: str) -> str:
    words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name)
    return re.sub(r"\W+", "_", words).lower()
