"""How often a twin of the needle is taken for it without a word, and how often one is seen where none is.

python -m benchmarks.twins [--seeds 50] [--first 0]
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterable

import numpy as np

import sonocal as sc
from benchmarks.simulators.twins import IMAGE, KINDS, twin_scan
from sonocal.geometry import area_places
from sonocal.sweep import calibrate_recording

APART_MM = (3.0, 6.0, 11.0)
# "Confidently wrong": no warning, and further off than this many times the predicted error.
FAR_OFF = 3.0


def outcome(seed: int, **options) -> Counter[str]:
    """What became of one scan."""
    one = twin_scan(seed, **options)
    try:
        found = calibrate_recording(
            one.recording, one.lines, detections=one.detections, second_look=False
        ).calibration
    except sc.SonocalError:
        return Counter(refused=1)
    corners = area_places(np.array([np.zeros(found.dimension), np.full(found.dimension, IMAGE - 1)]))[:-1]
    off = np.linalg.norm(found.probe_from_image @ corners - one.truth @ corners, axis=1).max()
    bound = float(found.predicted_errors()[2].max())
    named = any(one.code == "second-needle" for one in found.warnings)
    return Counter(
        named=named,
        right=bool(off <= 1.5 * bound),
        wrong=bool(off > FAR_OFF * bound),
        confidently_wrong=bool(off > FAR_OFF * bound and not found.warnings),
        warned=bool(found.warnings),
    )


def outcomes(seeds: Iterable[int], **options) -> Counter[str]:
    """Of many scans, summed."""
    return sum((outcome(seed, **options) for seed in seeds), Counter())


def main() -> None:
    """Print a line for each kind of twin."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    arguments = parser.parse_args()
    seeds = range(arguments.first, arguments.first + arguments.seeds)
    names = ("named", "warned", "refused", "right", "wrong", "confidently_wrong")
    print(f"{'':46}" + "".join(f"{name:>19}" for name in names))
    for dimension in (2, 3):
        for kind in KINDS:
            for apart in APART_MM:
                for brighter in (True, False):
                    some = {"kind": kind, "apart_mm": apart, "brighter": brighter, "dimension": dimension}
                    row = outcomes(seeds, **some)
                    what = f"{dimension}D {kind}, {apart:g} mm, {'brighter' if brighter else 'dimmer'}"
                    print(f"{what:46}" + "".join(f"{row[name]:19}" for name in names))
        row = outcomes(seeds, dimension=dimension)
        print(f"{f'{dimension}D no twin':46}" + "".join(f"{row[name]:19}" for name in names))


if __name__ == "__main__":
    main()
