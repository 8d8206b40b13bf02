"""3D Slicer: the calibration as a linear transform that loads the right way round.

Slicer's transform node "ImageToProbe" should hold, as its *transform to parent* in Slicer's RAS axes, the
matrix that PLUS calls ImageToProbe: pixels to mm. Slicer's files however hold the other direction (from
parent, which is what resampling needs) in the LPS axes of ITK:

    file = P inv(probe_from_image) P,      P = diag(-1, -1, 1, 1)

Source: Slicer's developer guide, "Transforms" (resampling convention, LPS in files).
"""

from __future__ import annotations

import numpy as np

from sonocal.calibration import Calibration
from sonocal.export.itk import affine_h5, affine_tfm
from sonocal.geometry import Array, AxisScaled
from sonocal.validation import give_verdict

__all__ = ["slicer_h5", "slicer_matrix", "slicer_tfm"]

LPS_FROM_RAS = np.diag([-1.0, -1.0, 1.0, 1.0])
CONVENTION = (
    "for 3D Slicer: loads as a linear transform whose transform to parent (RAS) is probe_from_image, pixels (u right, "
    "v down; origin: centre of the first pixel) to millimetres in the probe marker's frame, the mm per px "
    "inside; "
    "this file holds its inverse in LPS, as Slicer's files do"
)


def slicer_tfm(calibration: Calibration) -> bytes:
    """The content of a ``.tfm`` file for 3D Slicer."""
    matrix = slicer_matrix(calibration.probe_from_image)
    return affine_tfm(matrix, CONVENTION, give_verdict(calibration).remark)


def slicer_h5(calibration: Calibration) -> bytes:
    """The content of an ``.h5`` file for 3D Slicer.

    Raises:
        UnsupportedError: h5py is not installed.
    """
    matrix = slicer_matrix(calibration.probe_from_image)
    return affine_h5(matrix, CONVENTION, give_verdict(calibration).remark)


def slicer_matrix(probe_from_image: AxisScaled) -> Array:
    """(4, 4): what Slicer's file holds."""
    return np.asarray(LPS_FROM_RAS @ np.linalg.inv(probe_from_image.matrix) @ LPS_FROM_RAS)
