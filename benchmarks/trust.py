"""How often a calibration that is wrong calls itself sound, and how often a sound one is accused.

python -m benchmarks.trust [--rows REGEX] [--seeds 50] [--first-seed 0] [--jobs 2] [--write docs/trust.md]
"""

from __future__ import annotations

import argparse
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from benchmarks.pages import tell
from benchmarks.simulators.trust_faults import KINDS
from benchmarks.simulators.trust_judge import HONEST, Outcome, judged
from benchmarks.simulators.trust_power import deflection, shown
from benchmarks.simulators.trust_sound import COVERAGE, SOUND

Row = tuple[str, str, str]
"""The table it stands in, its name, its strength."""

# A latency's value is right within this, and an image corner is lost beyond that.
LAG_MS, FAR_MM = 5.0, 10.0

SIGHTINGS = (10, 20, 50, 100, 400)

HEADS = {
    "faults": "| kind | strength | refused | do not use | care | silent | confidently wrong | of these, shown "
    "| error median / max, mm | bound median, mm | codes |",
    "sound": "| scans | N | scans tried | refused | bound above 2 mm, only | accused | corners within the bound "
    "| error median / max, mm "
    "| codes |",
    "coverage": "| scans | scans tried | covered, of all answered | covered, of silent | silent | silent, off > 10 mm "
    "| named or refused | lag within 5 ms, of those named |",
}


def outcome(row: Row, seed: int) -> Outcome:
    """What the program says of one scan of a row."""
    part, name, strength = row
    if part == "faults":
        return judged(KINDS[name].make(seed, float(strength)))
    if part == "sound":
        return judged(SOUND[name](seed, int(strength)))
    return judged(COVERAGE[name].make(seed))


def all_rows() -> Iterator[Row]:
    """Every row of every table."""
    for name, kind in KINDS.items():
        for strength in kind.strengths:
            yield "faults", name, repr(strength)
    for name in SOUND:
        for count in SIGHTINGS:
            yield "sound", name, str(count)
    for name in COVERAGE:
        yield "coverage", name, ""


def counted(outcomes: Sequence[Outcome], level: str) -> int:
    """How many are of a level."""
    return sum(one.level == level for one in outcomes)


def codes_of(outcomes: Sequence[Outcome]) -> str:
    """How often each code led."""
    leading = Counter(one.codes[0] for one in outcomes if one.codes)
    return ", ".join(f"{code} {count}" for code, count in leading.most_common(4))


def middle_and_most(values: Sequence[float]) -> str:
    """Median and greatest of those that are numbers."""
    known = [value for value in values if np.isfinite(value)]
    return f"{np.median(known):.2f} / {np.max(known):.2f}" if known else ""


def fault_line(row: Row, outcomes: Sequence[Outcome], seeds: range) -> str:
    """A line of the table of faults."""
    kind = KINDS[row[1]]
    wrong = [seed for one, seed in zip(outcomes, seeds, strict=True) if one.confidently_wrong]
    plain = 0 if kind.unknowable else sum(shown(row[1], deflection(row[1], float(row[2]), x)) for x in wrong)
    bounds = [one.bound_mm for one in outcomes if np.isfinite(one.bound_mm)]
    cells = (
        row[1] + (" (cannot be known)" if kind.unknowable else ""),
        f"{float(row[2]):g} {kind.unit}",
        *(counted(outcomes, level) for level in ("refused", "stop", "care", "use")),
        f"{len(wrong)} of {len(outcomes)}",
        plain,
        middle_and_most([one.error_mm for one in outcomes]),
        f"{np.median(bounds):.2f}" if bounds else "",
        codes_of(outcomes),
    )
    return f"| {' | '.join(map(str, cells))} |"


