"""How often a calibration of beads, wires and walls is confidently wrong, and how often a sound one is accused.

python -m benchmarks.mixed_trust [--rows REGEX] [--seeds 50] [--first-seed 0] [--jobs 2] [--write docs/trust.md]

"mirrored image" of a 2D probe cannot be seen in the rows: there the program is told how the marker is mounted, to 10
degrees, as it is of the sound scans.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from benchmarks.pages import tell
from benchmarks.simulators.mixed_judge import judged
from benchmarks.simulators.mixed_scans import FAULTS, PHANTOMS, sound
from benchmarks.simulators.trust_judge import Outcome
from benchmarks.trust import accusers, codes_of, counted, middle_and_most, share

SOUND = "sound"
HEAD = (
    "| phantom | fault | refused | do not use | care | silent | confidently wrong | accused | corners within the bound "
    "| error median / max, mm | codes |"
)


def outcome(mix: str, fault: str, seed: int) -> Outcome:
    """What the program says of one scan."""
    if fault == SOUND:
        return judged(sound(mix, seed), expected=True)
    make, strength, _ = FAULTS[fault]
    return judged(make(mix, seed, strength), expected=fault == "mirrored image")


def line_of(mix: str, fault: str, outcomes: Sequence[Outcome]) -> str:
    """A row of the table."""
    is_sound = fault == SOUND
    accused = [one for one in outcomes if one.accused]
    wrong = sum(one.confidently_wrong for one in outcomes)
    name = fault if is_sound else f"{fault}, {FAULTS[fault][1]:g} {FAULTS[fault][2]}"
    cells = (
        mix,
        name,
        *(counted(outcomes, level) for level in ("refused", "stop", "care", "use")),
        "" if is_sound else f"{wrong} of {len(outcomes)}",
        f"{len(accused)} of {len(outcomes)}" if is_sound else "",
        share([one.covered for one in outcomes]),
        middle_and_most([one.error_mm for one in outcomes]),
        accusers(accused) if is_sound else codes_of(outcomes),
    )
    return f"| {' | '.join(map(str, cells))} |"


def table(rows: Sequence[tuple[str, str]], seeds: range, jobs: int) -> Iterator[str]:
    """The table, line by line."""
    yield HEAD
    yield "|---" * (HEAD.count("|") - 1) + "|"
    with ProcessPoolExecutor(jobs) as pool:
        waiting = [(row, [pool.submit(outcome, *row, seed) for seed in seeds]) for row in rows]
        for row, futures in waiting:
            yield line_of(*row, [one.result() for one in futures])


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table, and write it into a page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rows", default="", help="regular expression of 'phantom: fault'")
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--write", type=Path, help="page whose table to replace")
    asked = parser.parse_args(arguments)
    every = [(mix, fault) for mix in PHANTOMS for fault in (SOUND, *FAULTS)]
    rows = [row for row in every if re.search(asked.rows, f"{row[0]}: {row[1]}")]
    found = table(rows, range(asked.first_seed, asked.first_seed + asked.seeds), asked.jobs)
    tell((("mixed", line) for line in found), asked.write)


if __name__ == "__main__":
    main()
