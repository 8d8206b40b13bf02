"""PLUS toolkit: the calibration as the ``ImageToProbe`` transform of a device set, a new one or one that exists."""

from __future__ import annotations

from xml.etree import ElementTree

from sonocal.calibration import Calibration
from sonocal.existing import Existing
from sonocal.export.content import Content, content_of
from sonocal.targets.device_set_edit import put_transform, transform_values

__all__ = ["plus_xml", "put_into_device_set"]

COMMENT = (
    " {image}To{probe} maps pixels to millimetres in the probe marker's frame: its columns hold the mm per px. "
    "Pixels are (u right, v down) of the MF-oriented image, counted from the centre of the top left one. "
)
COPY = "Copy the Transform into the CoordinateDefinitions of your device set. "


def plus_xml(calibration: Calibration | Existing, image: str = "Image", probe: str = "Probe") -> bytes:
    """A PLUS configuration that holds the calibration alone.

    PLUS's ``From="Image" To="Probe"`` is ``probe_from_image``; numbers are written so that reading them
    gives the same to the last bit. ``Error`` is the root mean square distance in mm of the held-out rows
    from their lines, or of the fitted rows where none were held out; of a matrix of other software it is what that
    says, or -1.

    Args:
        calibration: what to write.
        image: what PLUS calls the image's frame.
        probe: what PLUS calls the frame of the probe's marker.
    """
    root = ElementTree.Element("PlusConfiguration", version="2.1")
    definitions = ElementTree.SubElement(root, "CoordinateDefinitions")
    written = content_of(calibration)
    comment = COMMENT.format(image=image, probe=probe) + COPY + written.remark + " "
    definitions.append(ElementTree.Comment(comment))
    ElementTree.SubElement(definitions, "Transform", {"From": image, "To": probe, **_values(written)})
    ElementTree.indent(root)
    return bytes(ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)) + b"\n"


def put_into_device_set(
    calibration: Calibration | Existing, content: bytes, name: str, image: str = "Image", probe: str = "Probe"
) -> bytes:
    """A device set that differs from the one given in the calibration's transform alone, every other byte kept.

    The transform's Matrix, Error and Date are replaced where it stands; where it does not, it is added to the
    CoordinateDefinitions, with a comment on what it maps and the verdict on it.

    Args:
        calibration: what to put in.
        content: the device set.
        name: what messages call it.
        image: what the device set calls the image's frame.
        probe: what the device set calls the frame of the probe's marker.

    Raises:
        FormatError: it is not XML in UTF-8, or declares a document type.
        InputError: it is another XML document, holds the transform twice, or connects the two frames otherwise.
    """
    written = content_of(calibration)
    comment = COMMENT.format(image=image, probe=probe) + written.remark + " "
    return put_transform(content, name, (image, probe), _values(written), comment)


def _values(written: Content) -> dict[str, str]:
    return transform_values(written.matrix, written.error_mm)