def sound_line(row: Row, outcomes: Sequence[Outcome]) -> str:
    """A line of the table of sound scans."""
    accused = [one for one in outcomes if one.accused]
    cells = (
        row[1],
        row[2],
        len(outcomes),
        counted(outcomes, "refused"),
        sum(not one.silent and not one.accused for one in outcomes),
        f"{len(accused) / len(outcomes):.1%}",
        share([one.covered for one in outcomes]),
        middle_and_most([one.error_mm for one in outcomes]),
        accusers(accused),
    )
    return f"| {' | '.join(map(str, cells))} |"


def accusers(outcomes: Sequence[Outcome]) -> str:
    """How often each code that is more than a large bound was given."""
    codes = Counter(code for one in outcomes for code in set(one.codes) - HONEST)
    return ", ".join(f"{code} {count}" for code, count in codes.most_common())


def share(hits: Sequence[bool] | Sequence[float]) -> str:
    """The mean of those that are numbers, in per cent, and how many they are."""
    known = [hit for hit in hits if np.isfinite(hit)]
    return f"{np.mean(known):.1%} of {len(known)}" if known else ""


def coverage_line(row: Row, outcomes: Sequence[Outcome], seeds: range) -> str:
    """A line of the table of coverage."""
    lag = COVERAGE[row[1]].lag_s
    # The sentences name a latency by its size and say in words which is late.
    near = (
        [
            abs(abs(one.lag_ms) - 1e3 * abs(lag(seed))) <= LAG_MS
            for one, seed in zip(outcomes, seeds, strict=True)
            if np.isfinite(one.lag_ms)
        ]
        if lag
        else []
    )
    cells = (
        row[1],
        len(outcomes),
        share([one.covered for one in outcomes]),
        share([one.covered for one in outcomes if one.silent]),
        sum(one.silent for one in outcomes),
        sum(one.silent and one.error_mm > FAR_MM for one in outcomes),
        share([one.level == "refused" or "latency" in one.codes for one in outcomes]) if lag else "",
        share(near),
    )
    return f"| {' | '.join(map(str, cells))} |"


def line_of(row: Row, outcomes: Sequence[Outcome], seeds: range) -> str:
    """A row's line in its table."""
    if row[0] == "coverage":
        return coverage_line(row, outcomes, seeds)
    return fault_line(row, outcomes, seeds) if row[0] == "faults" else sound_line(row, outcomes)


def measured(rows: Sequence[Row], seeds: range, jobs: int) -> Iterator[tuple[Row, list[Outcome]]]:
    """Every row with its outcomes, as they come."""
    if jobs == 1:
        yield from ((row, [outcome(row, seed) for seed in seeds]) for row in rows)
        return
    with ProcessPoolExecutor(jobs) as pool:
        waiting = [(row, [pool.submit(outcome, row, seed) for seed in seeds]) for row in rows]
        yield from ((row, [one.result() for one in futures]) for row, futures in waiting)


def tables(rows: Sequence[Row], seeds: range, jobs: int) -> Iterator[tuple[str, str]]:
    """Lines of the tables, each with the table it belongs to."""
    before, sound = "", list[Outcome]()
    for row, outcomes in measured(rows, seeds, jobs):
        if row[0] != before:
            before = row[0]
            yield before, "\n" + HEADS[before]
            yield before, "|---" * (HEADS[before].count("|") - 1) + "|"
        yield before, line_of(row, outcomes, seeds)
        sound += outcomes if before == "sound" else []
    if sound:
        accused = [one for one in sound if one.accused]
        share_of = f"{len(accused)} of {len(sound)} ({len(accused) / len(sound):.1%})"
        yield "sound", f"\nAccused in all: {share_of}: {accusers(accused) or 'none'}."


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables, and write them into a page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rows", default="", help="regular expression of 'table name'")
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--write", type=Path, help="page whose tables to replace")
    asked = parser.parse_args(arguments)
    rows = [row for row in all_rows() if re.search(asked.rows, f"{row[0]} {row[1]}")]
    seeds = range(asked.first_seed, asked.first_seed + asked.seeds)
    tell(tables(rows, seeds, asked.jobs), asked.write)


if __name__ == "__main__":
    main()
