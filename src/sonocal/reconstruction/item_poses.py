"""Where the probe was at each of the items that come one at a time."""

from __future__ import annotations

import numpy as np

from sonocal.errors import InputError, SonocalError
from sonocal.geometry import Array
from sonocal.reconstruction.options import Options
from sonocal.reconstruction.placed import reference_of
from sonocal.recording import Poses, Recording
from sonocal.recording.frames import no_frames
from sonocal.recording.poses import by_name
from sonocal.recording.stream import Item

__all__ = ["ItemPoses"]


class ItemPoses:
    """Poses of the probe in the volume's frame, which is chosen as for a whole recording.

    Args:
        name: of the recording, for messages.
        options: which frames, and what to do with poses that are not rigid.

    Attributes:
        count: of items so far.
        reference: the volume's frame; None before a pose of the probe was there.
    """

    def __init__(self, name: str, options: Options) -> None:
        self._name, self._options = name, options
        self._tools: dict[tuple[str, str], None] = {}
        self.count = 0
        self.reference: str | None = None

    def of(self, item: Item) -> tuple[Array | None, str]:
        """(4, 4), mm in the frame from the probe's; or None, and why.

        Raises:
            InputError: a pose is no 4 x 4 matrix; the item does not count then.
        """
        poses = {key: np.asarray(pose, dtype=float) for key, pose in item.poses.items() if pose is not None}
        for (source, target), pose in poses.items():
            if pose.shape != (4, 4):
                raise InputError(
                    f"{self._name}, item {self.count}: {source}To{target} must have shape (4, 4); got {pose.shape}"
                )
        self._tools.update(dict.fromkeys(item.poses))
        self.count += 1
        lost = np.full((4, 4), np.nan)
        given = [Poses.of(*tool, poses.get(tool, lost)[None]) for tool in self._tools]
        try:
            found = self._between(item.time_s, given)
        except SonocalError as error:  # of a tool that was not seen yet, too
            return None, str(error)
        if not found.valid[0]:
            return None, f"{self._name}: {self._options.probe} has no valid pose in {found.target}"
        return found.matrices[0], ""

    def _between(self, time_s: float, given: list[Poses]) -> Poses:
        named = by_name(given, self._name)
        recording = Recording(np.array([time_s]), no_frames(), named, None, np.zeros(1, dtype=bool))
        reference = reference_of(recording, self._options)
        found = recording.between(
            reference, self._options.probe, self._options.fixed, self._options.on_invalid
        )
        self.reference = reference
        return found
