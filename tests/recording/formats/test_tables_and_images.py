"""Poses in tables, images in videos, folders and DICOM, and both joined by time."""

import csv
import struct
import tracemalloc
import zlib

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sonocal import FormatError, InputError, UnsupportedError
from sonocal.files.png import png
from sonocal.recording.formats import (
    read_recording,
    write_recording,
)
from tests.builders.recordings import (
    random_poses,
    random_recording,
)

N = 12
TIMES = np.arange(N) * 0.1


def quaternions_xyzw(matrices):
    return Rotation.from_matrix(matrices[:, :3, :3]).as_quat()


def write_table(path, header, rows):
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(header)
        writer.writerows(rows)


def matrices_in(form, path, matrices, blank=()):
    """One recording in each form a tracker may export."""
    q, p = quaternions_xyzw(matrices), matrices[:, :3, 3]
    if form == "cells":
        header = ["Timestamp", "NeedleToTrackerTransform", "NeedleToTrackerTransformStatus"]
        rows = [
            [t, " ".join(map(repr, m.ravel().tolist())), "OK"] for t, m in zip(TIMES, matrices, strict=True)
        ]
    elif form == "matrix":
        header = ["time_s", *(f"Needle_m{i}{j}" for i in range(4) for j in range(4))]
        rows = [[t, *m.ravel().tolist()] for t, m in zip(TIMES, matrices, strict=True)]
    else:
        unit, scale = ("_m", 1e-3) if form == "metres" else ("_mm", 1.0)
        header = [
            "time_s",
            *(f"Needle_{k}" for k in ("qx", "qy", "qz", "qw")),
            *(f"Needle_{a}{unit}" for a in "xyz"),
        ]
        rows = [[t, *a.tolist(), *(scale * b).tolist()] for t, a, b in zip(TIMES, q, p, strict=True)]
    for row in blank:
        rows[row][1:] = [""] * (len(header) - 1)
    write_table(path, header, rows)


def motive(path, matrices, unit="Meters", blank=(), kind="Quaternion"):
    scale = 1e-3 if unit == "Meters" else 1.0
    rows = [
        ["Format Version", "1.23", "Take Name", "Take 1", "Rotation Type", kind, "Length Units", unit],
        [],
        ["", "Type", *["Rigid Body"] * 8, *["Rigid Body Marker"] * 3],
        ["", "Name", *["Needle"] * 8, *["Needle:Marker1"] * 3],
        ["", "ID", *["8A"] * 8, *["8B"] * 3],
        ["", "", *["Rotation"] * 4, *["Position"] * 3, "Mean Marker Error", *["Position"] * 3],
        ["Frame", "Time (Seconds)", *"XYZW", *"XYZ", "", *"XYZ"],
    ]
    for i, (q, p) in enumerate(zip(quaternions_xyzw(matrices), scale * matrices[:, :3, 3], strict=True)):
        cells = [""] * 11 if i in blank else [*q.tolist(), *p.tolist(), 0.1, 1, 2, 3]
        rows.append([i, TIMES[i], *cells])
    with path.open("w", newline="") as file:
        csv.writer(file).writerows(rows)


@pytest.mark.parametrize("form", ["cells", "matrix", "quaternion", "metres", "motive m", "motive mm"])
def test_every_form_gives_the_same_poses(tmp_path, form):
    matrices = random_poses(np.random.default_rng(0), N)
    path = tmp_path / "poses.csv"
    if form.startswith("motive"):
        motive(path, matrices, "Meters" if form.endswith(" m") else "Millimeters", blank=(3, 4))
    else:
        matrices_in(form, path, matrices, blank=(3, 4))
    recording = read_recording(path)
    needle = recording.poses["tracker_from_needle"]
    seen = ~np.isin(np.arange(N), (3, 4))
    np.testing.assert_array_equal(needle.valid, seen)
    np.testing.assert_allclose(needle.matrices[seen], matrices[seen], atol=1e-9)
    np.testing.assert_array_equal(recording.times, TIMES)
    assert len(recording.frames) == 0


