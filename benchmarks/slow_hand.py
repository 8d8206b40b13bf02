"""How often a sound sweep in which the hand hardly moved is accused of anything.

python -m benchmarks.slow_hand [--seeds 100] [--first-seed 0]

Nothing is wrong with these scans but noise; their simulator shares no code with what it judges.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
WIDTH, HEIGHT, SCALE, NEEDLE_MM, PX = 640, 480, 0.2, 120.0, 1.0
# Of what goes to and fro, a second: none comes back in the ten that are recorded, half of them do, all do.
HANDS = {"still": (0.005, 0.05), "slow": (0.02, 0.1), "usual": (0.1, 0.4)}
NOISES_MM = (0.02, 0.1, 0.4)
# What any number of such scans may be warned of.
TRUE_OF_IT = {"weak-motion", "narrow-area", "two-answers"}


def slow_sweep(
    seed: int, hand: str, count: int = 200, dimension: int = 2
) -> tuple[tuple[Array, Array], Array, Array, NDArray[np.int64]]:
    """A straight needle in ten seconds of a hand, without noise.

    Returns:
        Rotation and translation of the image; points (N, d), px; segments (N, 2, 3), mm; frames (N,).
    """
    rng = np.random.default_rng([seed, count, dimension])
    time = np.linspace(0.0, 10.0, count)

    def drifts(amplitude: float) -> Array:
        phase, a_second = rng.uniform(0, 2 * np.pi, 3), rng.uniform(*HANDS[hand], 3)
        return np.asarray(amplitude * np.sin(2 * np.pi * a_second * time[:, None] + phase))

    turn, shift = Rotation.random(random_state=rng).as_matrix(), rng.uniform(-80, 80, 3)
    points = np.array([WIDTH / 2, HEIGHT / 2, 50.0]) + drifts(200.0)
    if dimension == 2:
        points[:, 2] = 0.0
    ways = Rotation.from_rotvec(np.radians(drifts(30.0))).as_matrix()[:, :, 2] @ turn.T
    middle = SCALE * points @ turn.T + shift + drifts(30.0)[:, :1] * ways
    segments = middle[:, None] + np.array([-0.5, 0.5])[:, None] * NEEDLE_MM * ways[:, None]
    frames = np.arange(count)
    if dimension == 2:
        return (turn, shift), points[:, :2], segments, frames
    both = np.stack([points, points + 60.0 * ways @ turn], axis=1).reshape(-1, 3)
    return (turn, shift), both, np.repeat(segments, 2, axis=0), np.repeat(frames, 2)


def noisy_rows(seed: int, hand: str, noise_mm: float) -> Any:
    """The table of such a scan."""
    import sonocal as sc

    _, points, segments, frames = slow_sweep(seed, hand)
    rng = np.random.default_rng([seed, 1])
    return sc.Observations(
        points + rng.normal(0, PX, points.shape),
        segments + rng.normal(0, noise_mm, segments.shape),
        frame=frames,
        image_size_px=(WIDTH, HEIGHT),
    )


def found_in(rows: Any) -> set[str]:
    """Codes that rows are warned of, or are refused with."""
    import sonocal as sc

    try:
        return {one.code for one in sc.calibrate(rows).warnings}
    except sc.DegenerateGeometryError:
        return {"refused"}


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--first-seed", type=int, default=0)
    asked = parser.parse_args(arguments)
    print("| hand | noise, mm | refused | accused | of what |\n|---|---|---|---|---|")
    for hand in HANDS:
        for noise_mm in NOISES_MM:
            seeds = range(asked.first_seed, asked.first_seed + asked.seeds)
            codes = [found_in(noisy_rows(seed, hand, noise_mm)) - TRUE_OF_IT for seed in seeds]
            refused = sum("refused" in one for one in codes)
            tally = Counter(code for one in codes for code in one - {"refused"})
            accused = sum(bool(one - {"refused"}) for one in codes)
            of_what = ", ".join(f"{code} {count}" for code, count in tally.most_common())
            cells = (hand, f"{noise_mm:g}", refused, f"{accused} of {asked.seeds - refused}", of_what)
            print(f"| {' | '.join(map(str, cells))} |", flush=True)


if __name__ == "__main__":
    main()
