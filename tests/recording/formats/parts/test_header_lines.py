"""A header is read in blocks: nothing of it depends on where they end."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonocal import FormatError
from sonocal.recording.formats.parts import header_lines, metaio_header, nrrd_header
from sonocal.recording.formats.parts.metaio_header import read_header
from tests.builders.recordings import random_recording
from tests.builders.strategies import WORDS

LONGEST = 120


def read_in_blocks(monkeypatch, path, size, module=metaio_header):
    with monkeypatch.context() as change:
        change.setattr(header_lines, "CHUNK", size)
        change.setattr(module, "LINES", replace(module.LINES, longest=size))
        return module.read_header(path)


@given(
    words=st.lists(WORDS, min_size=1, max_size=6, unique=True),
    items=st.integers(0, 9),
    blanks=st.sampled_from(["", " ", "\t", "\r"]),
    size=st.integers(LONGEST, 4 * LONGEST),
    pixels=st.binary(max_size=400),
    last=st.booleans(),
)
def test_nothing_depends_on_where_blocks_end(tmp_path_factory, words, items, blanks, size, pixels, last):
    path = tmp_path_factory.mktemp("blocks") / "a.mha"
    fields = {f"X{word}": word[::-1] for word in words}
    lines = [f"{key} = {text}" for key, text in fields.items()]
    numbered = {f"Seq_Frame{i:04d}_Note": "n" * i for i in range(items)}
    lines += [
        f"{key}{blanks if blanks != chr(13) else ''} = {text}{blanks}" for key, text in numbered.items()
    ]
    head = "".join(f"{line}\n" for line in [*lines, ""]) + "ElementDataFile = LOCAL" + ("" if last else "\n")
    path.write_bytes(head.encode() + (b"" if last else pixels))
    with pytest.MonkeyPatch.context() as monkeypatch:
        for header in (read_header(path), read_in_blocks(monkeypatch, path, size)):
            assert header.fields == fields | {"ElementDataFile": "LOCAL"}
            assert header.items.columns == ({"Note": {i: "n" * i for i in range(items)}} if items else {})
            assert header.end == len(head.encode())


@pytest.mark.parametrize("size", [LONGEST, 1000, 1 << 20])
@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        (b"no field", "line 41: 'no field' is not 'name = value' of a MetaIO header"),
        (b"A0 = 3", "line 41: A0 stands twice in the header; delete one"),
        (b"B\0 = 3", "line 41: is not text; a MetaIO header ends with ElementDataFile"),
        (b"B = \xff", "line 41: is not UTF-8 text; a MetaIO header is"),
        (b"Seq_Framex_A = 1", "header field 'Seq_Framex_A' is not Seq_Frame<number>_<name>"),
        (b"Seq_Frame3_N = 1\nSeq_Frame3_N = 1", "frame 3: N stands twice in the header; delete one"),
    ],
)
def test_the_line_at_fault_is_named(tmp_path, monkeypatch, size, line, sentence):
    lines = b"".join(b"A%d = 1\n" % i for i in range(40))
    (tmp_path / "a.mha").write_bytes(
        lines + line + b"\n" + lines.replace(b"A", b"C") + b"ElementDataFile = LOCAL\n"
    )
    with pytest.raises(FormatError) as caught:
        read_in_blocks(monkeypatch, tmp_path / "a.mha", size)
    assert str(caught.value).partition("a.mha")[2].lstrip(",: ") == sentence


def test_a_line_without_end_is_no_header(tmp_path, monkeypatch):
    (tmp_path / "a.mha").write_bytes(b"A = 1\n" + b"x" * 1000)
    with pytest.raises(
        FormatError, match=r"a\.mha, line 2: is not text; a MetaIO header ends with ElementDataFile"
    ):
        read_in_blocks(monkeypatch, tmp_path / "a.mha", 200)


def test_pixels_may_look_like_a_header(tmp_path):
    from sonocal.recording.formats import read_recording, write_recording

    write_recording(random_recording(0, n=2, size=(8, 8)), tmp_path / "a.mha", compress=False)
    content = (tmp_path / "a.mha").read_bytes()
    fake = b"\nElementDataFile = LOCAL\n"
    (tmp_path / "a.mha").write_bytes(content[: -len(fake)] + fake)
    recording = read_recording(tmp_path / "a.mha")
    assert recording.frames[1].tobytes().endswith(fake)
    assert np.isfinite(recording.times).all()


@given(
    words=st.lists(WORDS, min_size=1, max_size=6, unique=True),
    items=st.integers(0, 9),
    ends=st.sampled_from(["\n", "\r\n"]),
    size=st.integers(LONGEST, 4 * LONGEST),
    pixels=st.binary(max_size=400),
)
def test_nothing_of_an_nrrd_header_does_either(tmp_path_factory, words, items, ends, size, pixels):
    path = tmp_path_factory.mktemp("blocks") / "a.nrrd"
    pairs, fields = {f"X{word}": word[::-1] for word in words}, {word.lower(): f"{word}:=1" for word in words}
    lines = ["NRRD0004", *(f"{key}:={text}" for key, text in pairs.items()), "# a remark: none"]
    lines += [f"Seq_Frame{i:04d}_Note:={'n' * i}" for i in range(items)]
    lines += [f"{key}: {text}" for key, text in fields.items()]
    head = "".join(f"{line}{ends}" for line in [*lines, ""])
    path.write_bytes(head.encode() + pixels)
    with pytest.MonkeyPatch.context() as monkeypatch:
        for header in (
            nrrd_header.read_header(path),
            read_in_blocks(monkeypatch, path, size, nrrd_header),
        ):
            assert (header.pairs, header.fields) == (pairs, fields)
            assert header.items.columns == ({"Note": {i: "n" * i for i in range(items)}} if items else {})
            assert header.end == len(head.encode())
