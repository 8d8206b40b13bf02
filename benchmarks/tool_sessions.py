"""Long recordings of several tools: how many of their pivots, spins, touches, sweeps and rests are found as such.

    python -m benchmarks.tool_sessions [--sessions 200] [--seed 1000]

The simulator shares no code with what it measures. Thresholds were chosen on seeds below 1000.
"""

from __future__ import annotations

import argparse
from collections import Counter

import numpy as np

from benchmarks.simulators.tool_sessions import TIPS, session
from sonocal.recording import Poses, Recording
from sonocal.tools import find_tool_session

# Of what was done and of what was found, the share of items that must be in both; a tip's error that is right, mm.
OVERLAP, TIP_MM = 0.7, 2.0


def recording(made):
    """A session as a recording."""
    poses = [Poses.of(tool, "Tracker", one) for tool, one in made.poses.items()]
    return Recording(made.times, poses={one.name: one for one in poses})


def overlap(one, other):
    """Items in both, of those in either."""
    both = min(one.last, other.last) - max(one.first, other.first) + 1
    return max(both, 0) / (max(one.last, other.last) - min(one.first, other.first) + 1)


def is_right(did, found):
    """Whether what was done was found as such: of a sweep, that nothing was."""
    if did.kind == "sweep":
        items = np.zeros(did.last - did.first + 1, dtype=bool)
        for one in found.stretches:
            if one.tool == did.tool:
                items[max(one.first - did.first, 0) : max(one.last - did.first + 1, 0)] = True
        return bool(items.mean() < 1 - OVERLAP)
    same = [one for one in found.stretches if (one.tool, one.kind) == (did.tool, did.kind)]
    return any(overlap(did, one) >= OVERLAP for one in same)


def judged(seed, **how):
    """What was done: right and wrong by kind; stretches that nobody made; errors of tips, mm."""
    made = session(seed, **how)
    found = find_tool_session(recording(made))
    count = Counter()
    for did in made.did:
        count[did.kind, is_right(did, found)] += 1
    for one in found.stretches:
        alike = [did for did in made.did if (did.tool, did.kind) == (one.tool, one.kind)]
        if all(overlap(did, one) < OVERLAP for did in alike):
            count["made up", one.tool, one.kind] += 1
    tips = [
        np.linalg.norm(tip.tip_mm - TIPS[tool]) for tool, one in found.tools.items() for tip in one.points
    ]
    return count, tips


def line(name, sessions, seed, **how):
    """Print the counts of many sessions."""
    count, tips = Counter(), []
    for i in range(sessions):
        one, errors = judged(seed + i, **how)
        count += one
        tips += errors
    right = sum(n for key, n in count.items() if key[-1] is True)
    wrong = sum(n for key, n in count.items() if key[-1] is False)
    made_up = {" ".join(key[1:]): n for key, n in count.items() if key[0] == "made up"}
    missed = {key[0]: n for key, n in count.items() if key[-1] is False}
    extra = sum(made_up.values())
    print(
        f"{name:26} right {right / (right + wrong + extra):7.2%} of {right + wrong} stretches and {extra} made up; "
        f"wrong {missed}, made up {made_up}; tips {len(tips)}, within {TIP_MM:g} mm "
        f"{np.mean(np.array(tips) < TIP_MM):.1%}, median {np.median(tips):.2f} mm",
        flush=True,
    )


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sessions", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1000)
    given = parser.parse_args()
    line("as a lab makes them", given.sessions, given.seed)
    line("tracker of 0.1 mm", given.sessions // 4, given.seed, tracker_mm=0.1, tracker_deg=0.02)
    line("tracker of 0.6 mm", given.sessions // 4, given.seed, tracker_mm=0.6, tracker_deg=0.1)
    line("a third lost", given.sessions // 4, given.seed, lost=0.33)


if __name__ == "__main__":
    main()
