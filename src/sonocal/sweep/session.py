"""A calibration that follows the hand: items are added one at a time, and the answer is fitted again as they grow.

The end is `calibrate_recording` of all items, to the last bit; on the way images are looked into once, through a mask
of the first ones, and fits leave out the second look.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray

from sonocal.calibration.lagged import lag_of_rows
from sonocal.detection import Detections
from sonocal.detection.recordings import Detector, Found, detector_of
from sonocal.errors import InputError, SonocalError
from sonocal.geometry import Array
from sonocal.geometry.shown import quoted
from sonocal.recording import Recording, with_latency
from sonocal.recording.stream import Item, RecordingStream
from sonocal.setup_checks.lag_fit import LagFit
from sonocal.sweep.calibrate import Sweep
from sonocal.sweep.choice import CandidateCalibration
from sonocal.sweep.lagged import moving_rows
from sonocal.sweep.options import Keywords, Options
from sonocal.sweep.tabulate import Posing
from sonocal.targets import Line, require_lines

__all__ = ["Session"]

FIRST_IMAGES = 24
"""As many as a mask is made of."""
GROWTH = 1.25
"""Between fits: all of them together cost a few times the last."""
LEAST_STEP = 5


class Session:
    """A needle or wires that are being scanned.

    One thread may add to the stream while another looks and fits.

    Args:
        lines: the needles and wires, see `read_lines`.
        name: what messages call the recording.
        stream: where items are kept; in memory and a file without a name unless given.
        latency_s: how much later the tracker stamps an instant than the images do.
        **options: those of `calibrate_recording`; with ``latency="estimate"`` the lag is fitted at the end, and fits
            on the way take `latency_s`.

    Attributes:
        stream: all items.
        lines: the needles and wires.
        latency_s: that of the next fits.
        latest: the last fit; None before there is one.
        refusal: why the last fit failed, in a sentence; "" where it did not.
        looked: into how many images it looked.
        seen: in how many of them something stands out.
    """

    def __init__(
        self,
        lines: Sequence[Line],
        *,
        name: str = "live",
        stream: RecordingStream | None = None,
        latency_s: float = 0.0,
        **options: Unpack[Keywords],
    ) -> None:
        require_lines(lines)
        self.stream = RecordingStream(name) if stream is None else stream
        self.latest: CandidateCalibration | None = None
        self.refusal, self.seen, self.looked = "", 0, 0
        self.latency_s = latency_s
        self.lines: Sequence[Line] = tuple(lines)
        self._told_s = latency_s
        self._options: Any = dict(options)
        self._detector: Detector | None = None
        self._frames: list[int] = []
        self._found: list[Found] = []
        self._next_fit = FIRST_IMAGES

    def __repr__(self) -> str:
        name = quoted(self.stream.name)
        return f"<Session {name}: {len(self.stream)} items, {self.seen} with candidates>"

    @property
    def estimates_lag(self) -> bool:
        """Whether the lag is fitted at the end, so that fits on the way may take what is known of it."""
        return self._options.get("latency") is not None

    @property
    def posing(self) -> Posing:
        """How the lines come into the probe marker's frame."""
        named = {
            name: self._options[name] for name in ("probe", "fixed", "on_invalid") if name in self._options
        }
        return Posing(**named)

    @property
    def mask(self) -> NDArray[np.bool_] | None:
        """(rows, columns): where it looks; None before it does, and where that is everywhere."""
        return None if self._detector is None else self._detector.mask

    @property
    def expected_mm(self) -> float | None:
        """The greatest predicted error (95 %) at the corners of the image, of the last fit; None without one."""
        found = None if self.latest is None else self.latest.calibration
        if found is None or found.covariance is None:
            return None
        return float(found.predicted_errors()[2][:-1].max())

    def add(self, item: Item) -> bool:
        """Add an item, look into its image, and fit again where enough came since the last time.

        Returns:
            Whether it was fitted, or a fit was refused.

        Raises:
            InputError: the item is unlike those before, or an option means nothing.
        """
        self.stream.add(item)
        while self.look():
            pass
        if self.looked < self._next_fit:
            return False
        self.fit()
        self._next_fit = max(self.looked + LEAST_STEP, int(self.looked * GROWTH))
        return True

    def look(self) -> bool:
        """Look into the next image that nobody looked into; of the first ones, once there are enough for a mask.

        Returns:
            Whether there was one.

        Raises:
            InputError: an option means nothing.
        """
        if self._detector is None:
            if self.stream.stored < FIRST_IMAGES:
                return False
            recording = self._recording(0.0)
            first = recording.select(np.flatnonzero(recording.image_valid)[:FIRST_IMAGES])
            options = Options.for_lines(first, self.lines, **self._options)
            self._detector = detector_of(first, options.detection)
        if self.looked == self.stream.stored:
            return False
        index, image = self.stream.image(self.looked)
        found = self._detector.everywhere(image, f"{self.stream.name}, frame {index}")
        self._found.append(found)
        self._frames += [index] * len(found[2])
        self.seen += len(found[2]) > 0
        self.looked += 1
        return True

    def stood_out(self, number: int) -> tuple[int, Array]:
        """Of one of the images that it looked into: the item's index, and what stands out, (K, P, D) px, best first."""
        return self.stream.image_item(number), self._found[number][0]

    def fit(self) -> None:
        """Fit what was seen so far: `latest` is the answer, or `refusal` says why there is none."""
        if self._detector is None:
            return
        quick = self._options | {"second_look": False, "latency": None}
        if self._detector.mask is not None:
            quick["mask"] = self._detector.mask
        try:
            sweep = Sweep.of(self._recording(self.latency_s), self.lines, **quick)
            self.latest = sweep.calibrate(self._detections())
            self.refusal = ""
        except SonocalError as error:  # of a tool that was not seen yet, too
            self.refusal = str(error)

    def lag(self) -> LagFit:
        """How much later the tracker stamps an instant than the images do, of the rows of the last fit.

        Raises:
            SonocalError: there is no fit, the lines did not move enough to tell, or items have no times.
        """
        if self.latest is None:
            raise InputError(f"{self.stream.name}: no lag shows before there is a calibration; scan on")
        sweep = Sweep.of(self._recording(0.0), self.lines, **(self._options | {"latency": "estimate"}))
        rows = moving_rows(sweep.recording, self.lines, self.latest.observations, sweep.segments_mm)
        return lag_of_rows(rows, sweep.options, self.stream.name)

    def finish(self) -> CandidateCalibration:
        """The calibration of all items, as `calibrate_recording` gives it.

        Raises:
            SonocalError: as `calibrate_recording`.
        """
        sweep = self._whole()
        self.latest = sweep.calibrate(self._all_detections(sweep))
        self.refusal = ""
        return self.latest

    def detections(self) -> Detections:
        """What `Sweep.detect` finds in all items: what was seen on the way, where the mask stayed what it was.

        Raises:
            InputError: as `calibrate_recording`.
        """
        return self._all_detections(self._whole())

    def close(self) -> None:
        """Give the images' room back."""
        self.stream.close()

    def _recording(self, latency_s: float) -> Recording:
        return with_latency(
            self.stream.recording(), latency_s, on_invalid=self._options.get("on_invalid", "raise")
        )

    def _whole(self) -> Sweep:
        told_s = 0.0 if self.estimates_lag else self._told_s
        return Sweep.of(self._recording(told_s), self.lines, **self._options)

    def _all_detections(self, sweep: Sweep) -> Detections:
        while self.look():
            pass
        mine, theirs = (None if one is None else one.mask for one in (self._detector, sweep.detector))
        same = self._detector is not None and (mine is theirs or np.array_equal(mine, theirs))  # type: ignore[arg-type]
        return self._detections() if same else sweep.detect()

    def _detections(self) -> Detections:
        assert self._detector is not None
        return self._detector.together(self._frames, self._found)
