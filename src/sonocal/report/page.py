"""The report: figures, numbers and words into one HTML file that needs no network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.metadata import version
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sonocal.calibration import Calibration, LabelledDots, seen_at_assumed_speed
from sonocal.calibration.diagnostics import describe_motion
from sonocal.calibration.found_targets import target_in_words
from sonocal.calibration.lagged import lag_in_words
from sonocal.calibration.models import model_in_words, scale_in_words
from sonocal.errors import UnsupportedError, require
from sonocal.findings import Diagnostic
from sonocal.geometry import area_places
from sonocal.observations import Observations
from sonocal.registration.uncertainty import weakest_motion
from sonocal.report import figures, places, views3d
from sonocal.report.labels import label_section
from sonocal.report.page_file import page_summary
from sonocal.report.pictures import FrameImage, chosen_pictures, picture_svg
from sonocal.report.style import RC
from sonocal.report.svg import figure_svg
from sonocal.report.templates import filled, now
from sonocal.validation import CANNOT_SHOW, Comparison, Validation, cannot_show, give_verdict
from sonocal.validation.whole import fitted_and_held_out, fitted_rows

__all__ = ["report_html"]

MOST_TARGETS = 6
# A title, the names of the numbers (mm), a place in px and the numbers there, sentences.
Difference = tuple[str, Sequence[str], Sequence[tuple[str, Sequence[str]]], Sequence[str]]


def report_html(
    calibration: Calibration,
    observations: Observations | None = None,
    validation: Validation | None = None,
    *,
    comparison: Comparison | None = None,
    other: str = "",
    differences: Sequence[Difference] = (),
    frames: Sequence[FrameImage] = (),
    labels: LabelledDots | None = None,
    images: Mapping[int, NDArray[np.uint8]] = MappingProxyType({}),
    title: str = "Probe calibration",
) -> bytes:
    """The report as the content of an HTML file.

    Args:
        calibration: what is reported.
        observations: the rows it was fitted to, and held-out ones; without them there are no residual figures.
        validation: its numbers.
        comparison: with another calibration.
        other: what that one is called, such as its file.
        differences: from matrices of other software.
        frames: images to show, with detections and needles.
        labels: of several wires whose dots nobody named, which was which.
        images: (H, W), grey values, some in which those are, by their numbers.
        title: of the page.

    Raises:
        UnsupportedError: matplotlib or jinja2 is not installed.
    """
    require("calibration", calibration, Calibration)
    try:
        import matplotlib as mpl
    except ImportError as error:
        raise UnsupportedError(
            f"the report needs {error.name}, which is not installed; pip install matplotlib jinja2, or --no-report"
        ) from None
    if observations is not None:
        observations = seen_at_assumed_speed(calibration.sound, observations)
    with mpl.rc_context(RC):
        drawn = _drawn(calibration, observations)
        found = _targets_drawn(calibration)
        labelled = None if labels is None else label_section(calibration, labels, images)
        pictures = [(frame.title, picture_svg(calibration, frame)) for frame in chosen_pictures(frames)]
    made, verdict, source = now(), give_verdict(calibration, validation), _source(calibration)
    return filled(
        "page.html",
        title=title,
        source=source,
        verdict=verdict,
        summary=page_summary(made, source, verdict, calibration.probe_from_image.matrix),
        cal=calibration,
        validation=validation,
        comparison=comparison,
        other=other,
        differences=differences,
        errors=_errors(calibration),
        standing=(CANNOT_SHOW, cannot_show(calibration)),
        reasons=list(zip(verdict.codes, verdict.reasons, strict=True)),
        findings=_beside_the_verdict(calibration, validation),
        figures=drawn,
        targets=found,
        pictures=pictures,
        labels=labelled,
        matrix=calibration.probe_from_image.matrix,
        words=_matrix_in_words(calibration),
        weak=_weak_in_words(calibration),
        provenance=_provenance(calibration, validation),
        made=made,
    )


def _beside_the_verdict(calibration: Calibration, validation: Validation | None) -> list[Diagnostic]:
    """What was found and is no reason of the verdict: of that, the verdict tells every warning."""
    found = [*calibration.diagnostics, *(validation.diagnostics if validation else ())]
    return [finding for finding in found if finding.severity != "warning"]


def _drawn(calibration: Calibration, observations: Observations | None) -> dict[str, str]:
    """The figures as inline SVG, by name; those that the calibration or the missing rows do not allow are absent."""
    shown = unseen = None
    width, height = np.ptp(calibration.area_px[:, :2], axis=0)
    map_size = (4.9, 1.7 + 3.2 * float(np.clip(height / max(width, 1e-9), 0.3, 1.5)))
    if observations is not None and len(observations):
        given = fitted_rows(calibration, observations)
        held = fitted_and_held_out(calibration, observations)[1]
        shown, unseen = (observations, None) if given is None else (given, held)
    drawn = {"frames": figure_svg("frames", (4.6, 4.2), lambda a: views3d.plot_frames(a, calibration), "3d")}
    if calibration.covariance is not None:
        drawn["predicted"] = figure_svg(
            "predicted", map_size, lambda a: figures.plot_predicted_error(a, calibration, shown)
        )
        drawn["weak"] = figure_svg(
            "weak", (4.6, 4.2), lambda a: views3d.plot_weak_motion(a, calibration), "3d"
        )
    if shown is not None:
        rows = shown
        drawn["residuals"] = figure_svg(
            "residuals", map_size, lambda a: figures.plot_residuals_over_image(a, calibration, rows)
        )
        drawn["by_frame"] = figure_svg(
            "by_frame", (7.6, 2.4), lambda a: figures.plot_residuals_by_frame(a, calibration, rows, unseen)
        )
        drawn["needles"] = figure_svg(
            "needles", (4.6, 4.2), lambda a: views3d.plot_needles(a, calibration, rows), "3d"
        )
        drawn["tilts"] = figure_svg(
            "tilts", (4.6, 4.2), lambda a: figures.plot_tilts(a, calibration, rows), "polar"
        )
    return drawn


def _targets_drawn(calibration: Calibration) -> list[tuple[str, str]]:
    """Of targets that were found with the calibration: where, as inline SVG of the first ones and in words."""
    return [
        (_target_drawn(calibration, i, name) if i < MOST_TARGETS else "", f"{target_in_words(name, target)}.")
        for i, (name, target) in enumerate(calibration.targets.items())
    ]


def _target_drawn(calibration: Calibration, number: int, name: str) -> str:
    def draw(axis: Any) -> None:
        places.plot_place(axis, calibration, name)

    return figure_svg(f"target_{number}", (4.6, 3.0), draw)


def _errors(calibration: Calibration) -> list[tuple[str, str, float, float]]:
    """Predicted error by place: name, pixels, rms, 95 %."""
    if calibration.covariance is None:
        return []
    places, rms, below = calibration.predicted_errors()
    names = ["corner"] * (len(places) - 1) + ["centre"]
    return [
        (name, ", ".join(f"{x:.0f}" for x in place), float(r), float(b))
        for name, place, r, b in zip(names, places, rms, below, strict=True)
    ]


def _matrix_in_words(calibration: Calibration) -> list[str]:
    """Where the image is and which way it runs, as one would check it with the probe in the hand."""
    transform = calibration.probe_from_image
    x, y, z = transform.translation
    away = np.linalg.norm(transform.translation)
    words = [f"The first pixel is at ({x:.1f}, {y:.1f}, {z:.1f}) mm, {away:.0f} mm from the marker's origin."]
    for i, (name, meaning) in enumerate((("u", "right"), ("v", "down"), ("w", "the normal"))):
        direction = transform.rotation[:, i]
        strongest = int(np.argmax(np.abs(direction)))
        sign = "+" if direction[strongest] > 0 else "-"
        angle = np.degrees(np.arccos(min(1.0, abs(direction[strongest]))))
        words.append(
            f"{name} ({meaning}) runs along the marker's {sign}{'xyz'[strongest]}, {angle:.0f}° off it."
        )
    words.append(f"Inside the matrix is the scale: {scale_in_words(calibration)}.")
    return [*words, *map(model_in_words, calibration.models), *filter(None, [lag_in_words(calibration)])]


def _weak_in_words(calibration: Calibration) -> str:
    if calibration.covariance is None:
        return ""
    corners = area_places(calibration.area_px)[:-1]
    motion = weakest_motion(calibration.probe_from_image, calibration.covariance, corners)
    return describe_motion(motion, calibration.noise.freedom)


def _source(calibration: Calibration) -> str:
    """What was given: a recording, or else the table."""
    kept = calibration.provenance
    return str(kept.get("recorded", {}).get("recording", {}).get("input", "") or kept.get("input", ""))


def _provenance(calibration: Calibration, validation: Validation | None) -> list[tuple[str, str]]:
    kept = calibration.provenance
    rows = [("fitted to", str(kept.get("input", ""))), ("its SHA-256", str(kept.get("sha256", "")))]
    for name, source in kept.get("recorded", {}).items():
        rows += [(f"from the {name}", source.get("input", "")), ("its SHA-256", source.get("sha256", ""))]
    rows += [
        (name.replace("_", " "), str(value))
        for name, value in kept.get("options", {}).items()
        if value is not None
    ]
    rows += [(f"version of {name}", str(value)) for name, value in kept.get("versions", {}).items()]
    if validation is not None and validation.source and validation.sha256 != kept.get("sha256"):
        rows += [("validated with", validation.source), ("its SHA-256", validation.sha256)]
    rows.append(("page written by", f"sonocal {version('sonocal')}"))
    return [(name, value) for name, value in rows if value]
