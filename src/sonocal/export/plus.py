"""PLUS toolkit: the calibration as the ``ImageToProbe`` transform of a device set."""

from __future__ import annotations

import datetime
from xml.etree import ElementTree

from sonocal.calibration import Calibration

__all__ = ["plus_xml"]

COMMENT = (
    " ImageToProbe maps pixels to millimetres in the probe marker's frame: its columns hold the mm per px. "
    "Pixels are (u right, v down) of the MF-oriented image, counted from the centre of the top left one. "
    "Copy the Transform into the CoordinateDefinitions of your device set. "
)


def plus_xml(calibration: Calibration) -> bytes:
    """A PLUS configuration that holds the calibration alone.

    PLUS's ``From="Image" To="Probe"`` is ``probe_from_image``; numbers are written so that reading them
    gives the same to the last bit. ``Error`` is the root mean square distance in mm of the held-out rows
    from their lines, or of the fitted rows where none were held out.
    """
    root = ElementTree.Element("PlusConfiguration", version="2.1")
    definitions = ElementTree.SubElement(root, "CoordinateDefinitions")
    definitions.append(ElementTree.Comment(COMMENT))
    ElementTree.SubElement(
        definitions,
        "Transform",
        From="Image",
        To="Probe",
        Matrix=matrix_text(calibration),
        Error=f"{(calibration.test or calibration.fit).rms_mm:.6g}",
        Date=datetime.datetime.now().astimezone().strftime("%m%d%y_%H%M%S"),
    )
    ElementTree.indent(root)
    return bytes(ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)) + b"\n"


def matrix_text(calibration: Calibration) -> str:
    """The matrix, row by row, as PLUS writes it."""
    return "  ".join(" ".join(repr(float(x)) for x in row) for row in calibration.probe_from_image.matrix)
