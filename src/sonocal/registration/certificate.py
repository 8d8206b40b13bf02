"""Whether an answer is the best of all, and not only of its neighbourhood."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, cast

import numpy as np
from numpy.typing import NDArray

from sonocal import _core
from sonocal.geometry import Similarity
from sonocal.registration.constraints import Rows
from sonocal.registration.fit import Fit
from sonocal.registration.lazy import Lazy
from sonocal.registration.options import Options
from sonocal.registration.rows import PointLineRows, to_core
from sonocal.registration.spanned import SpannedRows
from sonocal.registration.target_rows import TargetRows
from sonocal.registration.told import Told

__all__ = ["Certificate", "LazyCertificate", "certificate_of", "certificate_of_mix", "certificate_of_spanned"]

Certificate = Literal["optimal", "tied", "not shown"]
"""Every other answer costs more; none costs less, but another may cost the same; another may cost less."""


class LazyCertificate(Lazy[Certificate]):
    """A certificate that is looked for when it is first read."""

    @classmethod
    def known(cls, found: Certificate = "not shown") -> LazyCertificate:
        """One that was looked for before, as in a file."""
        return cls(lambda: found)

    def __reduce__(self) -> tuple[Callable[[Certificate], LazyCertificate], tuple[Certificate]]:
        return LazyCertificate.known, (self.read(),)


def certificate_of(table: PointLineRows | TargetRows, fit: Fit) -> Certificate:
    """Whether a fit is the best of all for the rows that it took, with their weights as they came out.

    Weights that are fixed make the cost quadratic in the columns of the transform, and what makes these a
    similarity's is quadratic: a convex relaxation of both proves the answer where multipliers are found for it.

    Args:
        table: points and lines, or whatever targets.
        fit: their fit.

    Source: Briales and Gonzalez-Jimenez, CVPR 2017, with the scale among the unknowns.
    """
    levelled = fit.levelled
    if fit.weighting == "likelihood" and not (levelled.sigma_px or levelled.sigma_mm):
        return "not shown"
    at = to_core(fit.transform)
    if isinstance(table, TargetRows):
        return _certificate_of_targets(table, fit, at)
    return cast(Certificate, _core.certificate(table.core, fit.inlier, at, table.core_options(levelled)))


def _certificate_of_targets(table: TargetRows, fit: Fit, at: _core.Transform) -> Certificate:
    marks = table.marks(fit.inlier)
    if fit.weighting == "likelihood":
        levels = fit.options.to_core(fit.sigma_px, fit.sigma_mm)
        return cast(Certificate, _core.certificate(table.core, marks, at, levels))
    rows, options = table.constraints.core, fit.options.to_core(0, 0)
    return cast(Certificate, _core.certificate(rows, marks, at, options))


def certificate_of_mix(
    rows: Rows, inlier: NDArray[np.bool_], similarity: Similarity, options: Options, told: Told
) -> Certificate:
    """Whether a similarity has the least sum of squares of all, over the correspondences that agree.

    Args:
        rows: correspondences of any kind.
        inlier: (C,), those that agree.
        similarity: their least squares.
        options: with the scale where it is known.
        told: weights.
    """
    chosen, at = np.ascontiguousarray(inlier), to_core(similarity)
    found = _core.certificate(rows.core, chosen, at, options.to_core(0, 0), weights=told.weights)
    return cast(Certificate, found)


def certificate_of_spanned(
    rows: SpannedRows,
    inlier: NDArray[np.bool_],
    similarity: Similarity,
    levels: _core.Options,
) -> Certificate:
    """Whether a similarity is the best of all for the sightings that agree, weighed as the levels have it there.

    Args:
        rows: points, lines and planes by what spans them.
        inlier: (C,), those that agree.
        similarity: the maximum of their likelihood.
        levels: options with the noise levels, and the scale where it is known.
    """
    chosen, at = np.ascontiguousarray(inlier), to_core(similarity)
    return cast(Certificate, _core.certificate(rows.core, chosen, at, levels))
