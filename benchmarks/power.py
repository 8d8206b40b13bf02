"""How often the best of all tests would find a fault, beside how often the program warns.

python -m benchmarks.power [--rows REGEX] [--seeds 50] [--first-seed 0]

The best test knows the fault's exact form, the noise and the truth, and is wrong in one of a hundred sound scans.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence

import numpy as np

from benchmarks.simulators.trust_faults import KINDS
from benchmarks.simulators.trust_judge import judged
from benchmarks.simulators.trust_power import best_power, deflection, shown

HEAD = (
    "| kind | strength | deflection 10 / 50 / 90 %, standard deviations | the best test finds | warned | "
    "confidently wrong | their greatest deflection | of them, shown |"
)


def line(name: str, strength: float, seeds: range) -> str:
    """A kind and strength in the table."""
    deflections = np.array([deflection(name, strength, seed) for seed in seeds])
    outcomes = [judged(KINDS[name].make(seed, strength)) for seed in seeds]
    wrong = deflections[[one.confidently_wrong for one in outcomes]]
    cells = (
        name,
        f"{strength:g} {KINDS[name].unit}",
        " / ".join(f"{x:.1f}" for x in np.quantile(deflections, [0.1, 0.5, 0.9])),
        f"{np.mean([best_power(name, x) for x in deflections]):.0%}",
        f"{np.mean([not one.silent for one in outcomes]):.0%}",
        f"{len(wrong)} of {len(seeds)}",
        f"{wrong.max():.1f}" if len(wrong) else "",
        sum(shown(name, x) for x in wrong),
    )
    return f"| {' | '.join(map(str, cells))} |"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rows", default="", help="regular expression of a kind's name")
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--first-seed", type=int, default=0)
    asked = parser.parse_args(arguments)
    print(HEAD)
    print("|---" * (HEAD.count("|") - 1) + "|")
    for name, kind in KINDS.items():
        if kind.nothing is not None and not kind.unknowable and re.search(asked.rows, name):
            for strength in kind.strengths:
                print(
                    line(name, strength, range(asked.first_seed, asked.first_seed + asked.seeds)), flush=True
                )


if __name__ == "__main__":
    main()
