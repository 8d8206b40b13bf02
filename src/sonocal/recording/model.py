"""A recording: images, the poses of tracked tools, and when they were taken."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sonocal.errors import InputError, require
from sonocal.findings import Diagnostic
from sonocal.geometry import Array
from sonocal.geometry.cards import card
from sonocal.geometry.shown import brief
from sonocal.recording.frames import Frames, SelectedFrames, no_frames
from sonocal.recording.poses import Mask, OnInvalid, Poses, chosen
from sonocal.recording.thumbnail import thumbnail

__all__ = ["ImageGeometry", "Provenance", "Recording"]

# Rows of a card, of a kind.
MOST_TOOLS = 8


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

    __repr__ = brief

    @classmethod
    def of(
        cls,
        frames: Frames,
        dimension: int = 2,
        orientation: str = "",
        spacing_mm: tuple[float, ...] | None = None,
    ) -> ImageGeometry:
        """The geometry of frames that lie as MF does; say ``orientation="MF"`` where that is known."""
        size = tuple(int(n) for n in frames.shape[:dimension][::-1])
        channels = frames.shape[dimension] if len(frames.shape) > dimension else 1
        return cls(size, channels, frames.dtype.name, orientation, np.eye(4), spacing_mm)

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
        lengths: what the poses' lengths were read as, before they came to mm: "metres", ..., or "" where the file
            must say it and does not.
    """

    name: str = "recording"
    format: str = "memory"
    paths: tuple[str, ...] = ()
    lengths: str = "millimetres"

    __repr__ = brief


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
        latency_s: how much later the tracker stamps an instant than the images do, where the poses were moved by it:
            0 where they are as recorded; see `with_latency`.
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
    latency_s: float = 0.0

    def __post_init__(self) -> None:
        n = len(self.times)
        if self.image_valid is None:
            object.__setattr__(self, "image_valid", np.full(n, len(self.frames) > 0))
        if len(self.frames) and self.image is None:
            raise InputError(
                f"{self.name}: has frames of unknown geometry; give image=ImageGeometry.of(frames)"
            )
        columns: dict[str, Any] = {"frames": self.frames} if len(self.frames) else {}
        columns |= {"image_valid": self.image_valid, **self.poses, **self.item_fields}
        for name, column in columns.items():
            if len(column) != n:
                raise InputError(f"{self.name}: {name} has {len(column)} entries, the time line {n}")

    def __len__(self) -> int:
        return len(self.times)

    def __repr__(self) -> str:
        images = (
            "no images" if self.image is None else f"images of {' x '.join(map(str, self.image.size_px))} px"
        )
        return f"<Recording {self.name[:40]!r}: {len(self)} items, {images}, {len(self.poses)} tracked poses>"

    def _repr_html_(self) -> str:
        rows = [("from", self.provenance.format)]
        if self.image is not None:
            size = " x ".join(map(str, self.image.size_px))
            rows.append(
                ("images" if self.image.dimension == 2 else "volumes", f"{size} px, {self.image.dtype}")
            )
        rows += [
            (poses.plus_name, f"{np.count_nonzero(poses.valid)} of {len(self)} poses valid")
            for poses in list(self.poses.values())[:MOST_TOOLS]
        ]
        rows += [(one.severity, one.message) for one in self.diagnostics[:MOST_TOOLS]]
        lasted = float(np.ptp(self.times)) if len(self) and np.isfinite(self.times).all() else None
        text = f"{len(self)} items" + ("" if lasted is None else f" over {lasted:.1f} s")
        picture = "" if self.image is None else thumbnail(self.frames, self.image.dimension)
        return card(self.name[:80], text, rows, picture=picture)

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
        require("source", source, str, "the name of a tool")
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
            remedy = (
                "; put the phantom in place with sonocal tool --landmarks"
                if "phantom" in source.lower()
                else ""
            )
            raise InputError(
                f"{self.name}: nothing connects {source} to {target}; the transforms are {have}{remedy}"
            )
        matrices, valid = np.tile(np.eye(4), (len(self), 1, 1)), np.ones(len(self), dtype=bool)
        for poses, inverted in chain:
            step = poses.usable(self.name, on_invalid)
            step = step.inverse() if inverted else step
            valid &= step.valid
            matrices = matrices @ step.matrices
        return Poses(source, target, np.where(valid[:, None, None], matrices, np.nan), valid)

    def select(self, rows: ArrayLike) -> Recording:
        """The recording of some items, given by a mask, a slice's range or indices."""
        try:
            index = chosen(len(self), rows)
        except (IndexError, ValueError) as error:
            raise InputError(f"{self.name}: rows must be a mask or indices of its items ({error})") from None
        return replace(
            self,
            times=self.times[index],
            frames=SelectedFrames(self.frames, index.tolist()) if len(self.frames) else self.frames,
            poses={name: poses.select(index) for name, poses in self.poses.items()},
            image_valid=self.image_valid[index],
            item_fields={name: tuple(c[i] for i in index) for name, c in self.item_fields.items()},
        )


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
