"""Laws of the registry, run on every format in it: a new one is tested by being listed."""

import importlib
import json
import pkgutil
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st
from scripts.formats import DOCS, with_table

import sonocal.recording.formats
from sonocal import SonocalError
from sonocal.calibration import calibration_json
from sonocal.cli.formats import FORMATS, format_of, kind_of
from sonocal.cli.main import main
from sonocal.files.kinds import Head, recognise
from sonocal.observations import observations_csv
from sonocal.recording.formats import read_recording
from sonocal.recording.formats.registry import FORMATS as RECORDINGS
from tests.builders.damage import damage
from tests.builders.recordings import assert_same
from tests.builders.sound import SOUND, sound_paths

NAMES = [one.name for one in FORMATS]
BY_NAME = {one.name: one for one in FORMATS}
WRITTEN = [(one.name, suffix) for one in FORMATS for suffix in one.writes]


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    return sound_paths(tmp_path_factory.mktemp("sound"))


def same_targets(one, other):
    for mine, theirs in ((one.lines, other.lines), (one.points, other.points)):
        assert [(t.name, t.frame) for t in mine] == [(t.name, t.frame) for t in theirs]
    for mine, theirs in zip(one.lines, other.lines, strict=True):
        assert mine.segment_mm.tobytes() == theirs.segment_mm.tobytes()
    for mine, theirs in zip(one.points, other.points, strict=True):
        assert mine.place_mm.tobytes() == theirs.place_mm.tobytes()


def same_table(one, other):
    assert observations_csv(one) == observations_csv(other)


def same_calibration(one, other):
    assert calibration_json(one) == calibration_json(other)


def same_recordings(one, other):
    """To the last bit; no status said of any pose is none."""
    assert_same(*(replace(each, poses={n: said(p) for n, p in each.poses.items()}) for each in (one, other)))


def said(poses):
    return poses if any(poses.status or ()) else replace(poses, status=None)


SAME = {
    "recording": same_recordings,
    "targets": same_targets,
    "observations": same_table,
    "calibration": same_calibration,
}


def test_names_are_unique_and_every_format_has_sound_files(sound):
    assert len(set(NAMES)) == len(NAMES)
    assert set(SOUND) == set(NAMES)
    assert all(sound.values())


def test_every_file_beside_the_registry_is_a_format_of_it():
    """Nothing else lies there, so that who looks for the formats sees them."""
    folder = sonocal.recording.formats
    names = [info.name for info in pkgutil.iter_modules(folder.__path__)]
    formats = [
        importlib.import_module(f"{folder.__name__}.{n}") for n in names if n not in ("registry", "parts")
    ]
    assert sorted(map(id, RECORDINGS)) == sorted(id(module.FORMAT) for module in formats)


# Of a calibration: when it was written, to the second.
CREATED = re.compile(rb'"created": "[^"]*"')


@pytest.mark.parametrize("name", NAMES)
def test_a_sound_file_is_claimed_by_its_format_alone(sound, name):
    for path in sound[name]:
        head = Head.of(path)
        assert [one.name for one in FORMATS if one.sniff(head)] == [name], path.name


@pytest.mark.parametrize("name", NAMES)
def test_what_is_in_a_file_counts_for_more_than_its_name(sound, name, tmp_path):
    contents = [path.read_bytes() for path in sound[name] if path.is_file()]
    names = ["file", *(f"a{suffix}" for one in FORMATS for suffix in one.suffixes)]
    for content in contents:
        for other in names:
            (tmp_path / other).write_bytes(content)
            assert format_of(tmp_path / other) is BY_NAME[name], other


@pytest.mark.parametrize("name", NAMES)
def test_a_byte_order_mark_and_windows_line_ends_change_nothing_of_text(sound, name, tmp_path):
    for path in sound[name]:
        content = b"" if path.is_dir() else path.read_bytes()
        if content and (BY_NAME[name].header or BY_NAME[name].kind != "recording"):
            (tmp_path / "file").write_bytes(b"\xef\xbb\xbf" + content.replace(b"\n", b"\r\n"))
            assert format_of(tmp_path / "file") is BY_NAME[name]


@pytest.mark.parametrize("name", NAMES)
def test_a_file_of_which_nothing_is_left_is_known_by_its_name_where_the_name_tells(name, tmp_path):
    one = BY_NAME[name]
    for suffix in one.suffixes:
        (tmp_path / f"a{suffix}").write_bytes(b"\x01\x02 nothing that any format starts with")
        kinds = {other.kind for other in FORMATS if suffix in other.suffixes}
        assert kind_of(tmp_path / f"a{suffix}") == (one.kind if len(kinds) == 1 else None)


@pytest.mark.parametrize("one", RECORDINGS, ids=lambda one: one.name)
def test_a_recording_says_its_format_as_the_registry_does(sound, one):
    for path in sound[one.name]:
        recording = read_recording(path)
        assert len(recording) > 0
        said = recording.provenance.format
        assert said in one.name or said in ("images", "DICOM files", "NRRD sequence")


@pytest.mark.parametrize("name", NAMES)
def test_info_shows_every_format(sound, name):
    for path in sound[name]:
        done = CliRunner().invoke(main, ["info", str(path), "--json"])
        assert done.exit_code == 0, done.output
        assert json.loads(done.stdout)
        assert CliRunner().invoke(main, ["info", str(path)]).stdout.strip()


