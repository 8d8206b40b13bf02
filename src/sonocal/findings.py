"""What a user should know about a recording or a calibration before using it, and the registry of codes."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from html import escape
from threading import Lock
from typing import Literal, overload

__all__ = [
    "CODES",
    "DECISIVE",
    "PAGE",
    "REASONS",
    "REFUSALS",
    "Diagnostic",
    "Findings",
    "anchor_of",
    "begun",
    "reading_order",
    "warnings_first",
]

# Where the documentation has a section for each code of the three tables.
PAGE = "docs/findings.md"

# Of characters, in a line of a session.
MOST_SHOWN = 200
# What no page may hold.
CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff\ufffe\uffff]")

# Codes of diagnostics, each with a title of one line.
CODES = {
    # calibration
    "weak-motion": "the predicted error exceeds what is accepted",
    "narrow-area": "the area seen is a band",
    "target-elsewhere": "a target is not where it was said to be",
    "phantom-elsewhere": "a phantom is not where its landmarks said",
    "phantom-shape": "a phantom has not the shape that its file says",
    "outside-image": "sightings lie outside of the image",
    "two-answers": "a second answer fits as well",
    "needle-in-image-plane": "needles lie in the image",
    "anisotropic-scale": "mm/px differ along the image's axes",
    "anisotropic-scale-far-off": "with mm/px of its own along every axis the answer is another one",
    "known-scale-disagrees": "the rows contradict the scale that was given",
    "known-scale-far-off": "with the rows' own scale the answer is another one",
    "known-scale-unchecked": "the rows cannot check the scale that was given",
    "image-distortion": "residuals are not alike all over the image",
    "sound-speed": "what the speed of sound does to a curved probe's image",
    "sound-speed-doubtful": "the speed of sound is not what it is said or found to be",
    "slice-thickness": "first echoes of a thick slice lie too shallow",
    "bent-needle": "residuals follow the place along the needle",
    "drifting-residuals": "neighbouring frames repeat one another's error",
    "few-targets": "too few wires to tell how far off the answer is",
    "unchecked-set-up": "what was not looked for",
    "offset-in-tracker": "the needle is off by one offset in the tracker's frame",
    "error-follows-pose": "images near in pose share an error",
    "shared-target-error": "rows of a needle or wire share an error",
    "shared-frame-error": "rows of a frame share an error",
    "repeated-rows": "rows repeat one another",
    "no-redundancy": "no row is left to check the answer",
    "many-outliers": "many rows or poses were left out",
    "left-out-rows-agree": "rows that were left out agree on another calibration",
    "not-converged": "the refinement did not come to rest",
    "held-out-rows-off": "held-out rows are further off than the fit explains",
    "held-out-rows-far-off": "held-out rows are off by far more than is accepted",
    # setup_checks
    "implausible-units": "lengths are not in mm, or places not in px",
    "latency": "image and tracker are not of the same instant",
    "latency-beyond-tolerance": "with the lag undone the answer is another one",
    "marker-slipped": "the marker moved on the probe during the scan",
    "two-markers": "one rigid motion parts the rows in two",
    "flipped-image": "the image is mirrored or turned",
    "unexpected-orientation": "the expected orientation is another one",
    "scale-differs-from-scanner": "mm/px are not what the scanner says",
    "wrong-end-of-needle": "the needle is seen beyond an end of its segment",
    "wrong-tool-frame": "the lines are in another frame than the probe marker's",
    "threshold-below-noise": "the threshold cuts off rows of the needle itself",
    # sweep
    "second-needle": "a second needle, or an echo, moves with the needle",
    "second-wall": "a second line runs along the wall",
    "labels-given": "which wire bears which number, and how far the next best labels are",
    "labels-ambiguous": "which dot is of which wire is not decided by the images",
    "labels-unfinished": "the search for labels of wires ended early",
    "wrong-poses": "poses are inverted, transposed, or of another quaternion order",
    "images-used": "how many images took part",
    "no-pose": "detections without a valid pose",
    "no-image": "detections in images marked invalid",
    # recording
    "no-times": "no item has a time stamp",
    "stamps-out-of-order": "stamps run backwards",
    "stamps-repeated": "frames share a stamp",
    "gaps": "long gaps between stamps",
    "invalid-poses": "poses marked invalid",
    "non-rigid-poses": "poses with scale or shear",
    "identity-poses": "poses that move nothing, among others far away",
    "static-tool": "a tool does not move",
    "frozen-poses": "a pose repeats to the last digit, for a while",
    "invalid-images": "images marked invalid",
    "frozen-images": "the image stood still for a while",
    "duplicated-images": "images repeat the one before them",
    "orientation-unknown": "the file does not say how images are oriented",
    "orientation-changed": "images were turned to u right, v down",
    "region-scales": "parts of the image have mm/px of their own",
    "private-volumes": "volumes that are not read stand beside the pictures",
    "scan-converted": "a volume was brought from beams to cubes",
    "constant-transforms": "a scene's transforms that stand once hold for all items",
    "motive-axes": "Motive's world has Y up",
    "time-unit": "times are not in seconds",
    "marker-fit": "how well markers fit a rigid body",
    # tools
    "repeated-poses": "poses repeat others to the last digit",
    "little-tilt": "the tool was hardly tilted",
    "large-residual": "the tip moves about the pivot, or touches lie far from their landmarks",
    "slipped-tip": "the tip left its divot",
    "tip-off-axis": "the tip lies beside the axis",
    "ends-unknown": "the needle's ends are not known",
    "short-needle": "the needle's two points are close together",
    "little-turn": "the tool hardly turned about its axis",
    "wobbling-axis": "the axis wobbles",
    "landmarks-ambiguous": "touches fit a phantom's landmarks in several ways",
    "landmarks-missing": "landmarks of a phantom were not touched",
    "landmark-off": "a landmark lies off where all others put it",
    "landmark-scale": "a phantom is larger or smaller than it is said to be",
    "few-landmarks": "a phantom's place rests on few landmarks",
    "stepper-tilted": "a stepper's axes are not parallel",
    "little-travel": "a stepper moved a probe little",
    "rests-elsewhere": "the tip rested at no landmark",
    "stylus-tip-off": "a stylus' tip is not where it is said to be",
    # validation
    "not-computed": "a quantity could not be computed",
    "points-off": "points are further from where they are known to be than predicted",
    "points-far-off": "points are off by far more than is accepted",
    "other-depth-setting": "another scan has other mm/px",
    "calibrations-differ": "two calibrations differ by more than their uncertainty",
    "calibration-changed": "a short sweep contradicts the calibration",
    "check-too-weak": "a short sweep cannot tell whether the calibration holds",
    # existing
    "direction-by-scale": "which way a file's matrix goes was told by its scale",
    "transposed-matrix": "a file's matrix is transposed",
    "rigid-matrix": "a matrix scales nothing",
    "inverted-matrix": "a matrix leads from the probe to the image",
    "sheared-matrix": "a matrix shears the image",
    "mirrored-matrix": "a matrix mirrors",
    "third-column": "a matrix's third column is not the image's normal",
    "misread-matrix": "a matrix is right when it is read otherwise",
    "expected-scale-differs": "the expected calibration has other mm/px",
    "worse-than-ours": "another matrix leaves more error than the calibration of the same rows",
}

# Codes of `DegenerateGeometryError`: data that leave a motion free are refused.
REFUSALS = {
    "parallel-lines": "all lines are parallel",
    "lines-through-one-point": "all lines pass through one point",
    "coplanar-lines": "all lines lie in one plane",
    "collinear-image-points": "all image points lie on one line",
    "one-image-point": "all rows have one image point",
    "free-motion": "the rows that agree leave a motion free",
    "points-on-one-line": "the points lie on one line",
    "rank-deficient": "the correspondences determine too little",
    "crosswire-poses": "the probe hardly turned about the cross-wire",
    "static-signal": "a signal does not move",
    "no-alignment": "no lag aligns the signals",
    "lag-untold": "the motion tells no lag",
    "unplaced-translation": "a target's place is not known, and the probe hardly turned",
    "unplaced-one-axis": "a target's place is not known, and the probe turned about one axis only",
    "unplaced-pivot": "a target's place is not known, and it stays at one place of the image",
    "unplaced-scale": "a target's place is not known, and the motion leaves the scale free",
    "unplaced-motion": "a target's place is not known, and the motion tells it too little",
    "still": "the tool hardly turned",
    "little-tilt": "the tool turned about one axis only",
    "not-a-spin": "the tool turned about more than one axis",
    "points-too-close": "the needle's two points are one within their noise",
    "moving": "the stylus moved during the touch",
    "stepper-still": "a stepper hardly moved the probe",
    "not-a-line": "a stepper moved the probe along no line",
    "phantom-free": "what the stylus touched leaves a motion of the phantom free",
    "landmarks-ambiguous": "touches fit a phantom's landmarks in several ways",
}

# Codes of findings that explain others: many rows left out, a weak motion, a drift. They are read first.
DECISIVE = {
    "implausible-units",
    "known-scale-disagrees",
    "latency",
    "latency-beyond-tolerance",
    "wrong-poses",
    "wrong-tool-frame",
    "flipped-image",
    "misread-matrix",
}

# Codes that name a cause beside those, and codes of what such causes bring about: the first are read before, the last
# after all others. Whoever mends the cause need not mend them.
CAUSES = {
    "implausible-units",
    "outside-image",
    "repeated-rows",
    "marker-slipped",
    "two-markers",
    "left-out-rows-agree",
    "wrong-end-of-needle",
    "second-needle",
    "second-wall",
    "labels-ambiguous",
    "labels-unfinished",
    "threshold-below-noise",
    "anisotropic-scale",
    "anisotropic-scale-far-off",
    "known-scale-disagrees",
    "known-scale-far-off",
    "other-depth-setting",
    "unexpected-orientation",
    "scale-differs-from-scanner",
    "image-distortion",
    "slice-thickness",
    "offset-in-tracker",
}
CONSEQUENCES = {
    "weak-motion",
    "drifting-residuals",
    "error-follows-pose",
    "many-outliers",
    "not-converged",
    "no-predicted-error",
    "predicted-error-beyond-tolerance",
}

# What a code explains is not said beside it: first echoes part the needles in those that lean one way and the other.
# A scale that is wrong leaves the rows far from their lines, wherever these are and whenever they were.
EXPLAINED = {
    "slice-thickness": {"two-markers"},
    "known-scale-disagrees": {
        "wrong-tool-frame",
        "wrong-poses",
        "marker-slipped",
        "two-markers",
        "left-out-rows-agree",
    },
}

# Codes of reasons of a verdict that are no findings.
REASONS = {
    "no-predicted-error": "no error can be predicted",
    "predicted-error-beyond-tolerance": "the predicted error is far above what is accepted",
}


@dataclass(frozen=True)
class Diagnostic:
    """One finding.

    Attributes:
        code: short name, for programs; those that sonocal gives are in `CODES`, files may hold others.
        severity: "warning" (read before use) or "info".
        message: what was found, with numbers and units.
        advice: what to do about it.
    """

    code: str
    severity: Literal["warning", "info"]
    message: str
    advice: str

    def __repr__(self) -> str:
        return f"<Diagnostic {_cut(f'{self.severity} {self.code}: {self.message}')}>"

    def _repr_html_(self) -> str:
        head = "Warning" if self.severity == "warning" else "Note"
        code, message, advice = (
            escape(CONTROL.sub(" ", text))
            for text in (self.code, _sentence(self.message), _sentence(self.advice))
        )
        return f'<div class="sonocal"><b>{head}</b> <code>{code}</code><br/>{message} <i>{advice}</i></div>'

    @property
    def anchor(self) -> str:
        """Where the documentation says more: page and section."""
        return anchor_of(self.code)


def anchor_of(code: str) -> str:
    """The section of the documentation for a code of any of the tables; the page alone for another."""
    return f"{PAGE}#{code}" if code in {*CODES, *REFUSALS, *REASONS} else PAGE


def _sentence(text: str) -> str:
    """A message as it stands alone."""
    return f"{begun(text)}."


def _cut(text: str) -> str:
    """As much of a text as a line of a session has room for, without control characters."""
    shown = repr(text)[1:-1]
    return shown if len(shown) <= MOST_SHOWN else f"{shown[:MOST_SHOWN]}..."


def begun(words: str) -> str:
    """The words as the beginning of a sentence: a capital first, but for names of files and tools, and letters of axes.

    A plain word is small letters up to a blank or a comma behind which the sentence goes on: ``sweep.igs.mha, frame 3``
    and ``stylus: 2 of 9 poses`` keep their names' own spelling.
    """
    return words[0].upper() + words[1:] if re.match(r"a |[a-z][a-z'-]+(?:\.?$|,? )", words) else words


class Findings(Sequence[Diagnostic]):
    """Findings of which some are looked for when one is first read: whoever asks for none waits for none.

    Args:
        found: what was found already.
        looks: each is called once, for more; then all stand with warnings first.
    """

    def __init__(
        self, found: Iterable[Diagnostic] = (), looks: Iterable[Callable[[], Iterable[Diagnostic]]] = ()
    ) -> None:
        self._found, self._looks, self._lock = tuple(found), tuple(looks), Lock()

    def with_further(self, findings: Iterable[Diagnostic]) -> Findings:
        """These and others, warnings first, still looked for when one is read."""
        return Findings(looks=(self.__iter__, tuple(findings).__iter__))

    def read(self) -> tuple[Diagnostic, ...]:
        """All of them."""
        with self._lock:
            if self._looks:
                further = [finding for look in self._looks for finding in look()]
                self._found, self._looks = warnings_first([*self._found, *further]), ()
            return self._found

    def __len__(self) -> int:
        return len(self.read())

    def __iter__(self) -> Iterator[Diagnostic]:
        return iter(self.read())

    @overload
    def __getitem__(self, index: int) -> Diagnostic: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Diagnostic, ...]: ...
    def __getitem__(self, index: int | slice) -> Diagnostic | tuple[Diagnostic, ...]:
        return self.read()[index]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and self.read() == tuple(other)

    def __add__(self, other: Iterable[Diagnostic]) -> tuple[Diagnostic, ...]:
        return (*self.read(), *other)

    __hash__ = None  # type: ignore[assignment]  # as of any sequence that may still grow

    def __repr__(self) -> str:
        warnings = sum(one.severity == "warning" for one in self)
        codes = ", ".join(one.code for one in self) or "none"
        return f"<Findings, {warnings} of {len(self)} to read before use: {_cut(codes)}>"

    def _repr_html_(self) -> str:
        items = "".join(f"<li>{one._repr_html_()}</li>" for one in self) or "<li>Nothing was found.</li>"
        return f'<ul class="sonocal" style="text-align:left">{items}</ul>'

    def __reduce__(self) -> tuple[type[Findings], tuple[tuple[Diagnostic, ...]]]:
        return Findings, (self.read(),)


def warnings_first(findings: Iterable[Diagnostic]) -> tuple[Diagnostic, ...]:
    """The findings in their order: those to read before use before the others, of these what explains others first.

    Those that another one explains are left out.
    """
    findings = tuple(findings)
    explained = {code for one in findings for code in EXPLAINED.get(one.code, ())}
    findings = tuple(one for one in findings if one.code not in explained)
    return tuple(sorted(findings, key=lambda one: (one.severity != "warning", reading_order(one.code))))


def reading_order(code: str) -> int:
    """How early a code is read, on the screen, in files and among a verdict's reasons: causes before what they do."""
    places = (code in DECISIVE, code in CAUSES, code not in CONSEQUENCES)
    return places.index(True) if any(places) else len(places)
