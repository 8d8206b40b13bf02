"""sonocal convert: what is written is what was read, in every format, or it is said what is not."""

from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from sonocal import InputError
from sonocal.cli.main import main
from sonocal.recording import ArrayFrames, ImageGeometry, Poses, Recording
from sonocal.recording.formats import read_recording, write_recording
from tests.builders.recordings import assert_same, random_pixels, random_poses, random_recording

SEQUENCES = (".mha", ".mhd", ".nrrd")


def run(*arguments):
    return CliRunner(env={"COLUMNS": "200", "TERM": "dumb"}).invoke(main, [str(a) for a in arguments])


def converted(source, target, *options):
    done = run("convert", source, "-o", target, *options)
    assert done.exit_code == 0, done.output
    return read_recording(target), done.output


@pytest.mark.parametrize("last", SEQUENCES)
@pytest.mark.parametrize("first", SEQUENCES)
@given(
    seed=st.integers(0, 10**6),
    size=st.sampled_from([(7, 4), (5, 4, 3), None]),
    dtype=st.sampled_from(["uint8", "int16", "float32"]),
    raw=st.booleans(),
)
def test_a_sequence_is_the_same_in_every_format(tmp_path_factory, first, last, seed, size, dtype, raw):
    folder = tmp_path_factory.mktemp("convert")
    recording = random_recording(seed, 4, size, dtype)
    write_recording(recording, folder / f"a{first}")
    again, _ = converted(folder / f"a{first}", folder / f"b{last}", *["--raw"][: int(raw)])
    assert_same(recording, again)
    assert dict(recording.fields).items() <= dict(again.fields).items()
    assert (again.image is None) == (recording.image is None)


@pytest.mark.parametrize("first", SEQUENCES)
@given(seed=st.integers(0, 10**6), timed=st.booleans(), said=st.booleans())
def test_poses_go_through_a_table_and_back(tmp_path_factory, first, seed, timed, said):
    folder = tmp_path_factory.mktemp("convert")
    recording = random_recording(seed, 6, None)
    if not timed:
        recording = replace(recording, times=np.full(6, np.nan))
    if not said:
        poses = {name: replace(one, status=None) for name, one in recording.poses.items()}
        recording = replace(recording, poses=poses)
    write_recording(recording, folder / f"a{first}")
    table, said_of = converted(folder / f"a{first}", folder / "b.csv")
    assert "Not in it, for which the format has no place: fields such as" in said_of
    back, _ = converted(folder / "b.csv", folder / f"c{first}")
    for again in (table, back):
        assert again.times.tobytes() == recording.times.tobytes()
        assert again.poses.keys() == recording.poses.keys()
        for name, one in recording.poses.items():
            np.testing.assert_array_equal(again.poses[name].valid, one.valid)
            assert again.poses[name].matrices.tobytes() == one.matrices.tobytes()
            stated = tuple("OK" if valid else "INVALID" for valid in one.valid)
            assert again.poses[name].status == (one.status or stated)


@given(
    seed=st.integers(0, 10**6),
    colour=st.booleans(),
    size=st.tuples(st.integers(2, 40), st.integers(2, 40)),
    steps=st.lists(st.integers(1, 5000), min_size=1, max_size=5),
    start=st.floats(0, 90_000),
)
def test_images_and_poses_go_through_a_video_and_back(tmp_path_factory, seed, colour, size, steps, start):
    """Images and valid poses bit for bit; stamps to half of the video's ms."""
    pytest.importorskip("av", reason="PyAV is not installed")
    folder, rng = tmp_path_factory.mktemp("convert"), np.random.default_rng(seed)
    times = start + np.cumsum([0, *steps]) * 1e-3 + 4e-4
    n = len(times)
    shape = (n, *size, 3) if colour else (n, *size)
    frames = ArrayFrames(random_pixels(rng, shape, "uint8"))
    valid = rng.random(n) < 0.7
    probe = Poses(
        "Probe", "Tracker", random_poses(rng, n), valid, tuple("OK" if v else "MISSING" for v in valid)
    )
    recording = Recording(
        times=times,
        frames=frames,
        poses={probe.name: probe},
        image=ImageGeometry.of(frames, orientation="MF"),
    )
    write_recording(recording, folder / "a.mha")
    again, said = converted(folder / "a.mha", folder / "b.mkv")
    assert "b.mkv and " in said
    np.testing.assert_array_equal(np.stack(list(again.frames)), np.stack(list(frames)))
    assert np.abs(again.times - times).max() < 6e-4
    found = again.poses["tracker_from_probe"]
    np.testing.assert_array_equal(found.valid, valid)
    np.testing.assert_array_equal(found.matrices, probe.matrices)
    assert found.status == probe.status
    back, _ = converted(folder / "b.mkv", folder / "c.nrrd")
    assert back.times.tobytes() == again.times.tobytes()
    np.testing.assert_array_equal(np.stack(list(back.frames)), np.stack(list(frames)))


