"""Whatever is in a file, its reader gives a recording or a SonocalError, in bounded memory.

Sound small files of every format are damaged in the ways files get damaged (and attacked): bytes changed,
parts cut, repeated or exchanged, numbers replaced by extreme ones. Python cannot count the time and memory of
a single example portably, so the tests bound what a reader may allocate: no more than a little beside its file.
"""

import io
import re
import tracemalloc

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sonocal import SonocalError
from sonocal.recording import health, read_device_set, read_lines, read_recording, write_recording
from sonocal.sightings import read_detections
from tests.broken.make_files import FILES
from tests.recording.makers import random_poses, random_recording
from tests.recording.test_device_set import PHANTOM
from tests.recording.test_tables_and_images import dicom_file, images, matrices_in, motive
from tests.recording.test_tools import LINE

MEMORY_LIMIT = 64 << 20
NUMBERS = [
    b"0",
    b"-1",
    b"1e999",
    b"nan",
    b"99999999999999999999",
    b"4294967295",
    b"2147483648",
    b"0.5",
    b"1000000",
    b"\xff",
]


def whole(path):
    recording = read_recording(path)
    for frame in recording.frames[:4]:
        assert frame.shape == recording.frames.shape
    return health(recording)


def sound_files(folder):
    """One small sound file of every format, and its reader."""
    recording = random_recording(0, n=3, size=(5, 4))
    for name, kwargs in {
        "a.mha": {},
        "b.mha": {"compress": False},
        "c.nrrd": {},
        "d.nrrd": {"compress": False},
    }.items():
        write_recording(recording, folder / name, **kwargs)
    write_recording(random_recording(0, n=3, size=None), folder / "e.mha")
    write_recording(random_recording(0, n=2, size=(3, 2, 2), channels=3), folder / "f.mha")
    write_recording(recording, folder / "g.mhd")
    matrices = random_poses(np.random.default_rng(0), 12)
    for form in ("cells", "matrix", "quaternion"):
        matrices_in(form, folder / f"{form}.csv", matrices)
    motive(folder / "motive.csv", matrices, blank=(2,))
    (folder / "devices.xml").write_text(PHANTOM)
    (folder / "lines.toml").write_text(LINE)
    (folder / "points.csv").write_text("frame,u_px,v_px,sigma_px\n0,10.5,20,0.5\n7,1,2,0.5\n")
    return {
        p.name: {"devices.xml": read_device_set, "lines.toml": read_lines, "points.csv": read_detections}.get(
            p.name, whole
        )
        for p in folder.iterdir()
        if p.suffix != ".zraw"
    }


NAMES = [
    "a.mha",
    "b.mha",
    "c.nrrd",
    "d.nrrd",
    "e.mha",
    "f.mha",
    "g.mhd",
    "cells.csv",
    "matrix.csv",
    "quaternion.csv",
    "motive.csv",
    "devices.xml",
    "lines.toml",
    "points.csv",
]


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sound")
    readers = sound_files(folder)
    assert set(readers) == set(NAMES)
    return {name: ((folder / name).read_bytes(), reader) for name, reader in readers.items()}


@st.composite
def damage(draw):
    """A function that damages bytes, a few times."""
    steps = draw(
        st.lists(
            st.tuples(st.sampled_from(KINDS), st.integers(0, 10**6), st.integers(0, 10**6)),
            min_size=1,
            max_size=4,
        )
    )

    def apply(data):
        for kind, a, b in steps:
            data = kind(data, a, b) if data else data
        return data

    return apply


def flip(data, a, b):
    i = a % len(data)
    return data[:i] + bytes([data[i] ^ (1 + b % 255)]) + data[i + 1 :]


def cut(data, a, b):
    return data[: a % len(data)]


def drop(data, a, b):
    i = a % len(data)
    return data[:i] + data[i + 1 + b % 40 :]


