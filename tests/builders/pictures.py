"""Images in files of other programs' formats."""

import numpy as np
import pytest

from tests.builders.tables import N


def images(shape=(N, 16, 24)):
    return np.random.default_rng(0).integers(0, 255, shape, dtype=np.uint8)


def dicom_file(path, pixels, colour=False, syntax=None, private=(), **fields):
    """A DICOM file of these pixels, or of none; `private` are elements by their tags, with their types."""
    pydicom = pytest.importorskip("pydicom", reason="pydicom is not installed")
    dataset = pydicom.Dataset()
    dataset.file_meta = pydicom.dataset.FileMetaDataset()
    dataset.file_meta.TransferSyntaxUID = syntax or pydicom.uid.ExplicitVRLittleEndian
    dataset.file_meta.MediaStorageSOPClassUID = "1.2.840.10008.5.1.4.1.1.3.1"
    dataset.file_meta.MediaStorageSOPInstanceUID = dataset.SOPInstanceUID = "1.2.3"
    dataset.SOPClassUID = "1.2.840.10008.5.1.4.1.1.3.1"
    if pixels is not None:
        describe_pixels(dataset, pixels, colour)
    for name, value in (*fields.items(), *dict(private).items()):
        put(dataset, name, value)
    dataset.save_as(path, enforce_file_format=True)


def describe_pixels(dataset, pixels, colour):
    bits = 8 * pixels.dtype.itemsize
    dataset.Rows, dataset.Columns = pixels.shape[-2:] if not colour else pixels.shape[-3:-1]
    dataset.SamplesPerPixel, dataset.PhotometricInterpretation = (3, "RGB") if colour else (1, "MONOCHROME2")
    if colour:
        dataset.PlanarConfiguration = 0
    dataset.BitsAllocated = dataset.BitsStored = bits
    dataset.HighBit, dataset.PixelRepresentation = bits - 1, int(pixels.dtype.kind == "i")
    if pixels.ndim == 3 + colour:
        dataset.NumberOfFrames = len(pixels)
    dataset.PixelData = pixels.tobytes() + b"\0" * (pixels.nbytes % 2)


def put(dataset, name, value):
    """Set a value by its keyword, or by a tag with its type: ``{0x30011001: ("UL", 7)}``."""
    if isinstance(name, int):
        dataset.add_new(name, *value)
    else:
        setattr(dataset, name, value)


def items(*datasets):
    """A sequence of items, each given as keywords and values."""
    pydicom = pytest.importorskip("pydicom", reason="pydicom is not installed")
    made = [pydicom.Dataset() for _ in datasets]
    for one, values in zip(made, datasets, strict=True):
        for name, value in values.items():
            put(one, name, value)
    return pydicom.Sequence(made)


def palette(red, green, blue, first=0):
    """The fields of a palette whose colours are arrays of one length and type."""
    fields = {"PhotometricInterpretation": "PALETTE COLOR"}
    for name, values in {"Red": red, "Green": green, "Blue": blue}.items():
        fields[f"{name}PaletteColorLookupTableDescriptor"] = [
            len(values) % 65536,
            first,
            8 * values.dtype.itemsize,
        ]
        fields[f"{name}PaletteColorLookupTableData"] = values.tobytes()
    return fields


VOLUME_CLASS, PHILIPS_CLASS = "1.2.840.10008.5.1.4.1.1.6.2", "1.2.840.113543.6.6.1.3.10002"


def plane(place, time=None, axes=None, kind=None):
    """The functional groups of one plane of an Enhanced US Volume."""
    groups = {"PlanePositionVolumeSequence": items({"ImagePositionVolume": list(map(float, place))})}
    if time is not None:
        groups["TemporalPositionSequence"] = items({"TemporalPositionTimeOffset": float(time)})
    if axes is not None:
        groups["PlaneOrientationVolumeSequence"] = items({"ImageOrientationVolume": list(map(float, axes))})
    if kind is not None:
        groups["ImageDataTypeSequence"] = items({"DataType": kind})
    return groups


def volume_file(path, planes, pixels, measures=(("PixelSpacing", [0.4, 0.3]),), shared=(), **fields):
    """An Enhanced US Volume of these planes; `measures` and `shared` are what they have in common."""
    common = {"PixelMeasuresSequence": items(dict(measures)), **dict(shared)}
    dicom_file(
        path,
        pixels,
        SOPClassUID=VOLUME_CLASS,
        SharedFunctionalGroupsSequence=items(common),
        PerFrameFunctionalGroupsSequence=items(*planes),
        **fields,
    )
