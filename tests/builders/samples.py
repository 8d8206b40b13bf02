"""The sample recording with fewer images than a newcomer gets, made once; tests of its own have them all."""

from dataclasses import replace
from functools import cache

import numpy as np

from sonocal.recording import ArrayFrames
from sonocal.simulation.sample import sample_sweep

FEW = 48


@cache
def small_sample():
    """As many images as the studio's tests calibrate from."""
    sweep = sample_sweep(FEW)
    images = np.stack(list(sweep.recording.frames))
    images.flags.writeable = False
    return replace(sweep, recording=replace(sweep.recording, frames=ArrayFrames(images)))
