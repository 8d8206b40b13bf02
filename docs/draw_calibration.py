"""The picture that the README opens with: what goes in, what comes out, how far to trust it.

python -m docs.draw_calibration
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import sonocal as sc
from sonocal import report
from sonocal.simulation.sweep import SweepOptions, simulate_sweep
from sonocal.simulation.ultrasound import Look
from sonocal.simulation.ultrasound_probe import curvilinear

PICTURE = Path(__file__).parent / "pictures" / "calibration.png"
FRAMES = 300


def main() -> None:
    """Write the picture."""
    import matplotlib.pyplot as plt

    from sonocal.report.style import DETECTED, RC

    options = SweepOptions(frames=FRAMES, hidden_share=0.1, sigma_px=0.7, sigma_mm=0.5, seed=4)
    sweep = simulate_sweep(curvilinear(), Look(), options)
    found = sc.calibrate_recording(sweep.recording, sweep.lines)
    rows, calibration = found.observations, found.calibration
    shown = clearest(sweep.recording, rows)
    with plt.rc_context({**RC, "font.size": 10.0, "axes.titlesize": 13.0}):
        figure = plt.figure(figsize=(11.6, 4.3), dpi=120)
        image = figure.add_axes((0.005, 0.06, 0.3, 0.82))
        image.imshow(sweep.recording.frames[int(rows.frame[shown])], cmap="gray")
        image.plot(
            *rows.points_px[shown], "o", color=DETECTED, markersize=16, fillstyle="none", markeredgewidth=2
        )
        image.set_axis_off()
        image.set_title(" The needle, found in every image")
        needles = figure.add_axes((0.32, 0.0, 0.34, 0.88), projection="3d")
        report.plot_needles(needles, calibration, rows)
        needles.view_init(elev=18, azim=20)
        needles.set_title("The image, placed by its needles")
        error = figure.add_axes((0.7, 0.09, 0.29, 0.79))
        report.plot_predicted_error(error, calibration, rows)
        error.set_title("How far to trust it")
        bar = figure.axes[-1]
        bar.set_xticks(bar.get_xticks()[::3])
        figure.savefig(PICTURE, metadata={"Software": None})
    plt.close(figure)


def clearest(recording: sc.Recording, rows: sc.Observations) -> int:
    """Of some rows the one whose needle stands out most from what is around it."""
    some = range(0, len(rows), 4)

    def contrast(row: int) -> float:
        u, v = rows.points_px[row].round().astype(int)
        image = recording.frames[int(rows.frame[row])].astype(float)
        around = image[max(v - 25, 0) : v + 25, max(u - 25, 0) : u + 25]
        return float(image[v - 2 : v + 3, u - 2 : u + 3].mean() - np.percentile(around, 90))

    return max(some, key=contrast)


if __name__ == "__main__":
    main()