def test_quaternion_columns_in_another_order_are_read_by_name(tmp_path):
    write_table(tmp_path / "a.csv", ["t", "qw", "qx", "qy", "qz", "x", "y", "z"], [[0, 0, 1, 0, 0, 1, 2, 3]])
    (tool,) = read_recording(tmp_path / "a.csv").poses.values()
    np.testing.assert_array_equal(
        tool.matrices[0], [[1, 0, 0, 1], [0, -1, 0, 2], [0, 0, -1, 3], [0, 0, 0, 1]]
    )


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (
            "a,b\n1,2\n",
            "a.csv: has no columns of poses; name them ProbeToTrackerTransform, Probe_m00 to Probe_m33, or "
            "Probe_qw, Probe_qx, Probe_qy, Probe_qz, Probe_x, Probe_y, Probe_z",
        ),
        (
            "t,qw,qx,qy,qz,x,y,z\n0,1,0,0,zero,1,2,3\n",
            "a.csv, line 2, column qz: 'zero' is not a number; write a decimal number such as 12.5",
        ),
        ("t,qw,qx,qy,qz,x,y\n0,1,0,0,0,1,2\n", "a.csv, line 1: lacks the column z beside x"),
        (
            "t,qw,qx,qy,qz,x,y,z\n0,1,0,0,1,1,2,3\n",
            "a.csv, row 0: the quaternion of Tool has length 1.41 where 1 is due; check the order of its columns",
        ),
        (
            "t,ProbeToTrackerTransform\n0,1 2 3\n",
            "a.csv, line 2, column ProbeToTrackerTransform: '1 2 3' is not 16 numbers",
        ),
        ("t,qw\n0\n", "a.csv, line 2: has 1 cells where the header has 2; quote cells that hold a comma"),
        ("t,qw\n", "a.csv: has a header but no rows; write one row an instant"),
        ("nan,qw\n0,1\n", "a.csv, line 1: lacks the column qx beside qw"),
    ],
)
def test_bad_tables_are_refused(tmp_path, text, sentence):
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(InputError) as caught:
        read_recording(tmp_path / "a.csv")
    assert str(caught.value) == sentence


def test_motive_with_euler_angles_is_refused(tmp_path):
    motive(tmp_path / "a.csv", random_poses(np.random.default_rng(0), N), kind="XYZ")
    with pytest.raises(UnsupportedError) as caught:
        read_recording(tmp_path / "a.csv")
    assert str(caught.value) == "a.csv: its rotations are 'XYZ'; export them from Motive as Quaternion"


def images(shape=(N, 16, 24)):
    return np.random.default_rng(0).integers(0, 255, shape, dtype=np.uint8)


def moving(step_mm=1.0):
    matrices = np.tile(np.eye(4), (N, 1, 1))
    matrices[:, 0, 3] = step_mm * np.arange(N)
    return matrices


@pytest.mark.parametrize("stamps", ["table", "names"])
def test_a_folder_of_png_is_joined_with_its_poses(tmp_path, stamps):
    pillow = pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    pixels = images()
    times = TIMES[:10] + 0.05
    names = [f"frame_{i}.png" if stamps == "table" else f"frame_{times[i]:.3f}.png" for i in range(10)]
    for name, frame in zip(names, pixels, strict=False):
        pillow.fromarray(frame).save(tmp_path / name)
    if stamps == "table":
        write_table(tmp_path / "frames.csv", ["file", "time_s"], zip(names, times.tolist(), strict=True))
    matrices_in("quaternion", tmp_path / "tracker.csv", moving())
    recording = read_recording(tmp_path)
    np.testing.assert_array_equal(np.stack(list(recording.frames)), pixels[:10])
    np.testing.assert_allclose(recording.times, times)
    np.testing.assert_allclose(recording.poses["tracker_from_needle"].matrices[:, 0, 3], np.arange(10) + 0.5)
    assert recording.image.size_px == (24, 16)


@pytest.mark.parametrize("mode", ["L", "RGB", "I;16"])
def test_png_pixels_are_kept(tmp_path, mode):
    pillow = pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    pixels = images((2, 5, 4, 3)) if mode == "RGB" else images((2, 5, 4))
    pixels = pixels.astype(np.uint16) * 257 if mode == "I;16" else pixels
    for i, frame in enumerate(pixels):
        pillow.fromarray(frame).save(tmp_path / f"{i}.png")
    np.testing.assert_array_equal(np.stack(list(read_recording(tmp_path).frames)), pixels)


