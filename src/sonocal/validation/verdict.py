"""The verdict in words: use it, use it with care, do not use it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from sonocal.calibration import Calibration
from sonocal.findings import Diagnostic
from sonocal.validation.whole import Validation

__all__ = ["SPOILING", "Verdict", "give_verdict"]

# Findings that say the answer itself is wrong, not only less certain.
SPOILING = {
    "no-redundancy",
    "not-converged",
    "flipped-image",
    "marker-slipped",
    "wrong-tool-frame",
    "wrong-end-of-needle",
}
# Beyond this many times what the user accepts, care does not help.
HOPELESS = 3.0
TOLERANCE_MM = 2.0


@dataclass(frozen=True)
class Verdict:
    """Whether to use a calibration.

    Attributes:
        level: for programs and colours.
        headline: the verdict in two or three words.
        expectation: what error to expect, in one sentence.
        reasons: why it is not better, each a sentence without its full stop.
    """

    level: Literal["use", "care", "stop"]
    headline: str
    expectation: str
    reasons: tuple[str, ...]


def give_verdict(calibration: Calibration, validation: Validation | None = None) -> Verdict:
    """Weigh the predicted error, the findings and, where there are held-out rows, their error."""
    findings = [*calibration.warnings]
    findings += [d for d in (validation.diagnostics if validation else ()) if d.severity == "warning"]
    reasons = [_sentence(finding) for finding in findings]
    if calibration.covariance is None:
        return Verdict("stop", "Do not use it", "No error can be predicted.", tuple(reasons))
    below = calibration.predicted_errors()[2]
    worst, centre = float(below[:-1].max()), float(below[-1])
    expectation = (
        f"Expect errors of the calibration up to {worst:.1f} mm at the image's corners and {centre:.1f} mm at its "
        "centre (95 %)."
    )
    tolerance = float(calibration.provenance.get("options", {}).get("tolerance_mm", TOLERANCE_MM))
    if worst > HOPELESS * tolerance:
        reasons.insert(0, f"the predicted error is over {HOPELESS:g} times the {tolerance:g} mm accepted")
    if reasons and (worst > HOPELESS * tolerance or SPOILING & {d.code for d in findings}):
        return Verdict("stop", "Do not use it", expectation, tuple(reasons))
    surprise = _surprise(calibration, validation)
    reasons += [surprise] if surprise else []
    if reasons:
        return Verdict("care", "Use it with care", expectation, tuple(reasons))
    return Verdict("use", "Use it", expectation, ())


def _surprise(calibration: Calibration, validation: Validation | None) -> str | None:
    """Held-out rows that are further off than the fit and its uncertainty explain."""
    held = next((q for q in validation.quantities if q.code == "held-out"), None) if validation else None
    if held is None:
        return None
    expected = (calibration.fit.rms_mm**2 + float(calibration.predicted_errors()[1].max()) ** 2) ** 0.5
    if not held.low_mm > expected:
        return None
    return (
        f"held-out rows are off by {held.value_mm:.2f} mm rms (at least {held.low_mm:.2f}), where the fit and its "
        f"uncertainty explain {expected:.2f} mm"
    )


def _sentence(finding: Diagnostic) -> str:
    return f"{finding.message}; {finding.advice}"
