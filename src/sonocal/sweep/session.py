"""A calibration that follows the hand: items are added one at a time, and the answer is fitted again as they grow.

The end is `calibrate_recording` of all items, to the last bit; on the way images are looked into once, through a mask
of the first ones, and fits leave out the second look.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Unpack

import numpy as np

from sonocal.detection import Detections
from sonocal.detection.recordings import Detector, Found, detector_of
from sonocal.errors import SonocalError
from sonocal.geometry.shown import quoted
from sonocal.recording.stream import Item, RecordingStream
from sonocal.sweep.calibrate import Sweep
from sonocal.sweep.choice import CandidateCalibration
from sonocal.sweep.options import Keywords, Options
from sonocal.targets import Line, require_lines

__all__ = ["Session"]

FIRST_IMAGES = 24
"""As many as a mask is made of."""
GROWTH = 1.25
"""Between fits: all of them together cost a few times the last."""
LEAST_STEP = 5


class Session:
    """A needle or wires that are being scanned.

    Args:
        lines: the needles and wires, see `read_lines`.
        name: what messages call the recording.
        **options: those of `calibrate_recording`.

    Attributes:
        stream: all items.
        latest: the last fit; None before there is one.
        refusal: why the last fit failed, in a sentence; "" where it did not.
        seen: in how many images something stands out.
    """

    def __init__(self, lines: Sequence[Line], *, name: str = "live", **options: Unpack[Keywords]) -> None:
        require_lines(lines)
        self.stream = RecordingStream(name)
        self.latest: CandidateCalibration | None = None
        self.refusal, self.seen = "", 0
        self._lines: Sequence[Line] = tuple(lines)
        self._options: Any = dict(options)
        self._waiting: list[int] = []
        self._detector: Detector | None = None
        self._frames: list[int] = []
        self._found: list[Found] = []
        self._next_fit = FIRST_IMAGES

    def __repr__(self) -> str:
        return f"<Session {quoted(self.stream.name)}: {len(self.stream)} items, {self.seen} with candidates>"

    @property
    def expected_mm(self) -> float | None:
        """The greatest predicted error (95 %) at the corners of the image, of the last fit; None without one."""
        found = None if self.latest is None else self.latest.calibration
        if found is None or found.covariance is None:
            return None
        return float(found.predicted_errors()[2][:-1].max())

    def add(self, item: Item) -> bool:
        """Add an item, and fit again where enough came since the last time.

        Returns:
            Whether it was fitted, or a fit was refused.

        Raises:
            InputError: the item is unlike those before, or an option means nothing.
        """
        index = len(self.stream)
        self.stream.add(item)
        if item.image is None:
            return False
        if self._detector is None:
            self._waiting.append(index)
            if len(self._waiting) < FIRST_IMAGES:
                return False
            self._begin()
        else:
            self._look(index, item.image)
        if len(self._found) < self._next_fit:
            return False
        self._fit()
        self._next_fit = max(len(self._found) + LEAST_STEP, int(len(self._found) * GROWTH))
        return True

    def finish(self) -> CandidateCalibration:
        """The calibration of all items, as `calibrate_recording` gives it.

        Raises:
            SonocalError: as `calibrate_recording`.
        """
        sweep = Sweep.of(self.stream.recording(), self._lines, **self._options)
        mine, theirs = (None if one is None else one.mask for one in (self._detector, sweep.detector))
        same = self._detector is not None and (mine is theirs or np.array_equal(mine, theirs))  # type: ignore[arg-type]
        self.latest = sweep.calibrate(self._detections() if same else sweep.detect())
        self.refusal = ""
        return self.latest

    def close(self) -> None:
        """Give the images' room back."""
        self.stream.close()

    def _begin(self) -> None:
        """Make the detector from the first images, and look into them."""
        recording = self.stream.recording().select(self._waiting)
        options = Options.for_lines(recording, self._lines, **self._options)
        self._detector = detector_of(recording, options.detection)
        for index, image in zip(self._waiting, recording.frames, strict=True):
            self._look(index, image)

    def _look(self, index: int, image: Any) -> None:
        assert self._detector is not None
        found = self._detector.everywhere(image, f"live, frame {index}")
        self._found.append(found)
        self._frames += [index] * len(found[2])
        self.seen += len(found[2]) > 0

    def _detections(self) -> Detections:
        assert self._detector is not None
        return self._detector.together(self._frames, self._found)

    def _fit(self) -> None:
        quick = self._options | {"second_look": False}
        if self._detector is not None and self._detector.mask is not None:
            quick["mask"] = self._detector.mask
        try:
            sweep = Sweep.of(self.stream.recording(), self._lines, **quick)
            self.latest = sweep.calibrate(self._detections())
            self.refusal = ""
        except SonocalError as error:  # of a tool that was not seen yet, too
            self.refusal = str(error)