def test_folders_that_do_not_fit_are_refused(tmp_path):
    pillow = pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    with pytest.raises(InputError, match="holds no image files"):
        read_recording(tmp_path)
    pillow.fromarray(images()[0]).save(tmp_path / "0.png")
    pillow.fromarray(images()[0, :4]).save(tmp_path / "1.png")
    with pytest.raises(FormatError, match=r"1.png: is \(4, 24\) L where the first image is \(16, 24\) uint8"):
        list(read_recording(tmp_path).frames)
    (tmp_path / "frames.csv").write_text("file,time_s\n0.png,0.5\n")
    with pytest.raises(InputError, match=r"has no time for 1\.png; add a row, or delete the image"):
        read_recording(tmp_path)


def test_a_video_is_joined_with_the_table_beside_it(tmp_path):
    av = pytest.importorskip("av", reason="PyAV is not installed")
    # Grey steps survive the codec; pixels need not.
    levels = 20 * np.arange(N, dtype=np.uint8)
    with av.open(str(tmp_path / "sweep.mp4"), "w") as container:
        stream = container.add_stream("mpeg4", rate=10)
        stream.width, stream.height, stream.pix_fmt, stream.bit_rate = 64, 48, "yuv420p", 4_000_000
        for level in levels:
            frame = av.VideoFrame.from_ndarray(np.full((48, 64, 3), level, np.uint8), format="rgb24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    matrices_in("quaternion", tmp_path / "sweep.csv", moving())
    recording = read_recording(tmp_path / "sweep.mp4")
    assert (len(recording), recording.frames.shape) == (N, (48, 64, 3))
    np.testing.assert_allclose(recording.times, TIMES, atol=1e-6)
    np.testing.assert_allclose([frame.mean() for frame in recording.frames], levels, atol=3)
    for index in (7, 8, 2, 11):
        assert abs(recording.frames[index].mean() - levels[index]) < 3
    valid = recording.poses["tracker_from_needle"].valid
    np.testing.assert_allclose(
        recording.poses["tracker_from_needle"].matrices[valid, 0, 3], np.arange(N)[valid], atol=1e-3
    )


def dicom_file(path, pixels, **fields):
    pydicom = pytest.importorskip("pydicom", reason="pydicom is not installed")
    dataset = pydicom.Dataset()
    dataset.file_meta = pydicom.dataset.FileMetaDataset()
    dataset.file_meta.TransferSyntaxUID = pydicom.uid.ExplicitVRLittleEndian
    dataset.file_meta.MediaStorageSOPClassUID = "1.2.840.10008.5.1.4.1.1.3.1"
    dataset.file_meta.MediaStorageSOPInstanceUID = dataset.SOPInstanceUID = "1.2.3"
    dataset.SOPClassUID = "1.2.840.10008.5.1.4.1.1.3.1"
    dataset.Rows, dataset.Columns = pixels.shape[-2:]
    dataset.SamplesPerPixel, dataset.PhotometricInterpretation = 1, "MONOCHROME2"
    dataset.BitsAllocated = dataset.BitsStored = 8
    dataset.HighBit, dataset.PixelRepresentation = 7, 0
    if pixels.ndim == 3:
        dataset.NumberOfFrames = len(pixels)
    for name, value in fields.items():
        setattr(dataset, name, value)
    dataset.PixelData = pixels.tobytes()
    dataset.save_as(path, enforce_file_format=True)


def test_multi_frame_dicom(tmp_path):
    pydicom = pytest.importorskip("pydicom", reason="pydicom is not installed")
    region = pydicom.Dataset()
    region.PhysicalUnitsXDirection = region.PhysicalUnitsYDirection = 3
    region.PhysicalDeltaX, region.PhysicalDeltaY = 0.02, 0.03
    pixels = images()
    dicom_file(
        tmp_path / "a.dcm",
        pixels,
        FrameTime="50",
        ContentTime="010203.5",
        SequenceOfUltrasoundRegions=[region],
    )
    recording = read_recording(tmp_path / "a.dcm")
    np.testing.assert_array_equal(np.stack(list(recording.frames)), pixels)
    np.testing.assert_allclose(recording.times, 3723.5 + 0.05 * np.arange(N))
    assert recording.image.spacing_mm == pytest.approx((0.2, 0.3))


def test_dicom_files_are_ordered_by_their_time(tmp_path):
    pixels = images()
    for i in range(4):
        dicom_file(tmp_path / f"{3 - i}.dcm", pixels[i], AcquisitionTime=f"00000{i}.25")
    recording = read_recording(tmp_path)
    np.testing.assert_array_equal(np.stack(list(recording.frames)), pixels[:4])
    np.testing.assert_allclose(recording.times, np.arange(4) + 0.25)


def test_files_of_other_kinds_are_refused(tmp_path):
    (tmp_path / "a.xml").write_text("<PlusConfiguration/>")
    (tmp_path / "a.bin").write_bytes(b"\x00\x01\x02")
    (tmp_path / "a.mha").write_bytes(b"")
    with pytest.raises(
        UnsupportedError, match="is XML, not a recording; a PLUS device set is given with --lines"
    ):
        read_recording(tmp_path / "a.xml")
    with pytest.raises(UnsupportedError, match="is not a recording that sonocal reads"):
        read_recording(tmp_path / "a.bin")
    with pytest.raises(InputError, match="is empty; record it again"):
        read_recording(tmp_path / "a.mha")
    with pytest.raises(InputError, match="there is no such file; check the name and the folder"):
        read_recording(tmp_path / "missing.mha")


def test_poses_from_another_file_and_another_clock(tmp_path):
    """The tracker's clock is 100 s ahead: a latency like any other."""
    write_recording(random_recording(0, n=5, tools=()), tmp_path / "images.mha")
    images_times = read_recording(tmp_path / "images.mha").times
    stamps = images_times[0] + 100 + np.arange(0, images_times[-1] - images_times[0] + 1, 0.1)
    rows = [[t, 1, 0, 0, 0, t, 0, 0] for t in stamps.tolist()]
    write_table(
        tmp_path / "tracker.csv",
        ["time_s", *(f"Probe_{k}" for k in ("qw", "qx", "qy", "qz", "x", "y", "z"))],
        rows,
    )
    recording = read_recording(tmp_path / "images.mha", poses=tmp_path / "tracker.csv", latency_s=100.0)
    probe = recording.poses["tracker_from_probe"]
    assert probe.valid.all()
    np.testing.assert_allclose(probe.matrices[:, 0, 3], images_times + 100)
    with pytest.raises(InputError, match="they do not overlap; bring both to one clock"):
        read_recording(tmp_path / "images.mha", poses=tmp_path / "tracker.csv")


def test_images_without_times_are_not_joined(tmp_path):
    pillow = pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    pillow.fromarray(images()[0]).save(tmp_path / "0.png")
    matrices_in("quaternion", tmp_path / "tracker.csv", moving())
    with pytest.raises(
        InputError, match="its items have no times, so poses cannot be joined to images; add stamps"
    ):
        read_recording(tmp_path)


@pytest.mark.parametrize(
    ("size", "kind", "sentence"),
    [
        (
            (8000, 8000),
            UnsupportedError,
            "a.png: one frame of 8000x8000x3 uint8 takes 192000000 bytes, more than",
        ),
        (
            (60000, 60000),
            FormatError,
            "a.png: is not an image that can be read (Image size (3600000000 pixels)",
        ),
    ],
)
def test_a_picture_that_claims_to_be_huge_is_refused_before_it_is_decoded(tmp_path, size, kind, sentence):
    pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    small = png(np.zeros((2, 3, 3), dtype=np.uint8))
    header = struct.pack(">4sIIBBBBB", b"IHDR", *size, 8, 2, 0, 0, 0)
    claims = small[:12] + header + struct.pack(">I", zlib.crc32(header)) + small[33:]
    (tmp_path / "a.png").write_bytes(claims)
    tracemalloc.start()
    with pytest.raises(kind) as caught:
        read_recording(tmp_path / "a.png")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert str(caught.value).startswith(sentence)
    assert peak < 10_000_000


def test_a_single_picture_is_a_recording_of_one_frame(tmp_path):
    pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    pixels = images((1, 6, 8))[0]
    (tmp_path / "a.png").write_bytes(png(pixels))
    recording = read_recording(tmp_path / "a.png")
    assert (len(recording), recording.image.size_px, recording.provenance.format) == (1, (8, 6), "image")
    np.testing.assert_array_equal(recording.frames[0], pixels)
