"""The one verdict: use it, use it with care, do not use it; and why."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from sonocal.calibration import Calibration
from sonocal.calibration.area import expected_errors, in_mm
from sonocal.calibration.held_out import FAR, is_far_off
from sonocal.errors import require
from sonocal.findings import Diagnostic, reading_order
from sonocal.geometry.cards import card
from sonocal.geometry.shown import brief
from sonocal.validation.whole import Validation

__all__ = ["SPOILING", "Verdict", "give_verdict"]

# Findings that say the answer itself is wrong, not only less certain.
SPOILING = {
    "no-redundancy",
    "not-converged",
    "flipped-image",
    "latency-beyond-tolerance",
    "wrong-poses",
    "marker-slipped",
    "two-markers",
    "wrong-tool-frame",
    "wrong-end-of-needle",
    "held-out-rows-far-off",
    "points-far-off",
    "implausible-units",
    "outside-image",
    "left-out-rows-agree",
    "anisotropic-scale-far-off",
    "known-scale-far-off",
}
# Findings that measured an error beyond the predicted one.
BEYOND_PREDICTED = {
    "held-out-rows-off",
    "held-out-rows-far-off",
    "points-off",
    "points-far-off",
    "calibrations-differ",
}
# Codes of reasons that are no findings.
NO_PREDICTION, HOPELESS_ERROR = "no-predicted-error", "predicted-error-beyond-tolerance"


Level = Literal["use", "care", "stop"]
HEADLINES: dict[Level, str] = {"use": "Use it", "care": "Use it with care", "stop": "Do not use it"}


@dataclass(frozen=True)
class Verdict:
    """Whether to use a calibration.

    Attributes:
        level: for programs and colours.
        headline: the verdict in two or three words.
        expectation: what error to expect, in one sentence.
        reasons: why it is not better, each a sentence without its full stop.
        codes: of the reasons, in their order, for programs.
    """

    level: Level
    headline: str
    expectation: str
    reasons: tuple[str, ...] = ()
    codes: tuple[str, ...] = ()

    __repr__ = brief

    def _repr_html_(self) -> str:
        return card(
            self.headline, self.expectation, zip(self.codes, self.reasons, strict=True), tone=self.level
        )

    @property
    def remark(self) -> str:
        """The verdict in one line, for a file's comment."""
        why = f" ({', '.join(self.codes)})" if self.codes else ""
        return f"sonocal's verdict: {self.headline}{why}. {self.expectation}"


def give_verdict(calibration: Calibration, validation: Validation | None = None) -> Verdict:
    """Weigh the predicted error and the findings: the same wherever a calibration is shown.

    Args:
        calibration: with what it says of itself: its fit, its set-up, its held-out rows.
        validation: what other rows say of it.
    """
    require("calibration", calibration, Calibration)
    warnings = [*calibration.warnings]
    warnings += [d for d in (validation.diagnostics if validation else ()) if d.severity == "warning"]
    why = [(finding.code, _sentence(finding)) for finding in warnings]
    if calibration.covariance is None:
        why.append((NO_PREDICTION, "nothing is left over to tell how far off it is"))
        return _verdict("stop", "No error can be predicted.", why)
    below = calibration.predicted_errors()[2]
    expectation = expected_errors(calibration, below)
    if any(code in BEYOND_PREDICTED for code, _ in why):
        # Not "expect": nobody should take home a number that was measured to be wrong.
        worst = in_mm(below[:-1].max())
        expectation = f"What was measured contradicts the predicted errors of up to {worst} mm (95 %)."
    tolerance = calibration.options.tolerance_mm
    hopeless = is_far_off(calibration, float(below[:-1].max()))
    if hopeless:
        why.append(
            (
                HOPELESS_ERROR,
                f"the predicted error is over {FAR:g} times the {tolerance:g} mm accepted",
            ),
        )
    spoilt = any(code in SPOILING for code, _ in why)
    return _verdict("stop" if hopeless or spoilt else "care" if why else "use", expectation, why)


def _verdict(level: Level, expectation: str, why: list[tuple[str, str]]) -> Verdict:
    why = sorted(why, key=lambda reason: reading_order(reason[0]))
    codes, reasons = tuple(code for code, _ in why), tuple(reason for _, reason in why)
    return Verdict(level, HEADLINES[level], expectation, reasons, codes)


def _sentence(finding: Diagnostic) -> str:
    return f"{finding.message}; {finding.advice}"
