"""ITK: the calibration as an affine transform file, text (``.tfm``) or HDF5 (``.h5``).

ITK's transform maps points exactly as ours: ``TransformPoint(u, v, w)`` in px gives mm in the probe marker's
frame. No axis is mirrored and nothing is inverted; the form that 3D Slicer expects is in `slicer`.
"""

from __future__ import annotations

import io

import numpy as np

from sonocal.calibration import Calibration
from sonocal.errors import UnsupportedError
from sonocal.existing import Existing
from sonocal.export.content import content_of
from sonocal.geometry import Array

__all__ = ["affine_h5", "affine_tfm", "itk_h5", "itk_tfm"]

TYPE = "AffineTransform_double_3_3"
CONVENTION = (
    "probe_from_image: maps pixels (u right, v down, w out of plane; origin: centre of the first pixel) "
    "to millimetres in the probe marker's frame; the mm per px are inside the matrix"
)


def itk_tfm(calibration: Calibration | Existing) -> bytes:
    """The content of a ``.tfm`` file that maps pixels to mm as the calibration does."""
    content = content_of(calibration)
    return affine_tfm(content.matrix, CONVENTION, content.remark)


def itk_h5(calibration: Calibration | Existing) -> bytes:
    """The content of an ``.h5`` file that maps pixels to mm as the calibration does.

    Raises:
        UnsupportedError: h5py is not installed.
    """
    content = content_of(calibration)
    return affine_h5(content.matrix, CONVENTION, content.remark)


def affine_tfm(matrix: Array, convention: str, verdict: str) -> bytes:
    """An ITK text transform of a 4 x 4 matrix; numbers read back to the last bit."""
    lines = [
        "#Insight Transform File V1.0",
        f"# {convention}",
        f"# {verdict}",
        "#Transform 0",
        f"Transform: {TYPE}",
        "Parameters: " + " ".join(repr(float(x)) for x in _parameters(matrix)),
        "FixedParameters: 0 0 0",
    ]
    return "\n".join(lines).encode() + b"\n"


def affine_h5(matrix: Array, convention: str, verdict: str) -> bytes:
    """An ITK HDF5 transform of a 4 x 4 matrix.

    Raises:
        UnsupportedError: h5py is not installed.
    """
    try:
        import h5py
    except ImportError:
        raise UnsupportedError("ITK's .h5 needs h5py; pip install h5py, or export .tfm") from None
    content = io.BytesIO()
    with h5py.File(content, "w") as file:
        # ITK looks for these names; what they say is free.
        names = {"ITKVersion": "5.0", "HDFVersion": "1.10", "OSName": "any", "OSVersion": "any"}
        for name, text in (names | {"TransformGroup/0/TransformType": TYPE}).items():
            # ITK reads ASCII only, which is not what h5py writes by itself.
            file.create_dataset(name, data=[text.encode()], dtype=h5py.string_dtype("ascii"))
        group = file["TransformGroup/0"]
        group["TransformParameters"] = _parameters(matrix)
        group["TransformFixedParameters"] = np.zeros(3)
        file.attrs["convention"] = convention
        file.attrs["verdict"] = verdict
    return content.getvalue()


def _parameters(matrix: Array) -> Array:
    """(12,): the rotation and scale row by row, then the translation."""
    return np.concatenate([matrix[:3, :3].ravel(), matrix[:3, 3]])
