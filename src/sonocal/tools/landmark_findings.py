"""What to know of a phantom's registration before its use."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from sonocal.findings import Diagnostic
from sonocal.tools.landmark_result import PhantomRegistration
from sonocal.tools.tip_check import TipDoubt

__all__ = ["landmark_findings"]

LARGE_RMS_MM = 1.0
# Of the scale, in deviations, and as a share that matters: a tip and a sensor's angle do as much as less than that.
SURE, MATTERS = 4.0, 5e-3
# Residuals to spare, of four landmarks.
FEW = 6


def landmark_findings(
    found: PhantomRegistration, rivals: Sequence[object], doubt: TipDoubt | None
) -> Iterator[Diagnostic]:
    """Findings of a registration.

    Args:
        found: the registration.
        rivals: other ways in which the touches fit the landmarks.
        doubt: that the stylus' tip is right.
    """
    if rivals:
        yield _warning(
            "landmarks-ambiguous",
            f"the touches fit the landmarks in {len(rivals) + 1} ways, of which the order listed was taken",
            "touch one more landmark that breaks the symmetry",
        )
    if doubt is not None:
        to = ", ".join(f"{x:.1f}" for x in doubt.tip_correction_mm)
        yield _warning(
            "stylus-tip-off",
            f"the tip of {doubt.stylus} moves as the stylus turns at rest: it is off by {doubt.off_mm:.1f} mm, "
            f"along ({to}) mm of its marker",
            "pivot the stylus and give the tip found",
        )
    yield from _left_out(found)
    yield from _too_few(found)
    if found.rms_mm > LARGE_RMS_MM:
        worst = found.worst
        yield _warning(
            "large-residual",
            f"the touches are {found.rms_mm:.2f} mm rms from their landmarks, worst {worst.name} with "
            f"{worst.distance_mm:.2f} mm",
            "check the stylus' tip, and that the phantom is the one the landmarks are of",
        )
    yield from _scale(found)


def _missing(names: Sequence[str], of_all: str, remedy: str) -> Iterator[Diagnostic]:
    """What is said of those that nobody went to, if there are any."""
    if names:
        yield Diagnostic(
            code="landmarks-missing",
            severity="info",
            message=f"{len(names)} of {of_all}: {', '.join(names)}",
            advice=f"nothing, where the wires' errors are small enough; else {remedy}, too",
        )


def _left_out(found: PhantomRegistration) -> Iterator[Diagnostic]:
    for one in found.landmarks:
        if one.distance_mm is not None and not one.used:
            yield _warning(
                "landmark-off",
                f"landmark {one.name} was touched {one.distance_mm:.2f} mm from where all others put it; it was left "
                "out",
                "touch it again, or measure where it is on the phantom",
            )
    missing = [one.name for one in found.landmarks if one.touched_mm is None]
    yield from _missing(missing, f"{len(found.landmarks)} landmarks were not touched", "touch them")
    for along in found.features:
        if along.distance_mm is not None and not along.used:
            yield _warning(
                "landmark-off",
                f"the stylus was dragged {along.distance_mm:.2f} mm from the {along.kind} {along.name}, where all "
                "others put it; it was left out",
                "drag along it again, or measure where it is on the phantom",
            )
    undragged = [one.name for one in found.features if one.distance_mm is None]
    of_all = f"{len(found.features)} lines and planes were not dragged along"
    yield from _missing(undragged, of_all, "drag along them")
    frames = {span for one in found.landmarks for span in one.frames}
    others = [rest for rest in found.rests if (rest.first, rest.last) not in frames]
    if others:
        where = ", ".join(f"{rest.first} to {rest.last}" for rest in others[:5])
        yield Diagnostic(
            code="rests-elsewhere",
            severity="info",
            message=f"the tip rested {len(others)} times at no landmark and these were left out: items {where}",
            advice="nothing, unless a landmark was meant there",
        )


def _too_few(found: PhantomRegistration) -> Iterator[Diagnostic]:
    if found.freedom > FEW:
        return
    along = f" and {sum(one.used for one in found.features)} lines and planes" if found.features else ""
    yield _warning(
        "few-landmarks",
        f"the registration rests on {sum(one.used for one in found.landmarks)} landmarks{along}, whose residual of "
        f"{found.rms_mm:.2f} mm says little",
        "touch six landmarks or more, as far apart as the phantom allows",
    )


def _scale(found: PhantomRegistration) -> Iterator[Diagnostic]:
    off = found.size_ratio - 1
    if abs(off) > max(SURE * found.size_ratio_deviation, MATTERS):
        size = "larger" if off > 0 else "smaller"
        length = (
            float(np.ptp([one.at_mm for one in found.landmarks], axis=0).max()) if found.landmarks else 100.0
        )
        yield _warning(
            "landmark-scale",
            f"the touches fit a phantom {100 * abs(off):.2f} % {size} (+-{196 * found.size_ratio_deviation:.2f} %), "
            f"which is {abs(off) * length:.1f} mm over "
            f"{'its length' if found.landmarks else f'{length:.0f} mm'}",
            "measure the phantom: printed ones shrink; and check that the stylus' tip is right",
        )


def _warning(code: str, message: str, advice: str) -> Diagnostic:
    return Diagnostic(code=code, severity="warning", message=message, advice=advice)
