"""Scenes of 3D Slicer: ``.mrb`` (an archive) and ``.mrml`` (beside its files).

A scene is a recording where it has a sequence of images, sequences of linear transforms, or both. Items are matched by
the index values of the sequences, which are times. Transforms that stand in the scene as one matrix hold for all items.
"""

from __future__ import annotations

import shutil
import weakref
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from sonocal.errors import InputError, UnsupportedError
from sonocal.files import read_at
from sonocal.files.kinds import Format, Head, recognise
from sonocal.files.xml import parse_xml
from sonocal.geometry import Array
from sonocal.recording.formats import metaio, nrrd
from sonocal.recording.formats.parts.archive import Archive, Folder, Home
from sonocal.recording.formats.parts.at_times import at_times
from sonocal.recording.formats.parts.scene_constants import constant_transforms, constants_note
from sonocal.recording.model import Provenance, Recording
from sonocal.recording.poses import Poses, by_name

__all__ = ["FORMAT", "read_slicer_scene"]

ZIP = b"PK\3\4"
WHAT = "a scene of 3D Slicer"
STORAGES = ("VolumeSequenceStorage", "LinearTransformSequenceStorage")
OTHER = "SequenceStorage"
MOST_SEQUENCES = 1000


def read_slicer_scene(path: Path) -> Recording:
    """Read a scene. Files of an archive are copied into a temporary folder, which goes with the recording's frames.

    Raises:
        FormatError: the archive or a file in it is damaged, absurd in size, or names files outside of it.
        InputError: there is no sequence, or there are several of images.
        UnsupportedError: a sequence is of another kind of file.
    """
    packed = read_at(path, 0, len(ZIP)) == ZIP or path.suffix.lower() == ".mrb"
    home = Archive(path, ".mrml", WHAT) if packed else Folder(path, WHAT)
    try:
        recording = _recording(home)
    except BaseException:
        _remove(home)
        raise
    recording = replace(recording, provenance=Provenance(path.name, "Slicer scene", (str(path),)))
    if len(recording.frames) and home.scratch is not None:
        weakref.finalize(recording.frames, shutil.rmtree, home.scratch, True)
    else:
        _remove(home)
    return recording


def _remove(home: Home) -> None:
    if home.scratch is not None:
        shutil.rmtree(home.scratch, ignore_errors=True)


def _recording(home: Home) -> Recording:
    root = parse_xml(home.name, home.document.encode(), "scene of 3D Slicer")
    if root.tag != "MRML":
        raise InputError(f"{home.name}: its root is <{str(root.tag)[:40]}> where {WHAT} has <MRML>")
    parts = [_read(home, name) for name in _files(home, root)]
    images = [part for part in parts if part.image is not None]
    if len(images) > 1:
        names = ", ".join(part.name for part in images)[:200]
        raise InputError(
            f"{home.name}: has {len(images)} sequences of images, {names}; save it with the one to read"
        )
    tracked = [part for part in parts if part.poses]
    if not images and not tracked:
        raise InputError(_nothing(home, root, parts))
    base = images[0] if images else tracked[0]
    times = base.times if images else _instants(tracked)
    moving = [one for part in tracked for one in _at(home, part, times)]
    constant = constant_transforms(home.name, root, moving, len(times))
    return replace(
        base if images else Recording(times=times),
        times=times,
        poses=by_name([*moving, *constant], home.name),
        diagnostics=(*(base.diagnostics if images else ()), *constants_note(constant)),
    )


def _instants(tracked: list[Recording]) -> Array:
    """(N,) s: those of all transforms; NaN where they have none."""
    stamps = [part.times for part in tracked]
    return stamps[0] if any(np.isnan(one).any() for one in stamps) else np.unique(np.concatenate(stamps))


def _at(home: Home, part: Recording, times: Array) -> Iterator[Poses]:
    untimed = np.isnan(part.times).any() or np.isnan(times).any()
    if untimed and len(part) != len(times):
        raise InputError(
            f"{home.name}: {part.name} has {len(part)} items where {len(times)} are due, and no times to match them by"
        )
    for one in part.poses.values():
        yield one if untimed else at_times(one, part.times, times, home.name)


def _files(home: Home, root: ET.Element) -> list[str]:
    """The names of the files of the scene's sequences, each once."""
    names = [element.get("fileName") for tag in STORAGES for element in root.iter(tag)]
    found = list(dict.fromkeys(name for name in names if name))
    if len(found) > MOST_SEQUENCES:
        raise InputError(f"{home.name}: names {len(found)} sequences, more than {MOST_SEQUENCES}")
    return found


def _read(home: Home, name: str) -> Recording:
    path = home.file(name)
    found = recognise(Head.of(path), (metaio.FORMAT, nrrd.FORMAT))
    if found is None:
        raise UnsupportedError(
            f"{home.name}: its sequence {name[:80]!r} is no NRRD and no MetaIO; save it as one"
        )
    recording: Recording = found.read(path)
    return recording


def _nothing(home: Home, root: ET.Element, parts: list[Recording]) -> str:
    """What there is instead of a recording."""
    if parts:
        names = ", ".join(part.name for part in parts)[:200]
        return f"{home.name}: its transforms, {names}, do not say from where to where; call them such as ProbeToTracker"
    others = sum(str(element.tag).endswith(OTHER) for element in root.iter())
    more = f" of images or linear transforms, but {others} of another kind" if others else ""
    return f"{home.name}: has no sequences{more}; record images and transforms with Slicer's Sequences"


def _sniff(head: Head) -> bool:
    if head.content.startswith(ZIP):
        return b".mrml" in head.content
    return head.text.startswith(b"<") and b"<MRML" in head.text


FORMAT = Format(
    name="Slicer scene",
    kind="recording",
    suffixes=(".mrb", ".mrml"),
    sniff=_sniff,
    read=read_slicer_scene,
    holds="one sequence of images (`.seq.nrrd`, `.seq.mha`) with sequences of linear transforms, and constant ones",
)
