"""A small recording to try things on, the same everywhere: ``sonocal sample``, the examples and the documentation."""

from __future__ import annotations

from sonocal.simulation.sweep import SimulatedSweep, SweepOptions, simulate_sweep
from sonocal.simulation.ultrasound import BATH
from sonocal.simulation.ultrasound_probe import curvilinear

__all__ = ["sample_sweep"]

SIZE_PX, WIDTH_MM = 400, 120.0


def sample_sweep(frames: int = 150) -> SimulatedSweep:
    """A needle of 400 mm in water, seen by a curvilinear probe: 400 x 400 px of 0.3 mm, 8 images a second.

    Noise of 0.5 px and of 0.5 mm on the needle's ends; in a fifth of the images the needle does not show.

    Args:
        frames: how many images.
    """
    probe = curvilinear(SIZE_PX, SIZE_PX, WIDTH_MM / SIZE_PX)
    options = SweepOptions(frames=frames, rate_hz=8.0, sigma_px=0.5, sigma_mm=0.5, seed=0)
    return simulate_sweep(probe, BATH, options)
