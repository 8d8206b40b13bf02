"""One sweep in the forms in which people have theirs: a video, pictures, DICOM, a bag, and the logs of trackers."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sonocal.recording.formats import write_recording
from tests.builders.bags import IMAGE, TF, messages_for, write_bag
from tests.builders.pictures import dicom_file
from tests.builders.trackers import SHAPE, c3d_file, marker_places, text_of

TOOLS = ("Probe", "Needle")


def write_recordings(recording, folder):
    """Images without poses, logs of poses without images, and both in one."""
    images = np.stack([recording.frames[i] for i in range(len(recording))])
    write_video(recording, folder)
    write_pictures(images, recording.times, folder / "images")
    (folder / "images" / "poses.csv").write_bytes((folder / "tracking.csv").read_bytes())
    dicom_file(folder / "scan.dcm", images, FrameTime=str(1000 * float(recording.times[1])))
    poses = {tool: recording.poses[f"tracker_from_{tool.lower()}"].matrices for tool in TOOLS}
    (folder / "motive.csv").write_text(motive(recording.times, poses))
    (folder / "ndi.tsv").write_text(ndi(recording.times, poses))
    write_markers(recording.times, poses, folder)
    write_in_bag(images, recording.times, poses, folder / "sweep.mcap")


def write_video(recording, folder):
    """A video and, beside it, the poses under another name."""
    write_recording(recording, folder / "scan.mkv")
    (folder / "scan.csv").rename(folder / "tracking.csv")


def write_pictures(images, times, folder):
    pillow = pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    folder.mkdir()
    for i, image in enumerate(images):
        pillow.fromarray(image).save(folder / f"{i:04}.png")
    rows = [("file", "time_s"), *((f"{i:04}.png", time) for i, time in enumerate(times.tolist()))]
    (folder / "frames.csv").write_text(text_of(rows))


def motive(times, poses):
    """Motive's CSV of rigid bodies, metres."""
    names = [name for name in poses for _ in range(7)]
    rows = [
        ["Format Version", "1.23", "Rotation Type", "Quaternion", "Length Units", "Meters"],
        [],
        ["", "Type", *["Rigid Body"] * len(names)],
        ["", "Name", *names],
        ["", "ID", *names],
        ["", "", *[*["Rotation"] * 4, *["Position"] * 3] * len(poses)],
        ["Frame", "Time (Seconds)", *"XYZWXYZ" * len(poses)],
    ]
    for i, time in enumerate(times.tolist()):
        cells = [number for one in poses.values() for number in [*xyzw(one[i]), *(one[i, :3, 3] / 1000)]]
        rows.append([i, time, *map(float, cells)])
    return text_of(rows)


def ndi(times, poses):
    """ToolBox's TSV, mm."""
    axes = [
        "Frame",
        "Time [sec]",
        "Face",
        "State",
        "Q0",
        "Qx",
        "Qy",
        "Qz",
        "Tx",
        "Ty",
        "Tz",
        "Error",
        "Markers",
    ]
    rows = [["Tools", *(cell for name in poses for cell in (name, *axes))]]
    for i, time in enumerate(times.tolist()):
        row = [len(poses)]
        for name, one in poses.items():
            row += [
                name,
                i,
                time,
                1,
                "OK",
                *np.roll(xyzw(one[i]), 1).tolist(),
                *one[i, :3, 3].tolist(),
                0.2,
                0,
            ]
        rows.append(row)
    return text_of(rows, "\t")


def write_markers(times, poses, folder):
    """C3D of four markers a tool, and where they are in its frame."""
    places = np.concatenate([marker_places(one) for one in poses.values()], axis=1)
    labels = [f"{name}:{i}" for name in poses for i in range(len(SHAPE))]
    c3d_file(folder / "markers.c3d", places, labels, rate=1 / float(times[1]))
    points = [
        f'[[point]]\nname = "{name}:{i}"\nframe = "{name}"\nat_mm = {at.tolist()}\n'
        for name in poses
        for i, at in enumerate(SHAPE)
    ]
    (folder / "markers.toml").write_text("\n".join(points))


def write_in_bag(images, times, poses, path):
    messages = messages_for("mcap")
    entries = []
    for i, time in enumerate((1 + times).tolist()):
        moved = [messages.stamped("tracker", name.lower(), time, one[i]) for name, one in poses.items()]
        entries.append(("/tf", TF, time, messages.tf(*moved)))
        entries.append(("/us/image", IMAGE, time, messages.image(time, images[i], "mono8")))
    write_bag(path.with_suffix(""), "mcap file", messages, entries).rename(path)


def xyzw(matrix):
    return Rotation.from_matrix(matrix[:3, :3]).as_quat()
