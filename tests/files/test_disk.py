"""Files appear whole or not at all, and nothing outside a folder is named from inside it."""

import errno
import hashlib
import os
import stat
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import sonocal as sc
from sonocal import FormatError, InputError
from sonocal.detection import read_detections
from sonocal.files import (
    beside,
    digest,
    file_beside,
    file_size,
    path_of,
    read_at,
    read_bytes,
    read_text,
    write_atomically,
    write_into_folder,
    writing,
)
from sonocal.simulation.scene import simulate_observations
from sonocal.targets import read_lines


def saved(name):
    """Write a calibration under a name."""
    sc.calibrate(simulate_observations(2, 30, seed=1).observations).save(name)


# As parts of a path, with what climbs out among them.
PARTS = st.sampled_from(["a", "..", ".", "b.raw", "", "C:", "\\", "/", "...", "a b", "\\\\server", "..a"])


@given(content=st.binary(max_size=300), offset=st.integers(0, 400), count=st.integers(0, 400))
def test_what_is_written_is_read(tmp_path_factory, content, offset, count):
    path = tmp_path_factory.mktemp("disk") / "file"
    write_atomically(path, content)
    assert read_bytes(path) == content
    assert file_size(path) == len(content)
    assert read_at(path, offset, count) == content[offset : offset + count]
    assert digest(path) == hashlib.sha256(content).hexdigest()


@given(st.dictionaries(st.sampled_from("abcd"), st.binary(max_size=20)))
def test_a_folder_has_the_digest_of_its_files_in_order(tmp_path_factory, files):
    folder = tmp_path_factory.mktemp("disk")
    write_into_folder(folder / "new" / "deep", files)
    whole = b"".join(files[name] for name in sorted(files))
    assert digest(folder / "new" / "deep") == hashlib.sha256(whole).hexdigest()


@given(before=st.none() | st.binary(max_size=20), part=st.binary(max_size=20))
def test_a_failed_writing_leaves_what_was_there(tmp_path_factory, before, part):
    folder = tmp_path_factory.mktemp("disk")
    if before is not None:
        (folder / "file").write_bytes(before)
    with pytest.raises(RuntimeError), writing(folder / "file") as file:
        file.write(part)
        raise RuntimeError
    assert {p.name: p.read_bytes() for p in folder.iterdir()} == ({} if before is None else {"file": before})


@pytest.mark.parametrize("mask", [0o022, 0o077, 0o002])
def test_a_result_has_the_rights_of_any_new_file(tmp_path, mask):
    before = os.umask(mask)
    try:
        write_atomically(tmp_path / "file", b"")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "file").stat().st_mode) == 0o666 & ~mask


@given(
    st.lists(PARTS, min_size=1, max_size=4).map("/".join)
    | st.lists(PARTS, min_size=1, max_size=4).map("\\".join)
    | st.text(max_size=8)
)
def test_a_data_file_lies_below_its_header(name):
    """What is let through never leaves the folder, as this system or as Windows would read it."""
    header = Path("/data/of/someone/a.mhd")
    try:
        path = beside(header, name)
    except FormatError as error:
        assert "lies outside the header's folder" in str(error)
        return
    assert Path(os.path.normpath(path)).is_relative_to(header.parent)
    assert ".." not in name.replace("\\", "/").split("/")
    assert not name.startswith(("/", "\\"))
    assert "\0" not in name


@pytest.mark.parametrize("name", ["a" * 300, "b/" * 3000, "not there", "."])
def test_a_name_that_no_file_has_is_of_none(tmp_path, name):
    (tmp_path / "there").write_bytes(b"")
    assert file_beside(tmp_path / "a.mhd", name) is None
    assert file_beside(tmp_path / "a.mhd", "there") == tmp_path / "there"


@pytest.mark.parametrize(
    "name", ["../a", "a/../../b", "..\\a", "a\\..\\b", "/etc/passwd", "C:\\a", "\\\\server\\a", "a\0b"]
)
def test_names_that_lead_elsewhere_are_refused(name):
    with pytest.raises(FormatError, match="lies outside the header's folder"):
        beside(Path("/data/a.mhd"), name)


@pytest.mark.parametrize("name", ["a.raw", "pixels/a.raw", "a..raw", "..a"])
def test_names_in_the_folder_are_let_through(name):
    assert beside(Path("/data/a.mhd"), name) == Path("/data") / name


