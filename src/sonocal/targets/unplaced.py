"""Targets whose place nobody knows, or knows roughly: it is found with the calibration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from sonocal.errors import InputError
from sonocal.geometry import Array, frozen, real_array
from sonocal.geometry.shown import brief
from sonocal.targets.lines import Line, Plane, Point, Target
from sonocal.targets.phantom import Phantom

__all__ = ["KINDS", "Kind", "Unplaced", "kind_of", "of_phantom"]

Kind = Literal["point", "line", "plane"]
KINDS: tuple[Kind, ...] = ("point", "line", "plane")
"""A point is spanned by one point, a line by two, a plane by three."""


@dataclass(frozen=True, eq=False)
class Unplaced:
    """A point, a line or a plane that keeps its place to something tracked, wherever that is.

    Attributes:
        kind: "point", "line" or "plane".
        name: what detections call it.
        frame: what it keeps its place to, such as "Needle"; "Tracker": the room.
        spanning_mm: (1, 3), (2, 3) or (3, 3): where it roughly is in that frame; None: nobody knows.
        sigma_mm, sigma_deg: how well that is known: standard deviations along axes across it, and of its direction.
        phantom: whose it is, of known shape: all targets of one keep their places to one another; None: of none.
        in_phantom_mm: (1, 3), (2, 3) or (3, 3): where it is in that phantom's frame.

    Raises:
        InputError: a name or a number means nothing.
    """

    kind: Kind
    name: str
    frame: str
    spanning_mm: Array | None = None
    sigma_mm: float = np.inf
    sigma_deg: float = np.inf
    phantom: Phantom | None = None
    in_phantom_mm: Array | None = None

    __repr__ = brief

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InputError(
                f"target {self.name!r}: its kind is {self.kind!r}; give one of {', '.join(KINDS)}"
            )
        if (self.phantom is None) != (self.in_phantom_mm is None):
            raise InputError(f"target {self.name!r}: phantom and in_phantom_mm go together")
        if self.phantom is not None and self.in_phantom_mm is not None:
            within = target_of(self.kind, self.name, self.phantom.frame, self.in_phantom_mm)
            object.__setattr__(self, "in_phantom_mm", frozen(np.array(within.spanning_mm)))
        if self.spanning_mm is None:  # names are checked as of those that are known
            Point(self.name, self.frame, np.zeros(3))
            return
        known = target_of(self.kind, self.name, self.frame, self.spanning_mm)
        object.__setattr__(self, "spanning_mm", frozen(np.array(known.spanning_mm)))
        for name in ("sigma_mm", "sigma_deg"):
            sigma = getattr(self, name)
            if not (isinstance(sigma, (int, float)) and not isinstance(sigma, bool) and 0 < sigma < np.inf):
                raise InputError(f"target {self.name!r}: {name} must be a positive number; got {sigma!r}")


def target_of(kind: Kind, name: str, frame: str, spanning_mm: Array) -> Target:
    """A target that is known, of the points that span it.

    Raises:
        InputError: they span none of its kind.
    """
    spanning = real_array(f"{kind} {name!r}: what spans it", spanning_mm)
    wanted = (KINDS.index(kind) + 1, 3)
    if spanning.shape != wanted:
        raise InputError(f"{kind} {name!r}: is spanned by {wanted[0]} x 3 numbers, mm; got {spanning.shape}")
    if kind == "point":
        return Point(name, frame, spanning[0])
    return Line(name, frame, spanning) if kind == "line" else Plane(name, frame, spanning)


def kind_of(target: Target | Unplaced) -> Kind:
    """Which kind a target is of."""
    return target.kind if isinstance(target, Unplaced) else KINDS[len(target.spanning_mm) - 1]


def of_phantom(phantom: Phantom, target: Target) -> Unplaced:
    """A target of a phantom whose place is unknown: it is where that is."""
    within = np.array(target.spanning_mm)
    return Unplaced(kind_of(target), target.name, phantom.fixed_to, phantom=phantom, in_phantom_mm=within)
