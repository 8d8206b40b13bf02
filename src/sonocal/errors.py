"""What can go wrong, as a tree.

SonocalError                       every failure sonocal foresees: one sentence, exit status 1
├── InputError                     what arrived cannot be used: file, row, field, value, remedy
│   └── FormatError                a file that is not what its name or header says
├── DegenerateGeometryError        the data leave a motion free: which one, and what to scan next
├── NoConsensusError               no calibration agrees with enough rows
│   └── MirroredVolumeError        as they stand; mirrored along one axis of the volume, they do
└── UnsupportedError               sound input that sonocal does not handle
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import TYPE_CHECKING, Self

if TYPE_CHECKING:
    from sonocal.findings import Diagnostic

__all__ = [
    "DegenerateGeometryError",
    "FormatError",
    "InputError",
    "MirroredVolumeError",
    "NoConsensusError",
    "SonocalError",
    "UnsupportedError",
    "require",
]


# Of characters, in a line of a session; the sentence itself is whole.
MOST_SHOWN = 300


class SonocalError(Exception):
    """Every failure that sonocal foresees; its text is one sentence for the user, in one line.

    Attributes:
        diagnostics: what was found in the data that were refused, with what explains the refusal first.
        refusal: the sentence as it was before findings explained it; None where none did.
    """

    diagnostics: tuple[Diagnostic, ...] = ()
    refusal: str | None = None

    def __init__(self, message: str) -> None:
        super().__init__(_one_line(message))

    def __repr__(self) -> str:
        said = repr(str(self))
        return f"{type(self).__name__}({said if len(said) <= MOST_SHOWN else said[:MOST_SHOWN] + '...'})"

    def explained(self, findings: Iterable[Diagnostic], message: str | None = None) -> Self:
        """The same failure with what was found, and with another sentence where one is given."""
        self.diagnostics = tuple(findings)
        if message is not None:
            self.refusal = self.refusal or str(self)
            self.args = (_one_line(message), *self.args[1:])
        return self


class InputError(SonocalError):
    """What arrived cannot be used: says the file, row and field, what arrived and what to do."""


class FormatError(InputError):
    """A file is not what its name or its header says it is."""


# What arguments of the public face are, and where one comes from.
WORDS = {
    "Calibration": "a calibration (see load)",
    "Detections": "points found in images (see read_detections)",
    "Line": "a list of lines (see read_lines)",
    "Observations": "a table of sightings (see read_observations)",
    "Recording": "a recording (see read_recording)",
    "Rows": "rows of correspondences (see sonocal.registration.constraints)",
    "Study": "a study (see load_study)",
}


def require(name: str, value: object, kind: type, words: str = "") -> None:
    """Refuse what is of another kind than an argument of the public face must be.

    Args:
        name: of the argument.
        value: what arrived.
        kind: what it must be.
        words: the kind in words, with where one comes from; default: those of `WORDS`.

    Raises:
        InputError: it is of another kind.
    """
    if not isinstance(value, kind):
        wanted = words or WORDS.get(kind.__name__, f"of the class {kind.__name__}")
        raise InputError(f"{name} must be {wanted}; got {value!r}"[:200])


class DegenerateGeometryError(SonocalError):
    """The data leave a motion of the image free.

    Attributes:
        code: short name of the configuration, for programs, such as ``"parallel-lines"``.
    """

    def __init__(self, message: str, code: str) -> None:
        super().__init__(message)
        self.code = code


class NoConsensusError(SonocalError):
    """No calibration agrees with enough rows.

    Attributes:
        best_count: the largest number of rows that any candidate agreed with.
    """

    def __init__(self, message: str, best_count: int) -> None:
        super().__init__(message)
        self.best_count = best_count


class MirroredVolumeError(NoConsensusError):
    """No calibration agrees with the rows of a volume as they stand, and one does when an axis is turned round."""


class UnsupportedError(SonocalError):
    """Sound input that sonocal does not handle."""


def _one_line(message: str) -> str:
    """A message whose quotes of what arrived, such as an array, may have several lines."""
    return re.sub(r"\s*[\r\n\v\f\x1c-\x1e\x85\u2028\u2029]+\s*", " ", message)
