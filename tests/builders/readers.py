"""Every reader, with sound small files of what it reads: what the fuzzers start from."""

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import sonocal as sc
from sonocal.calibration import (
    load_calibration,
)
from sonocal.cli.formats import format_of
from sonocal.detection import read_detections
from sonocal.existing import matrices_in
from sonocal.export.plus import put_into_device_set
from sonocal.recording import health
from sonocal.recording.formats import (
    read_recording,
    write_recording,
)
from sonocal.targets import (
    read_device_set,
    read_lines,
    read_points_toml,
)
from sonocal.validation import read_point_sightings
from tests.builders.damaged import FILES
from tests.builders.recordings import random_recording
from tests.builders.sound import SOUND, rosbags, scenes, some_calibration, sound_paths


@dataclass(frozen=True)
class Reader:
    """One way into the package.

    Attributes:
        suffix: of its files.
        read: reads a file, whole.
        sound: makes the contents of sound files, given a folder to work in.
    """

    suffix: str
    read: Callable[[Path], object]
    sound: Callable[[Path], list[bytes]]


def whole(path):
    """A recording with its first frames decoded and looked at."""
    recording = read_recording(path)
    for frame in recording.frames[:4]:
        assert frame.shape == recording.frames.shape
    return health(recording)


def beside_its_pixels(path):
    """An .mhd, whose pixels lie in a.zraw."""
    if not (path.parent / "a.zraw").exists():
        write_recording(random_recording(0, n=3, size=(5, 4)), path.parent / "a.mhd")
    return whole(path)


def beside_its_sequences(path):
    """An .mrml, whose sequences lie beside it."""
    if not (path.parent / "Image.seq.nrrd").exists():
        scenes(path.parent)
    return whole(path)


def bag_folder(path):
    """The metadata.yaml of a bag of ROS 2 that is a folder."""
    folder = path.parent / "bag"
    if not folder.exists():
        rosbags("sqlite3")(path.parent)[0].rename(folder)
    (folder / "metadata.yaml").write_bytes(path.read_bytes())
    return whole(folder)


def any_file(path):
    """A file that says itself what it is."""
    return format_of(path).read(path)


def into_device_set(path):
    """A device set as one to put a calibration into."""
    assert put_into_device_set(some_calibration(), path.read_bytes(), path.name)


def damaged(*suffixes):
    return [content for name, content in FILES.items() if name.endswith(suffixes)]


def detached(folder):
    write_recording(random_recording(0, n=3, size=(5, 4)), folder / "a.mhd")
    return [(folder / "a.mhd").read_bytes(), *damaged(".mhd")]


def contents(name, *suffixes):
    """Makes the contents of the sound files of a format, those of some suffixes."""

    def make(folder):
        return [path.read_bytes() for path in SOUND[name](folder) if path.name.endswith(suffixes or ("",))]

    return make


def every_format(folder):
    return [path.read_bytes() for paths in sound_paths(folder).values() for path in paths if path.is_file()]


def bags(folder):
    """Bags that are one file."""
    return [path.read_bytes() for path in SOUND["ROS bag"](folder) if path.is_file()]


def bag_metadata(folder):
    return [(rosbags("sqlite3")(folder)[0] / "metadata.yaml").read_bytes()]


METAIO, NRRD = "PLUS sequence metafile, MetaIO image", "PLUS and Slicer NRRD sequence, NRRD image"
DEVICES, TARGETS = contents("PLUS device set"), contents("needles, wires, points, planes")

READERS = {
    "mha": Reader(".mha", whole, lambda folder: contents(METAIO, ".mha")(folder) + damaged(".mha")),
    "mhd": Reader(".mhd", beside_its_pixels, detached),
    "nrrd": Reader(".nrrd", whole, lambda folder: contents(NRRD)(folder) + damaged(".nrrd", ".nhdr")),
    "poses": Reader(".csv", whole, contents("CSV of poses")),
    "motive": Reader(".csv", whole, contents("OptiTrack Motive CSV")),
    "vicon": Reader(".csv", whole, contents("Vicon CSV")),
    "ndi": Reader(".csv", whole, contents("NDI log")),
    "trajectories": Reader(".txt", whole, contents("TUM trajectory")),
    "c3d": Reader(".c3d", whole, contents("C3D")),
    "dicom": Reader(".dcm", whole, contents("DICOM")),
    "kretz": Reader(".vol", whole, contents("GE Kretz volume")),
    "pictures": Reader(".png", whole, contents("image")),
    "video": Reader(".mp4", whole, contents("video", ".mp4")),
    "plus-video": Reader(".mkv", whole, contents("video", "plus.mkv")),
    "scene": Reader(".mrb", whole, contents("Slicer scene", ".mrb")),
    "scene-document": Reader(".mrml", beside_its_sequences, contents("Slicer scene", ".mrml")),
    "scan": Reader(".h5", whole, contents("TUS-REC scan")),
    "bag": Reader(".bag", whole, bags),
    "bag-folder": Reader(".yaml", bag_folder, bag_metadata),
    "device-set": Reader(".xml", read_device_set, lambda folder: DEVICES(folder) + damaged(".xml")),
    "into-device-set": Reader(".xml", into_device_set, lambda folder: DEVICES(folder) + damaged(".xml")),
    "lines": Reader(".toml", read_lines, TARGETS),
    "points": Reader(".toml", read_points_toml, TARGETS),
    "detections": Reader(".csv", read_detections, contents("points found in images")),
    "observations": Reader(".csv", sc.read_observations, contents("table of sightings")),
    "known-points": Reader(".csv", read_point_sightings, contents("points whose place is known")),
    "calibration": Reader(".json", load_calibration, contents("calibration")),
    "transforms": Reader(".tfm", matrices_in, contents("ITK and 3D Slicer transform, text")),
    "hdf5-transforms": Reader(".h5", matrices_in, contents("ITK and 3D Slicer transform, HDF5")),
    "matrices": Reader(".txt", matrices_in, contents("4 x 4 matrix as text")),
    "numpy": Reader(".npy", matrices_in, contents("4 x 4 matrix of NumPy")),
    "any": Reader("", any_file, every_format),
}


@lru_cache
def sound_files(name):
    """The contents of sound (and a few known damaged) files of one reader."""
    with tempfile.TemporaryDirectory() as folder:
        return tuple(READERS[name].sound(Path(folder)))
