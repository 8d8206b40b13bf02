"""The volume of a scan that goes on: it grows beside the session, and is made anew where the calibration moved it."""

from __future__ import annotations

import threading
import time
import traceback
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sonocal.calibration import Calibration
from sonocal.errors import SonocalError
from sonocal.geometry import Array, area_places, homogeneous_points
from sonocal.reconstruction import LiveVolume, Picture
from sonocal.sweep import Session

__all__ = ["Cuts", "Growing"]

SPACING_MM = 1.0
MOVED_VOXELS = 1.0
"""As far may a new calibration carry a corner of the image before what was put in is put in anew."""
EACH_S = 0.25
SHARE = 0.3
"""Of the time, at the most, that it takes from the session, whose answer comes first."""


@dataclass(frozen=True, eq=False)
class Cuts:
    """Three cuts through what was scanned so far.

    Attributes:
        number: the next have a larger one.
        images: how many were put in.
        pictures: at right angles to z, y and x, through the middle of the last image.
    """

    number: int
    images: int
    pictures: tuple[Picture, ...]

    @property
    def told(self) -> dict[str, Any]:
        """All but the grey levels, as JSON has it."""
        names = ("along", "across", "upright", "letters")
        return {
            "number": self.number,
            "images": self.images,
            "spacing_mm": SPACING_MM,
            "pictures": [
                {name: getattr(one, name) for name in names}
                | {"at_mm": round(float(one.at_mm or 0.0), 1), "edges_mm": np.round(one.edges_mm, 1).tolist()}
                | {"width": one.image.shape[1], "height": one.image.shape[0]}
                for one in self.pictures
            ],
        }

    @property
    def grey(self) -> bytes:
        """The grey levels of one picture after the other, a byte a voxel."""
        return b"".join(_bytes_of(one.image).tobytes() for one in self.pictures)


class Growing:
    """A volume in a thread of its own.

    Args:
        session: whose items are put in, once it has a calibration.

    Attributes:
        cuts: the newest; None before there is anything.
        refusal: why there is no volume, in a sentence; "" where nothing speaks against one.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self.cuts: Cuts | None = None
        self.refusal = ""
        self._volume: LiveVolume | None = None
        self._places: Array | None = None
        self._corners = np.zeros(3)
        self._next = self._number = 0
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="volume", daemon=True)
        self._thread.start()

    def __repr__(self) -> str:
        return f"<Growing: {self._volume or self.refusal or 'no calibration yet'}>"

    def close(self) -> None:
        """End, and wait for the thread."""
        self._closing.set()
        self._thread.join()

    def _run(self) -> None:
        rest_s = EACH_S
        while not self._closing.wait(rest_s):
            begin_s = time.monotonic()
            try:
                self._step(begin_s)
            except SonocalError as error:
                self.refusal = str(error)
                return
            except Exception:  # a bug here must not end the scan
                traceback.print_exc()
                self.refusal = "sonocal made a mistake in the volume; the terminal shows where"
                return
            rest_s = max(EACH_S, (time.monotonic() - begin_s) * (1.0 / SHARE - 1.0))

    def _step(self, begin_s: float) -> None:
        """Put in what came, for a while, and cut."""
        found, session = self._session.latest, self._session
        if found is not None and not session.refusal:
            self._follow(found.calibration)
        if self._volume is None:
            return
        before = self._volume.images
        while self._next < len(session.stream) and not self._closing.is_set():
            if time.monotonic() - begin_s > EACH_S:
                break
            self._volume.add(session.stream.item(self._next))
            self._next += 1
        shown = (
            0 if self.cuts is None else self.cuts.images
        )  # one that is made anew is shown once it has as many
        if self._volume.images != before and self._volume.images >= shown:
            self._number += 1
            self.cuts = Cuts(self._number, self._volume.images, self._volume.slices())

    def _follow(self, found: Calibration) -> None:
        """Begin anew where a calibration moves the image by more than a voxel."""
        if self._places is None:
            self._places = homogeneous_points(area_places(found.area_px))
        corners = found.probe_from_image @ self._places
        if self._volume is not None and _farthest(corners - self._corners) <= MOVED_VOXELS * SPACING_MM:
            return
        posing = self._session.posing
        how = {"probe": posing.probe, "fixed": posing.fixed, "on_invalid": "skip"}
        self._volume = LiveVolume(
            found, name=self._session.stream.name, spacing_mm=SPACING_MM, mask=self._session.mask, **how
        )
        self._corners, self._next = corners, 0


def _farthest(moves_mm: Array) -> float:
    return float(np.linalg.norm(moves_mm, axis=-1).max())


def _bytes_of(image: NDArray[Any]) -> NDArray[np.uint8]:
    """Grey levels of 16 bits by their upper byte."""
    return image.astype(np.uint8) if image.dtype.itemsize == 1 else (image >> 8).astype(np.uint8)
