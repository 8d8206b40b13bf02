"""Another calibration beside the one that is judged: how far apart they are, as read and, of a misread one, read so."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from sonocal.calibration import Calibration
from sonocal.existing.difference import Difference, difference
from sonocal.existing.expected import agreeing, misread_against
from sonocal.existing.fitting import Rereading
from sonocal.existing.matrix import Existing
from sonocal.existing.worth import Worth
from sonocal.findings import Diagnostic, warnings_first
from sonocal.geometry import Array

__all__ = ["Compared", "compared", "worth_compared"]

# Of two files of other software in one command.
OPTION = "--stored-as"
FOR_BOTH = (
    f"; {OPTION} is for both files of a command: bring this one into another form with sonocal export first"
)


@dataclass(frozen=True, eq=False)
class Compared:
    """Two calibrations, one of them at least a matrix of other software.

    Attributes:
        difference: of the two, as they were read, and as they agree.
        rereadings: how the other one agrees, where it was misread: of several ways this does not tell which is right.
    """

    difference: Difference
    rereadings: tuple[Rereading, ...] = ()


def compared(other: Existing, calibration: Calibration) -> Compared:
    """A matrix against a calibration of ours."""
    ways = agreeing(other, calibration)
    area = calibration.area_px
    apart = difference(other, calibration, area, "ours")
    if len(ways) == 1:
        so = difference(ways[0].of(other), calibration, area, "ours")
        apart = replace(apart, reread=so, because=f"{other.said} {ways[0].words}")
    return Compared(apart, tuple(ways))


def worth_compared(
    worth: Worth, other: Existing | Calibration, area_px: Array, name: str
) -> tuple[Worth, Compared]:
    """A matrix that was measured against another calibration; with it, what is found of the two.

    A matrix is compared with our own calibration of the rows, to tell whether it was misread. Where neither rows nor
    points told it of the matrix that was measured, a calibration of ours beside it does.

    Args:
        worth: of the matrix that was measured.
        other: what it is compared with.
        area_px: (2, d): of the image.
        name: of the other, in messages.
    """
    ways: Sequence[Rereading] = ()
    if isinstance(other, Existing) and worth.own is not None:
        ways = agreeing(other, worth.own)
        worth = _with(worth, _of_the_other(worth, other, ways, worth.own)) if ways else worth
    known = worth.own is not None or worth.rereadings  # by rows or points, which say more
    if isinstance(other, Calibration) and not known and (found := agreeing(worth.existing, other)):
        told = misread_against(worth.existing, found, other, name)
        worth = _with(replace(worth, rereadings=tuple(found)), replace(told, severity="warning"))
    return worth, Compared(_as_they_agree(worth, other, ways, area_px), tuple(ways))


def _of_the_other(worth: Worth, other: Existing, ways: Sequence[Rereading], own: Calibration) -> Diagnostic:
    """That the other one was misread; the option that would mend it mends both, where both need it alike."""
    found = misread_against(other, ways, own, "our own calibration of these rows")
    alike = [one.name for one in worth.rereadings] == [one.name for one in ways]
    return found if alike or OPTION not in found.advice else replace(found, advice=found.advice + FOR_BOTH)


def _as_they_agree(
    worth: Worth, other: Existing | Calibration, ways: Sequence[Rereading], area_px: Array
) -> Difference:
    """How far apart two are as they were read, and with the mistakes undone that are known, of either."""
    apart = difference(worth.existing, other, area_px, "the other")
    pairs = [(worth.existing, worth.rereadings), (other, ways)]
    words = [
        f"{one.said} {found[0].words}"
        for one, found in pairs
        if isinstance(one, Existing) and len(found) == 1
    ]
    if not words:
        return apart
    meant = ways[0].of(other) if len(ways) == 1 and isinstance(other, Existing) else other
    so = difference(worth.reread or worth.existing, meant, area_px, "the other")
    return replace(apart, reread=so, because="; ".join(words))


def _with(worth: Worth, finding: Diagnostic) -> Worth:
    return replace(worth, diagnostics=warnings_first([*worth.diagnostics, finding]))
