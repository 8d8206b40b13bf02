"""A volume that grows as images of 820 x 616 px come: images a second of processor time, three cuts after each."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np

import sonocal as sc
from sonocal.existing import read_existing
from sonocal.reconstruction import LiveVolume
from sonocal.recording.stream import Item

DATA = Path(__file__).parents[2] / "shared" / "data"
IMAGES, STEP_MM = 120, 0.4


def live(_: Any) -> None:
    """For each spacing and interpolation: images of the spine phantom, a hand's step apart."""
    recording = sc.read_recording(DATA / "volumes/SpinePhantomFreehand.igs.mha")
    calibration = read_existing(DATA / "volumes/SpinePhantom_NN_MEAN.xml")
    frames = [np.asarray(image) for image in recording.frames]
    pose = recording.between("Reference", "Probe").matrices[0]
    normal = np.cross(*(pose @ calibration.matrix)[:3, :2].T)
    normal /= np.linalg.norm(normal)
    for spacing in (0.5, 1.0):
        for mode in ("nearest", "linear", "between"):
            volume = LiveVolume(
                calibration, spacing_mm=spacing, interpolation=mode, mask=np.ones(frames[0].shape, bool)
            )
            took = []
            for k in range(IMAGES):
                moved = pose.copy()
                moved[:3, 3] += STEP_MM * k * normal
                item = Item(k / 30, {("Probe", "Reference"): moved}, frames[k % len(frames)])
                start = time.process_time()
                volume.add(item)
                cuts = volume.slices()
                took.append(time.process_time() - start)
            sizes = ", ".join(f"{one.image.shape[1]} x {one.image.shape[0]}" for one in cuts)
            print(
                f"live      {spacing} mm, {mode}: {IMAGES / sum(took):.0f} images/s, slowest {1000 * max(took):.0f} "
                f"ms, cuts of {sizes}"
            )
