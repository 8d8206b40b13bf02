"""How many of 50 wrong set-ups are found, and how many sound scans are accused.

python -m benchmarks.setup_checks [--scans 50]
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from benchmarks.simulators.faults import (
    FAULTS,
    false_alarms,
    is_found,
)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scans", type=int, default=50)
    seeds = range(parser.parse_args(arguments).scans)
    for name, (code, _) in FAULTS.items():
        print(f"{f'{code}: {name}':70s} found in {sum(is_found(name, s) for s in seeds)}", flush=True)
    for dimension in (2, 3):
        for code, count in false_alarms(dimension, seeds).items():
            print(f"{f'{code}: sound {dimension}D scans':70s} accused {count}", flush=True)


if __name__ == "__main__":
    main()
