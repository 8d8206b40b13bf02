"""Every reader, with sound small files of what it reads: what the fuzzers start from."""

import io
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

import sonocal as sc
from sonocal.calibration import (
    calibration_json,
    load_calibration,
)
from sonocal.detection import read_detections
from sonocal.export.plus import put_into_device_set
from sonocal.files.kinds import kind_of
from sonocal.observations import observations_csv
from sonocal.recording import health
from sonocal.recording.formats import (
    read_recording,
    write_recording,
)
from sonocal.simulation.scene import simulate_observations
from sonocal.targets import (
    read_device_set,
    read_lines,
    read_points_toml,
)
from sonocal.validation import read_point_sightings
from tests.broken.make_files import FILES
from tests.builders.recordings import (
    random_poses,
    random_recording,
)
from tests.recording.formats.test_tables_and_images import (
    dicom_file,
    images,
    matrices_in,
    motive,
)
from tests.targets.test_device_set import PHANTOM
from tests.tools.test_tools import LINE

POINT = '[[point]]\nname = "tip"\nframe = "Stylus"\nat_mm = [0.0, 0.5, -150]\n'


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


def into_device_set(path):
    """A device set as one to put a calibration into."""
    assert put_into_device_set(some_calibration(), path.read_bytes(), path.name)


@lru_cache
def some_calibration():
    return sc.calibrate(simulate_observations(2, 12, seed=1).observations)


def sequences(suffix, **options):
    def make(folder):
        small = random_recording(0, n=3, size=(5, 4))
        kinds = {
            "zlib": (small, {}),
            "raw": (small, {"compress": False}),
            "tracker": (random_recording(0, n=3, size=None), {}),
            "volumes": (random_recording(0, n=2, size=(3, 2, 2), channels=3), {}),
            "shorts": (random_recording(0, n=2, size=(3, 2), dtype="int16", orientation="MN"), {}),
        }
        for name, (recording, how) in kinds.items():
            write_recording(recording, folder / f"{name}{suffix}", **how)
        return [(folder / f"{name}{suffix}").read_bytes() for name in kinds]

    return make


def damaged(*suffixes):
    return [content for name, content in FILES.items() if name.endswith(suffixes)]


def detached(folder):
    write_recording(random_recording(0, n=3, size=(5, 4)), folder / "a.mhd")
    return [(folder / "a.mhd").read_bytes(), *damaged(".mhd")]


def pose_tables(folder):
    matrices = random_poses(np.random.default_rng(0), 12)
    forms = ("cells", "matrix", "quaternion")
    for form in forms:
        matrices_in(form, folder / f"{form}.csv", matrices)
    return [(folder / f"{form}.csv").read_bytes() for form in forms]


def motive_tables(folder):
    motive(folder / "motive.csv", random_poses(np.random.default_rng(0), 12), blank=(2,))
    return [(folder / "motive.csv").read_bytes()]


def dicoms(folder):
    dicom_file(folder / "a.dcm", images((3, 4, 5)), FrameTime="50")
    return [(folder / "a.dcm").read_bytes()]


def pictures(folder):
    pillow = pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    made = []
    for form in ("png", "tiff", "bmp", "jpeg"):
        content = io.BytesIO()
        pillow.fromarray(images((1, 6, 8))[0]).save(content, format=form)
        made.append(content.getvalue())
    return made


def videos(folder):
    av = pytest.importorskip("av", reason="PyAV is not installed")
    content = io.BytesIO()
    with av.open(content, "w", format="mp4") as container:
        stream = container.add_stream("mpeg4", rate=10)
        stream.width, stream.height, stream.pix_fmt = 32, 16, "yuv420p"
        for i in range(3):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.full((16, 32, 3), 9 * i, np.uint8))))
        container.mux(stream.encode())
    return [content.getvalue()]


def sightings(folder):
    return [observations_csv(simulate_observations(d, 5, seed=1).observations) for d in (2, 3)]


READERS = {
    "mha": Reader(".mha", whole, lambda folder: sequences(".mha")(folder) + damaged(".mha")),
    "mhd": Reader(".mhd", beside_its_pixels, detached),
    "nrrd": Reader(".nrrd", whole, lambda folder: sequences(".nrrd")(folder) + damaged(".nrrd", ".nhdr")),
    "poses": Reader(".csv", whole, pose_tables),
    "motive": Reader(".csv", whole, motive_tables),
    "dicom": Reader(".dcm", whole, dicoms),
    "pictures": Reader(".png", whole, pictures),
    "video": Reader(".mp4", whole, videos),
    "device-set": Reader(".xml", read_device_set, lambda _: [PHANTOM.encode(), *damaged(".xml")]),
    "into-device-set": Reader(".xml", into_device_set, lambda _: [PHANTOM.encode(), *damaged(".xml")]),
    "lines": Reader(".toml", read_lines, lambda _: [LINE.encode()]),
    "points": Reader(".toml", read_points_toml, lambda _: [POINT.encode()]),
    "detections": Reader(
        ".csv", read_detections, lambda _: [b"frame,u_px,v_px,sigma_px\n0,10.5,20,0.5\n7,1,2,0.5\n"]
    ),
    "observations": Reader(".csv", sc.read_observations, sightings),
    "known-points": Reader(
        ".csv",
        read_point_sightings,
        lambda _: [b"u_px,v_px,x_mm,y_mm,z_mm,target\n1,2,3,4,5,a\n6,7,8,9,1,a\n"],
    ),
    "calibration": Reader(".json", load_calibration, lambda _: [calibration_json(some_calibration())]),
    "kind": Reader(
        "", kind_of, lambda _: [b"{}", b"<a/>", b"frame,x0_mm\n1,2\n", b"t,Probe_qw\n", b"[[line]]\n"]
    ),
}


@lru_cache
def sound_files(name):
    """The contents of sound (and a few known damaged) files of one reader."""
    with tempfile.TemporaryDirectory() as folder:
        return tuple(READERS[name].sound(Path(folder)))