def test_a_video_without_poses_has_no_table(tmp_path):
    pytest.importorskip("av", reason="PyAV is not installed")
    write_recording(random_recording(0, tools=()), tmp_path / "a.mha")
    assert run("convert", tmp_path / "a.mha", "-o", tmp_path / "b.mkv").exit_code == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.mha", "b.mkv"]
    (tmp_path / "c.csv").write_text("a table of something else")
    refused = run("convert", tmp_path / "a.mha", "-o", tmp_path / "c.mkv", "--overwrite")
    assert (refused.exit_code, "would be taken for the poses of c.mkv" in refused.output) == (1, True)
    assert not (tmp_path / "c.mkv").exists()


REFUSED = {
    "images in a table": (random_recording(0), ".csv", "holds images, which a table of poses cannot"),
    "nothing in a table": (random_recording(0, size=None, tools=()), ".csv", "holds no poses"),
    "volumes in a video": (
        random_recording(0, size=(4, 3, 2)),
        ".mkv",
        "holds uint8 of 4 x 3 x 2 px, and a video",
    ),
    "16 bits in a video": (
        random_recording(0, dtype="uint16"),
        ".mkv",
        "holds uint16 of 7 x 4 px, and a video",
    ),
    "no images in a video": (random_recording(0, size=None), ".mkv", "holds no images, and a video"),
    "no stamps in a video": (
        replace(random_recording(0), times=np.full(5, np.nan)),
        ".mkv",
        "its stamps are no milliseconds from 0 that increase",
    ),
    "equal stamps in a video": (
        replace(random_recording(0), times=np.array([0, 1, 1.0001, 2, 3])),
        ".mkv",
        "its stamps are no milliseconds from 0 that increase",
    ),
    "another name": (
        random_recording(0),
        ".png",
        "recordings are written as .mha, .mhd, .nrrd, .csv or .mkv",
    ),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_a_format_cannot_hold_is_refused(tmp_path, what):
    recording, suffix, words = REFUSED[what]
    write_recording(recording, tmp_path / "a.mha")
    done = run("convert", tmp_path / "a.mha", "-o", tmp_path / f"b{suffix}")
    assert done.exit_code == 1
    assert words in done.output
    assert [path.name for path in tmp_path.iterdir()] == ["a.mha"]


def test_images_are_left_out_when_told(tmp_path):
    recording = random_recording(0)
    write_recording(recording, tmp_path / "a.mha")
    for name in ("b.csv", "b.mha", "b.nrrd"):
        again, _ = converted(tmp_path / "a.mha", tmp_path / name, "--without-images")
        assert (again.image, len(again.frames)) == (None, 0)
        assert again.poses.keys() == recording.poses.keys()


def test_what_the_encoder_refuses_is_a_sentence(tmp_path):
    pytest.importorskip("av", reason="PyAV is not installed")
    write_recording(random_recording(0, size=(1, 2)), tmp_path / "a.mha")
    done = run("convert", tmp_path / "a.mha", "-o", tmp_path / "b.mkv")
    assert done.exit_code == 1
    assert "cannot be written as a video" in done.output
    assert [path.name for path in tmp_path.iterdir()] == ["a.mha"]


def test_a_latency_that_the_file_does_not_remember_is_said(tmp_path):
    recording = random_recording(0, n=9, size=None)
    moved = np.arange(9) * 0.1
    poses = {name: Poses.of(one.source, one.target, one.matrices) for name, one in recording.poses.items()}
    write_recording(replace(recording, times=moved, poses=poses), tmp_path / "a.mha")
    _, said = converted(tmp_path / "a.mha", tmp_path / "b.mha", "--latency", "0.05")
    assert "that poses were moved by 0.05 s" in said


def test_the_pixels_of_a_header_that_is_read_are_not_written_onto(tmp_path):
    """They are not named on the command line."""
    write_recording(random_recording(0), tmp_path / "a.mhd", compress=False)
    (tmp_path / "b.mhd").write_bytes((tmp_path / "a.mhd").read_bytes())
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    refused = run("convert", tmp_path / "b.mhd", "-o", tmp_path / "a.mhd", "--raw", "--overwrite")
    assert refused.exit_code == 1
    assert "is what this command reads" in refused.output
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.parametrize("name", ["Probe\n", "#Probe", 'Pro"be', "A To B", " Probe"])
def test_names_that_a_table_could_not_hold_are_refused(tmp_path, name):
    one = Poses.of(name, "Tracker", np.tile(np.eye(4), (2, 1, 1)))
    recording = Recording(times=np.arange(2.0), poses={one.name: one})
    try:
        write_recording(recording, tmp_path / "a.csv")
    except InputError as error:
        assert "\n" not in str(error)
        assert list(tmp_path.iterdir()) == []
    else:
        (again,) = read_recording(tmp_path / "a.csv").poses.values()
        assert (again.source, again.target) == (name, "Tracker")
