"""``sonocal sample``: a small recording to try things on, the same everywhere."""

from __future__ import annotations

from pathlib import Path

from sonocal.cli.help import command
from sonocal.cli.options import output_folder, progress
from sonocal.cli.outputs import OVERWRITE, reserve
from sonocal.cli.screen.plain import say

__all__ = ["sample"]


@command(
    "Write a small sample recording and its needle.",
    groups={"What is written": ("output", "overwrite")},
    examples=("sonocal sample", "sonocal sample -o try"),
)
@output_folder("sample", "sweep.igs.mha, needle.toml and truth.json")
@OVERWRITE
def sample(output: Path, *, overwrite: bool) -> None:
    """Write a small sample recording, the needle that was scanned, and the true calibration.

    150 images of a needle in water, 400 x 400 px of 0.3 mm, with the poses of probe and needle: 1.5 MB, simulated,
    and the same wherever it is written. "sonocal simulate" has options.
    """
    from sonocal.simulation.sample import sample_sweep
    from sonocal.simulation.sweep_files import SWEEP_FILES, write_sweep

    reserve(*(output / name for name in SWEEP_FILES))
    with progress("images") as report:
        paths = write_sweep(sample_sweep(), output, report)
    say(f"Wrote {', '.join(str(path) for path in paths)}")
    say(f"Next: sonocal calibrate {paths[0]} --lines {paths[1]} -o {output / 'found'}")
