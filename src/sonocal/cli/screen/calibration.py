"""What the command line shows: warnings first, then what to trust, then the matrix."""

from __future__ import annotations

from typing import Any

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.markup import escape
from rich.text import Text

from sonocal.calibration import Calibration, ErrorStatistics, point_line_rows
from sonocal.calibration.found_phantom import phantom_in_words
from sonocal.calibration.found_targets import target_in_words
from sonocal.calibration.lagged import lag_in_words
from sonocal.calibration.models import model_in_words, scale_in_words
from sonocal.cli.screen.parts import print_findings, standing, verdict_text
from sonocal.cli.screen.tables import MatrixRows, NumberTable
from sonocal.geometry import similarity_errors
from sonocal.observations import Observations
from sonocal.registration.degeneracy import direction_spread
from sonocal.simulation.scene import SimulatedSightings
from sonocal.validation import give_verdict

__all__ = ["observation_splits", "print_calibration", "print_observations", "print_truth"]


def print_calibration(console: Console, calibration: Calibration) -> None:
    """Warnings, verdict, errors, matrix, findings."""
    print_findings(console, calibration.warnings)
    console.print(verdict_text(give_verdict(calibration)))
    console.print()
    console.print(_error_table(calibration))
    console.print("These say how well rows agree, not how well the image is placed.")
    console.print()
    if calibration.covariance is not None:
        console.print(_prediction_table(calibration))
    console.print(_matrix(calibration))
    for tested in calibration.models:
        console.print(model_in_words(tested))
    if lag := lag_in_words(calibration):
        console.print(lag)
    for name, target in calibration.targets.items():
        console.print(f"{escape(target_in_words(name, target))}.")
    if calibration.phantom is not None:
        console.print(f"{escape(phantom_in_words(calibration.phantom))}.")
    console.print(standing(calibration))
    print_findings(console, calibration.diagnostics, "info")


def print_truth(console: Console, calibration: Calibration, simulated: SimulatedSightings) -> None:
    """The calibration's error against the truth it was simulated with."""
    angle, distance, scale = similarity_errors(calibration.probe_from_image, simulated.probe_from_image)
    places, _, below = calibration.predicted_errors()
    missed = calibration.probe_from_image @ places - simulated.probe_from_image @ places
    table = NumberTable(
        "Error against the known truth",
        "rotation, deg",
        "translation, mm",
        "scale, mm/px",
        "worst corner, mm",
    )
    worst = float((missed**2).sum(axis=-1).max() ** 0.5)
    table.add_row(
        "",
        f"{np.degrees(angle):.3f}",
        f"{distance:.3f}",
        f"{scale:.6f}",
        f"{worst:.2f} (predicted < {below.max():.2f})",
    )
    console.print(table)


def print_observations(console: Console, observations: Observations) -> None:
    """What is in a table of sightings."""
    places = ("u, px", "v, px", "w, px")[: observations.dimension]
    table = NumberTable(
        f"{observations.source}: sightings for a {observations.dimension}D probe",
        *("rows", "frames", "targets", *places),
        "tilt spread, deg" if observations.lines_only else "points, lines, planes",
        first="split",
    )
    for split in observation_splits(observations):
        table.add_row(
            split["split"] or "(none)",
            *(str(split[name]) for name in ("rows", "frames", "targets")),
            *(f"{low:.0f} to {high:.0f}" for low, high in zip(*split["box_px"], strict=True)),
            f"{split['tilt_spread_deg']:.1f}" if observations.lines_only else _kinds(split),
        )
    console.print(table)
    if observations.extra:
        console.print(f"further columns, kept: {escape(', '.join(observations.extra))}")


def _kinds(split: dict[str, Any]) -> str:
    return ", ".join(str(split["rows_of"][kind]) for kind in ("points", "lines", "planes"))


def observation_splits(observations: Observations) -> list[dict[str, Any]]:
    """What is in each split of a table of sightings."""
    parts = {name: observations.select_split(name) for name in dict.fromkeys(observations.split.tolist())}
    return [
        {
            "split": name,
            "rows": len(part),
            "frames": len(set(part.frame.tolist())),
            "targets": len(set(part.target.tolist())),
            "box_px": [part.points_px.min(0).tolist(), part.points_px.max(0).tolist()],
            **_targets(part),
        }
        for name, part in parts.items()
    ]


def _targets(part: Observations) -> dict[str, Any]:
    """How far lines are tilted; of a table with points or planes, how many rows are of each kind."""
    if part.lines_only:
        return {"tilt_spread_deg": float(np.degrees(direction_spread(point_line_rows(part))))}
    kinds = {1: "points", 2: "lines", 3: "planes"}
    return {"rows_of": {name: int(np.count_nonzero(part.spans == spans)) for spans, name in kinds.items()}}


def _error_table(calibration: Calibration) -> NumberTable:
    table = NumberTable(
        "Distance of mapped points to their targets, mm",
        "rms",
        "median",
        "95 %",
        "max",
        "rows within threshold",
    )
    for name, errors in (("fitted rows", calibration.fit), ("held-out rows", calibration.test)):
        if errors is not None:
            table.add_row(name, *_statistics(errors))
    return table


def _statistics(errors: ErrorStatistics) -> list[str]:
    values = (errors.rms_mm, errors.median_mm, errors.p95_mm, errors.max_mm)
    return [*(f"{value:.3f}" for value in values), f"{errors.inliers} of {errors.observations}"]


def _prediction_table(calibration: Calibration) -> NumberTable:
    places, rms, below = calibration.predicted_errors()
    axes = ", ".join("uvw"[: calibration.dimension])
    table = NumberTable(
        f"Predicted error of the calibration over the {calibration.area_name}, mm",
        f"at ({axes}), px",
        "rms",
        "95 % below",
    )
    for i, place in enumerate(places):
        name = "centre" if i == len(places) - 1 else "corner"
        table.add_row(name, ", ".join(f"{x:.0f}" for x in place), f"{rms[i]:.2f}", f"{below[i]:.2f}")
    return table


def _matrix(calibration: Calibration) -> RenderableType:
    transform = calibration.probe_from_image
    title = Text(
        "probe_from_image (PLUS: ImageToProbe): mm in the probe marker's frame from px", style="bold"
    )
    return Group(
        title,
        MatrixRows(transform.matrix),
        Text(
            f"Scale: {scale_in_words(calibration)}; the scale is inside the matrix, and the origin is the centre of "
            "the first pixel."
        ),
    )