@pytest.mark.parametrize(("name", "suffix"), WRITTEN)
def test_what_is_written_is_read_again(sound, name, suffix, tmp_path):
    one = BY_NAME[name]
    for path in sound[name]:
        value = one.read(path)
        first, second = tmp_path / f"a{suffix}", tmp_path / f"b{suffix}"
        one.write(value, first)
        again = (read_recording if one.kind == "recording" else one.read)(first)  # with what lies beside it
        SAME[one.kind](value, again)
        assert format_of(first) is one
        one.write(again, second)
        if suffix != ".mhd":  # names its data file
            assert CREATED.sub(b"", first.read_bytes()) == CREATED.sub(b"", second.read_bytes())


def test_a_writer_says_which_names_it_writes_and_they_are_its_own():
    for one in FORMATS:
        assert (one.write is not None) == bool(one.writes)
        assert set(one.writes) <= set(one.suffixes)
        assert all(suffix == suffix.lower() and suffix.startswith(".") for suffix in one.suffixes)


@pytest.mark.parametrize("name", [one.name for one in FORMATS if one.suffixes])
@settings(max_examples=40)
@given(data=st.data(), change=damage())
def test_damaged_files_are_read_or_refused_in_one_sentence(sound, tmp_path_factory, name, data, change):
    path = data.draw(st.sampled_from([path for path in sound[name] if path.is_file()]))
    damaged = tmp_path_factory.mktemp("damaged") / path.name
    damaged.write_bytes(change(path.read_bytes()))
    try:
        read = format_of(damaged).read(damaged)
        for frame in getattr(read, "frames", [])[:3]:
            assert frame.size
    except SonocalError as error:
        assert str(error)
        assert "\n" not in str(error)


@settings(max_examples=200)
@given(
    content=st.binary(max_size=400),
    suffix=st.sampled_from(["", *(s for one in FORMATS for s in one.suffixes)]),
)
def test_sniffing_any_bytes_gives_a_format_or_a_sentence(tmp_path_factory, content, suffix):
    path = tmp_path_factory.mktemp("any") / f"file{suffix}"
    path.write_bytes(content)
    head = Head.of(path)
    kinds = ("an empty file", "binary data", "XML", "text", "a web page (HTML), whatever its name says,")
    assert head.looks_like in kinds
    found = recognise(head, FORMATS)
    if found is None:
        with pytest.raises(SonocalError, match="in no format that sonocal reads; it reads "):
            format_of(path)
    else:
        assert found.sniff(head) or suffix in found.suffixes


def test_nothing_heavy_is_loaded_to_know_a_file(sound):
    paths = [str(path) for paths in sound.values() for path in paths]
    code = (
        "import sys; from pathlib import Path; from sonocal.cli.formats import format_of\n"
        "for path in sys.argv[1:]: format_of(Path(path))\n"
        "heavy = ('scipy', 'av', 'PIL', 'rosbags', 'pydicom', 'msgspec', 'rich', 'sonocal._core', "
        "'sonocal.calibration', 'sonocal.detection', 'sonocal.sweep')\n"
        "print([m for m in heavy if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code, *paths], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_the_page_of_formats_has_the_table_of_the_registry():
    page = DOCS.read_text(encoding="utf-8")
    assert with_table(page) == page
    for one in FORMATS:
        assert f"| {one.name} |" in page
        assert "|" not in "".join((one.name, one.holds, one.header, *one.suffixes, *one.needs))


def test_the_packages_a_format_needs_are_those_of_the_extras():
    project = (Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8")
    extras = project.partition("\n[project.optional-dependencies]\n")[2].partition("\nreport = ")[0]
    assert all(f'"{package}>=' in extras for one in FORMATS for package in one.needs)


def test_a_table_of_several_kinds_is_known_by_what_matters_more(tmp_path):
    """Further columns of a table of sightings are free: the first that decides is x0_mm."""
    rows = {
        "frame,u_px,x0_mm,Probe_qw": "observations",
        "x_mm,u_px": "known points",
        "u_px,probe_00": "known points",
        '"u_px","v_px"': "points",
        "t,Probe_qw": "recording",
        "time, ProbeToTrackerTransform": "recording",
        "u,v": None,
        '"u_px': "points",  # its reader says that the quote is not closed
    }
    for header, kind in rows.items():
        (tmp_path / "a.csv").write_text(f"{header}\n1,2\n")
        assert kind_of(tmp_path / "a.csv") == kind, header


def test_folders_are_known_whatever_they_are_called(tmp_path):
    for name in ("a", "a.mha", "a.csv"):
        (tmp_path / name).mkdir()
        assert kind_of(tmp_path / name) == "recording"
    np.testing.assert_equal(Head.of(tmp_path / "a").content, b"")


@pytest.mark.parametrize(
    "content",
    [
        b"x = 1\ny = 2\n",
        b"RIFF\x24\0\0\0WAVEfmt ",
        b"RIFF\x24\0\0\0WEBPVP8 ",
        b"BM is how this note begins\n",
        b"%PDF-1.7\n",
        b"PK\x03\x04\0\0",
        b"# [[line]] in a comment only\n",
        b"frame,target,v_px\n1,2,3\n",
    ],
)
def test_files_of_other_programs_are_in_no_format(tmp_path, content):
    (tmp_path / "file").write_bytes(content)
    assert [one.name for one in FORMATS if one.sniff(Head.of(tmp_path / "file"))] == []