@given(st.text(st.characters(codec="utf-8", exclude_characters="\0\ufeff"), max_size=50), st.booleans())
def test_text_is_read_with_and_without_a_mark(tmp_path_factory, text, mark):
    path = tmp_path_factory.mktemp("disk") / "a.txt"
    path.write_bytes(b"\xef\xbb\xbf" * mark + text.encode())
    assert read_text(path, "a note") == text


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"ab\xff", "a.txt: byte 2 is not UTF-8; a note is UTF-8 text"),
        (b"abc\0", "a.txt: holds a zero byte; a note is UTF-8 text"),
        (
            "u,v\n".encode("utf-16-le"),
            "a.txt: holds a zero byte, as UTF-16 without its mark does: save it as UTF-8; a note is UTF-8 text",
        ),
        (b"x" * 11, "a.txt: holds 11 bytes, more than the 10 of a note; is it the right file?"),
    ],
)
def test_what_is_no_text_is_refused(tmp_path, content, sentence):
    (tmp_path / "a.txt").write_bytes(content)
    with pytest.raises(InputError) as caught:
        read_text(tmp_path / "a.txt", "a note", limit=10)
    assert str(caught.value) == sentence


def test_a_place_that_cannot_be_written_is_said(tmp_path):
    with pytest.raises(
        InputError, match=rf"cannot be written \({os.strerror(errno.ENOENT)}\); choose another place"
    ):
        write_atomically(tmp_path / "no" / "file", b"")
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(InputError, match="cannot be made a folder"):
        write_into_folder(tmp_path / "file", {"a": b""})
    with pytest.raises(InputError, match="is a directory; name the file in it"):
        read_bytes(tmp_path)


def as_windows(*_, **__):
    """What Windows says of a folder that is opened, and of a file that another program has open."""
    raise PermissionError(errno.EACCES, "Access is denied")


def test_a_folder_is_called_one_where_the_system_says_it_is_denied(tmp_path, monkeypatch):
    (tmp_path / "file").write_bytes(b"x")
    monkeypatch.setattr(Path, "open", as_windows)
    with pytest.raises(InputError, match="is a directory; name the file in it"):
        read_at(tmp_path, 0, 1)
    with pytest.raises(InputError, match=r"cannot be read \(Access is denied\); check its permissions"):
        read_at(tmp_path / "file", 0, 1)


@pytest.mark.parametrize("there", [False, True])
def test_a_file_that_is_open_elsewhere_is_to_be_closed(tmp_path, monkeypatch, there):
    path = tmp_path / "table.csv"
    if there:
        path.write_bytes(b"old")
    monkeypatch.setattr(Path, "replace", as_windows)
    with pytest.raises(InputError) as caught:
        write_atomically(path, b"new")
    close = "close it where it is open, or " if there else ""
    assert str(caught.value) == f"{path}: cannot be written (Access is denied); {close}choose another place"
    assert [p.read_bytes() for p in tmp_path.iterdir()] == [b"old"] * there


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        (None, "path must be the name of a file, as text or a Path; got None"),
        (b"x", "path must be the name of a file, as text or a Path; got b'x'"),
        ("a\0b", r"'a\x00b': no file can be called so, it holds a zero byte"),
        ("\ud800", r"'\ud800': no file can be called so, it holds half a character"),
    ],
)
@pytest.mark.parametrize(
    "use",
    [sc.read_observations, sc.read_recording, sc.load, read_lines, read_detections, saved],
    ids=lambda use: use.__name__,
)
def test_what_names_no_file_is_refused_wherever_a_file_is_named(use, name, sentence):
    with pytest.raises(InputError) as caught:
        use(name)
    assert str(caught.value) == sentence


def test_names_that_the_system_gives_are_names(tmp_path):
    for name in ("a b", "\udcff", "é"):  # the second is a byte that is no UTF-8
        path = tmp_path / name
        path.write_bytes(b"x")
        assert read_bytes(path_of(str(path))) == b"x"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no pipes with a name")
def test_a_file_takes_no_place_of_a_pipe_or_a_device(tmp_path):
    pipe, link = tmp_path / "pipe", tmp_path / "link"
    os.mkfifo(pipe)
    link.symlink_to(pipe)
    for path in (pipe, link, Path(os.devnull)):
        with pytest.raises(InputError, match="is a pipe or a device"):
            write_atomically(path, b"content")
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    assert link.is_symlink()