def repeat_line(data, a, b):
    lines = data.splitlines(keepends=True)
    i, j = a % len(lines), b % len(lines)
    return b"".join([*lines[:i], lines[j], *lines[i:]])


def drop_line(data, a, b):
    lines = data.splitlines(keepends=True)
    return b"".join(line for i, line in enumerate(lines) if i != a % len(lines))


def extreme_number(data, a, b):
    places = [m.span() for m in re.finditer(rb"-?\d+(?:\.\d+)?", data[:4000])]
    if not places:
        return data
    start, end = places[a % len(places)]
    return data[:start] + NUMBERS[b % len(NUMBERS)] + data[end:]


def empty_value(data, a, b):
    places = [m.span(1) for m in re.finditer(rb"[=:,](.*)$", data[:4000], flags=re.M)]
    if not places:
        return data
    start, end = places[a % len(places)]
    return data[:start] + data[end:]


KINDS = [flip, cut, drop, repeat_line, drop_line, extreme_number, extreme_number, empty_value]


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(change=damage())
def test_damaged_files_end_in_a_sentence(sound, tmp_path, name, change):
    data, reader = sound[name]
    path = tmp_path / name
    path.write_bytes(change(data))
    if name == "g.mhd":
        write_recording(random_recording(0, n=3, size=(5, 4)), tmp_path / "g.mhd")
        path.write_bytes(change(data))
    bounded(reader, path)


@pytest.mark.parametrize("name", [n for n in FILES if not n.endswith((".xml", ".raw"))])
def test_broken_files_cost_nothing(tmp_path, name):
    (tmp_path / name).write_bytes(FILES[name])
    bounded(whole, tmp_path / name)


@settings(max_examples=100)
@given(
    st.binary(max_size=300),
    st.sampled_from([".mha", ".nrrd", ".csv", ".mp4", ".dcm", ".txt", ".xml", ".toml"]),
    st.sampled_from(
        [
            b"",
            b"NRRD0005\n",
            b"ObjectType = Image\n",
            b"\0" * 128 + b"DICM",
            b"Format Version,1.2\n",
            b"\0\0\0 ftyp",
        ]
    ),
)
def test_any_bytes_end_in_a_sentence(tmp_path_factory, data, suffix, start):
    path = tmp_path_factory.mktemp("any") / f"a{suffix}"
    path.write_bytes(start + data)
    reader = {".xml": read_device_set, ".toml": read_lines}.get(suffix, whole)
    bounded(reader, path)


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(change=damage())
def test_damaged_dicom_ends_in_a_sentence(tmp_path, change):
    path = tmp_path / "a.dcm"
    dicom_file(path, images((3, 4, 5)), FrameTime="50")
    path.write_bytes(change(path.read_bytes()))
    bounded(whole, path)


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(change=damage())
def test_damaged_png_ends_in_a_sentence(tmp_path, change):
    pillow = pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    pillow.fromarray(images()[0]).save(tmp_path / "a.png")
    (tmp_path / "a.png").write_bytes(change((tmp_path / "a.png").read_bytes()))
    bounded(whole, tmp_path)


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(change=damage())
def test_damaged_video_ends_in_a_sentence(tmp_path, change):
    av = pytest.importorskip("av", reason="PyAV is not installed")
    content = io.BytesIO()
    with av.open(content, "w", format="mp4") as container:
        stream = container.add_stream("mpeg4", rate=10)
        stream.width, stream.height, stream.pix_fmt = 32, 16, "yuv420p"
        for i in range(3):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.full((16, 32, 3), 9 * i, np.uint8))))
        container.mux(stream.encode())
    path = tmp_path / "a.mp4"
    path.write_bytes(change(content.getvalue()))
    bounded(whole, path)


def bounded(reader, path):
    tracemalloc.start()
    try:
        reader(path)
    except SonocalError as error:
        sentence = str(error)
        assert "\n" not in sentence
        assert sentence
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert peak < MEMORY_LIMIT
