"""3D Slicer: the calibration as a linear transform that loads the right way round.

Slicer's transform node "ImageToProbe" should hold, as its *transform to parent* in Slicer's RAS axes, the
matrix that PLUS calls ImageToProbe: pixels to mm. Slicer's files however hold the other direction (from
parent, which is what resampling needs) in the LPS axes of ITK:

    file = P inv(probe_from_image) P,      P = diag(-1, -1, 1, 1)

Source: Slicer's developer guide, "Transforms" (resampling convention, LPS in files).
"""

from __future__ import annotations

from sonocal.calibration import Calibration
from sonocal.existing import Existing
from sonocal.existing.matrix import slicer_form
from sonocal.export.content import content_of
from sonocal.export.itk import affine_h5, affine_tfm
from sonocal.geometry import Array, AxisScaled

__all__ = ["slicer_h5", "slicer_matrix", "slicer_tfm"]

CONVENTION = (
    "for 3D Slicer: loads as a linear transform whose transform to parent (RAS) is probe_from_image, pixels (u right, "
    "v down; origin: centre of the first pixel) to millimetres in the probe marker's frame, the mm per px "
    "inside; "
    "this file holds its inverse in LPS, as Slicer's files do"
)


def slicer_tfm(calibration: Calibration | Existing) -> bytes:
    """The content of a ``.tfm`` file for 3D Slicer."""
    content = content_of(calibration)
    return affine_tfm(slicer_form(content.matrix), CONVENTION, content.remark)


def slicer_h5(calibration: Calibration | Existing) -> bytes:
    """The content of an ``.h5`` file for 3D Slicer.

    Raises:
        UnsupportedError: h5py is not installed.
    """
    content = content_of(calibration)
    return affine_h5(slicer_form(content.matrix), CONVENTION, content.remark)


def slicer_matrix(probe_from_image: AxisScaled) -> Array:
    """(4, 4): what Slicer's file holds."""
    return slicer_form(probe_from_image.matrix)
