"""Folders of images."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sonocal import FormatError, InputError
from sonocal.files.png import png
from sonocal.recording.formats import read_recording
from tests.builders.pictures import images
from tests.builders.tables import TIMES, matrices_in, moving, write_table


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


def test_images_without_times_are_not_joined(tmp_path):
    pillow = pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    pillow.fromarray(images()[0]).save(tmp_path / "0.png")
    matrices_in("quaternion", tmp_path / "tracker.csv", moving())
    with pytest.raises(
        InputError, match="its items have no times, so poses cannot be joined to images; add stamps"
    ):
        read_recording(tmp_path)


@settings(max_examples=20)
@given(
    order=st.permutations(range(6)), seed=st.integers(0, 2**32), stamps=st.sampled_from(["table", "names"])
)
def test_frames_follow_their_stamps_whatever_their_names(tmp_path_factory, order, seed, stamps):
    """The names' order is any, times differ; the recording is in the order of time."""
    folder = tmp_path_factory.mktemp("images")
    pixels = images((6, 3, 4))
    times = np.cumsum(np.random.default_rng(seed).integers(1, 500, 6)) / 1000
    names = [f"{order[i]}{'' if stamps == 'table' else f'_{times[i]:.3f}'}.png" for i in range(6)]
    for name, frame in zip(names, pixels, strict=True):
        (folder / name).write_bytes(png(frame))
    if stamps == "table":
        write_table(
            folder / "frames.csv", ["file", "time_s"], sorted(zip(names, times.tolist(), strict=True))
        )
    recording = read_recording(folder)
    np.testing.assert_array_equal(np.stack(list(recording.frames)), pixels)
    np.testing.assert_array_equal(recording.times, times)


def test_without_stamps_numbers_in_names_are_counted_as_people_count(tmp_path):
    pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    pixels = images()
    for i, frame in enumerate(pixels):
        (tmp_path / f"frame{i}.png").write_bytes(png(frame))
    recording = read_recording(tmp_path)
    np.testing.assert_array_equal(np.stack(list(recording.frames)), pixels)
    assert np.isnan(recording.times).all()


def test_a_folder_of_two_kinds_or_two_tables_is_refused(tmp_path):
    (tmp_path / "0.png").write_bytes(png(images()[0]))
    for name in ("a.csv", "b.csv"):
        matrices_in("quaternion", tmp_path / name, moving())
    with pytest.raises(InputError, match=r"holds several tables \(a\.csv, b\.csv\); name the poses' one"):
        read_recording(tmp_path)
    (tmp_path / "0.dcm").write_bytes(b"")
    with pytest.raises(InputError, match="holds both DICOM files and other images; keep one kind in it"):
        read_recording(tmp_path)


def test_a_folder_of_recordings_names_them(tmp_path):
    (tmp_path / "session").mkdir()
    for name in ("b.mcap", "a.igs.mha", "notes.txt"):
        (tmp_path / "session" / name).write_text("x")
    with pytest.raises(InputError) as caught:
        read_recording(tmp_path / "session")
    assert (
        str(caught.value) == "session: is a folder without images; name a recording in it: a.igs.mha, b.mcap"
    )
