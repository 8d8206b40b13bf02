"""Sound scans of many kinds, and scans whose bound must hold."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from benchmarks.simulators.trust_faults import (
    FAST,
    LAGS,
    SLOW,
    Case,
    autocorrelated,
    direction,
    late,
    plane,
    points_on_a_line,
    port,
    rng_of,
    small_area,
)
from benchmarks.simulators.trust_scans import noisy, sound, wires

Sound = Callable[[int, int], Case]
"""A sound scan by its seed and its number of sightings."""


def plain(
    *,
    dimension: int = 2,
    still: bool = False,
    noise: float = 1.0,
    size_known: bool = True,
    recording: bool = False,
) -> Sound:
    """Scans whose noise is so many times 1 px and 0.4 mm."""

    def make(seed: int, frames: int) -> Case:
        scan = sound(
            seed,
            frames,
            dimension,
            sigma_px=noise,
            sigma_mm=0.4 * noise,
            still=still,
            frames_per_s=frames / 30,
        )
        return Case(scan, size_known=size_known, recording=recording)

    return make


def sound_wires(seed: int, frames: int) -> Case:
    """Six wires at their places."""
    return Case(noisy(wires(seed, frames, 6), rng_of(seed), 1.0, 0.3))


SOUND: dict[str, Sound] = {
    "2D, sweep": plain(),
    "2D, stills": plain(still=True),
    "2D, sweep, noise x 0.3": plain(noise=0.3),
    "2D, sweep, noise x 2": plain(noise=2.0),
    "2D, stills, no image size": plain(still=True, size_known=False),
    "2D, sweep, no image size": plain(size_known=False),
    "2D, sweep, recording": plain(recording=True),
    "2D, six wires": sound_wires,
    "3D, sweep": plain(dimension=3),
    "3D, stills": plain(dimension=3, still=True),
    "3D, stills, noise x 2": plain(dimension=3, still=True, noise=2.0),
    "3D, stills, no image size": plain(dimension=3, still=True, size_known=False),
}


@dataclasses.dataclass(frozen=True)
class Covered:
    """Scans whose bound must hold, or that must be refused.

    Attributes:
        make: of a seed.
        lag_s: the latency of a seed, s, where it has one.
    """

    make: Callable[[int], Case]
    lag_s: Callable[[int], float] | None = None


DEGENERATE = (
    lambda s: plane(s, 1.0),
    lambda s: direction(s, 0.3),
    lambda s: points_on_a_line(s, 2.0),
    lambda s: small_area(s, 15.0),
    lambda s: port(s, 0.3),
)


def degenerate(seed: int) -> Case:
    """One of five near-degenerate configurations."""
    return DEGENERATE[seed % len(DEGENERATE)](seed)


def lag_of(seed: int) -> float:
    """50 to 190 ms, of either sign."""
    return float(np.random.default_rng([seed, 9]).uniform(LAGS[0], LAGS[-1])) * (1 if seed % 2 else -1)


def lagging(seed: int, *, recording: bool) -> Case:
    """A latency of `lag_of` at a hand of any speed."""
    speed = np.exp(np.random.default_rng([seed, 10]).uniform(np.log(SLOW), np.log(FAST)))
    return late(seed, abs(lag_of(seed)), float(speed), recording=recording)


COVERAGE: dict[str, Covered] = {
    "port of 1 mm": Covered(lambda s: port(s, 1.0)),
    "port of 3 mm": Covered(lambda s: port(s, 3.0)),
    "port of 3 mm, N = 1000": Covered(lambda s: port(s, 3.0, 1000)),
    "port of 5 mm": Covered(lambda s: port(s, 5.0)),
    "drift, 60 stretches": Covered(lambda s: autocorrelated(s, 0.5)),
    "drift, 30 stretches": Covered(lambda s: autocorrelated(s, 1.0)),
    "drift, 10 stretches": Covered(lambda s: autocorrelated(s, 3.0)),
    "near degenerate": Covered(degenerate),
    "latency, table": Covered(lambda s: lagging(s, recording=False), lag_of),
    "latency, recording": Covered(lambda s: lagging(s, recording=True), lag_of),
}
