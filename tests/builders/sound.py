"""Sound small files of every format of the registry: what its laws and the fuzzers start from."""

import io
from functools import lru_cache

import msgspec
import numpy as np
import pytest

import sonocal as sc
from sonocal.calibration import calibration_json
from sonocal.export.itk import itk_h5, itk_tfm
from sonocal.export.plus import plus_xml
from sonocal.export.slicer import slicer_h5, slicer_tfm
from sonocal.observations import observations_csv
from sonocal.recording.formats import write_recording
from sonocal.report import report_html
from sonocal.simulation.scene import simulate_observations
from sonocal.simulation.sweep import SweepOptions, simulate_sweep
from sonocal.simulation.truth_file import truth_json
from sonocal.simulation.ultrasound import BATH
from sonocal.simulation.ultrasound_probe import curvilinear
from sonocal.studies import Store, load_study, run_study, summarise, threads
from sonocal.studies.summary import summary_csv, summary_json
from tests.builders.bags import messages_for, small_sweep, write_bag
from tests.builders.kretz import kretz_bytes, some_toroid
from tests.builders.pictures import PHILIPS_CLASS, dicom_file, images, items, palette, plane, volume_file
from tests.builders.recordings import random_pixels, random_poses, random_recording
from tests.builders.scenes import image_sequence, scene_document, transform_sequence, write_scene
from tests.builders.tables import matrices_in, motive
from tests.builders.targets import LINE, PHANTOM, PLANE, POINT
from tests.builders.trackers import (
    c3d_file,
    marker_places,
    ndi_capi,
    ndi_toolbox,
    tum,
    vicon_bodies,
    vicon_markers,
)
from tests.builders.videos import video_with_texts

KNOWN_POINTS = b"u_px,v_px,x_mm,y_mm,z_mm,target\n1,2,3,4,5,a\n6,7,8,9,1,a\n"
TRACKED_POINTS = (
    ",".join(["u_px", "v_px", *(f"probe_{i}{j}" for i in range(3) for j in range(4))])
    + "\n1,2,1,0,0,5,0,1,0,6,0,0,1,7\n8,9,1,0,0,5,0,1,0,6,0,0,1,8\n"
).encode()


@lru_cache
def some_calibration():
    return sc.calibrate(simulate_observations(2, 12, seed=1).observations)


def sequences(*suffixes):
    def make(folder):
        small = random_recording(0, n=3, size=(5, 4))
        kinds = {
            "zlib": (small, {}),
            "raw": (small, {"compress": False}),
            "tracker": (random_recording(0, n=3, size=None), {}),
            "volumes": (random_recording(0, n=2, size=(3, 2, 2), channels=3), {}),
            "shorts": (random_recording(0, n=2, size=(3, 2), dtype="int16", orientation="MN"), {}),
        }
        for suffix in suffixes:
            for name, (recording, how) in kinds.items():
                write_recording(recording, folder / f"{name}{suffix}", **how)
        return [folder / f"{name}{suffix}" for suffix in suffixes for name in kinds]

    return make


def pose_tables(folder):
    matrices = random_poses(np.random.default_rng(0), 12)
    forms = ("cells", "matrix", "quaternion")
    for form in forms:
        matrices_in(form, folder / f"{form}.csv", matrices)
    return [folder / f"{form}.csv" for form in forms]


def motive_tables(folder):
    motive(folder / "motive.csv", random_poses(np.random.default_rng(0), 12), blank=(2,))
    return [folder / "motive.csv"]


def ndi_logs(folder):
    first, second = (random_poses(np.random.default_rng(i), 12) for i in range(2))
    tools = {"Probe s/n:1": first, "Port 0x02: Needle s/n:2": second}
    (folder / "capi.csv").write_text(ndi_capi(tools, lost=(3,), markers=2))
    (folder / "toolbox.tsv").write_text(ndi_toolbox(tools, lost=(3,)))
    (folder / "angles.csv").write_text(ndi_toolbox(tools, separator=",", euler=True))
    return [folder / "capi.csv", folder / "toolbox.tsv", folder / "angles.csv"]


def trajectories(folder):
    matrices = random_poses(np.random.default_rng(0), 12)
    (folder / "probe.txt").write_text(tum(matrices))
    (folder / "needle.tum").write_text(tum(matrices, comment=""))
    return [folder / "probe.txt", folder / "needle.tum"]


def vicon_exports(folder):
    matrices = random_poses(np.random.default_rng(0), 12)
    (folder / "bodies.csv").write_text(vicon_bodies({"Probe": matrices, "Needle": matrices}, lost=(2,)))
    labels = [f"Probe:{i}" for i in range(4)]
    (folder / "markers.csv").write_text(vicon_markers(marker_places(matrices), labels, hidden={(1, 2)}))
    return [folder / "bodies.csv", folder / "markers.csv"]


def c3d_files(folder):
    places, labels = (
        marker_places(random_poses(np.random.default_rng(0), 12)),
        [f"Probe:{i}" for i in range(4)],
    )
    c3d_file(folder / "mm.c3d", places, labels, hidden={(1, 2)})
    c3d_file(folder / "m.c3d", places, labels, unit="m")
    return [folder / "mm.c3d", folder / "m.c3d"]


def dicoms(folder):
    ramp, planes = np.arange(256, dtype=np.uint8), [plane([0, 0, 0.5 * w]) for w in range(3)]
    region = {
        "PhysicalUnitsXDirection": 3,
        "PhysicalUnitsYDirection": 3,
        "PhysicalDeltaX": 0.02,
        "PhysicalDeltaY": 0.03,
    }
    dicom_file(folder / "a.dcm", images((3, 4, 5)), FrameTime="50", SequenceOfUltrasoundRegions=items(region))
    dicom_file(folder / "b.dcm", images((2, 4, 5)), **palette(ramp, ramp[::-1].copy(), ramp))
    volume_file(folder / "c.dcm", planes, images((3, 4, 5)))
    slices = {0x30011001: ("UL", 3), 0x30011003: ("FD", 0.1)}
    dicom_file(
        folder / "d.dcm", images((6, 4, 5)), private=slices, SOPClassUID=PHILIPS_CLASS, NumberOfFrames=2
    )
    return [folder / f"{name}.dcm" for name in "abcd"]


def kretz_volumes(folder):
    (folder / "a.vol").write_bytes(kretz_bytes(*some_toroid()))
    (folder / "b.vol").write_bytes(kretz_bytes(some_toroid()[0]))
    return [folder / "a.vol", folder / "b.vol"]


def pictures(folder):
    pillow = pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    forms = ("png", "tiff", "bmp", "jpeg")
    for form in forms:
        pillow.fromarray(images((1, 6, 8))[0]).save(folder / f"a.{form}", format=form)
    return [folder / f"a.{form}" for form in forms]


def videos(folder):
    av = pytest.importorskip("av", reason="PyAV is not installed")
    forms = {"mp4": "mpeg4", "mov": "mpeg4", "avi": "mpeg4", "matroska": "mpeg4"}
    made = []
    for form, codec in forms.items():
        content = io.BytesIO()
        with av.open(content, "w", format=form) as container:
            stream = container.add_stream(codec, rate=10)
            stream.width, stream.height, stream.pix_fmt = 32, 16, "yuv420p"
            for i in range(3):
                frame = av.VideoFrame.from_ndarray(np.full((16, 32, 3), 9 * i, np.uint8))
                container.mux(stream.encode(frame))
            container.mux(stream.encode())
        made.append(folder / f"a.{'mkv' if form == 'matroska' else form}")
        made[-1].write_bytes(content.getvalue())
    tracks = {"ProbeToTrackerTransform": {i / 10: "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1" for i in range(3)}}
    video_with_texts(folder / "plus.mkv", np.zeros((3, 16, 16), np.uint8), tracks)
    return [*made, folder / "plus.mkv"]


def rosbags(*forms):
    def make(folder):
        made = []
        for i, form in enumerate(forms):
            messages = messages_for(form)
            made.append(write_bag(folder / f"{i}.bag", form, messages, small_sweep(messages)))
        return made

    return make


def scenes(folder):
    pixels = random_pixels(np.random.default_rng(0), (3, 4, 5), "uint8")
    poses = random_poses(np.random.default_rng(0), 3)
    files = {
        "Image.seq.nrrd": image_sequence(range(3), pixels),
        "ProbeToTracker.seq.mha": transform_sequence("ProbeToTracker", range(3), poses),
    }
    constant = [("StylusTipToStylus", poses[0]), ("ProbeToTracker", poses[1]), ("LinearTransform", poses[2])]
    for name in ("a.mrb", "b.mrml"):
        write_scene(folder / name, files, scene_document(files, "Data/" if name == "a.mrb" else "", constant))
    return [folder / "a.mrb", folder / "b.mrml"]


def scans(folder):
    rng = np.random.default_rng(0)
    pixels = random_pixels(rng, (4, 5, 6), "uint8")
    for name, how in {"plain": {}, "packed": {"chunks": (1, 5, 6), "compression": "gzip"}}.items():
        write_scan(folder / f"{name}.h5", pixels, random_poses(rng, 4), **how)
    return [folder / "plain.h5", folder / "packed.h5"]


def write_scan(path, frames, transforms, **how):
    h5py = pytest.importorskip("h5py", reason="h5py is not installed")
    with h5py.File(path, "w") as file:
        file.create_dataset("frames", data=frames, **how)
        file.create_dataset("tforms", data=transforms)


def folders(folder):
    (folder / "images").mkdir()
    pictures(folder / "images")[0].rename(folder / "images" / "0.png")
    for other in ("a.tiff", "a.bmp", "a.jpeg"):
        (folder / "images" / other).unlink()
    (folder / "dicom").mkdir()
    dicom_file(folder / "dicom" / "0.dcm", images((4, 5)), AcquisitionTime="000000.25")
    return [folder / "images", folder / "dicom"]


# Of two checks, the line of one.
CHECKED = (
    b'{"checked":"2026-03-01T09:00:00+00:00","verdict":"holds","moved_mm":0.1,"turned_deg":0.2,"scale_change":0.0,'
    b'"p_value":0.5,"tolerance_mm":1.0,"power_mean":0.9,"power_least":0.2,"visible_mm":null,"rows":90,'
    b'"format":"sonocal-check","version":1}\n'
)


def files(**contents):
    """Makes files of these contents; an underscore in a name stands for the dot."""

    def make(folder):
        made = []
        for name, content in contents.items():
            made.append(folder / name.replace("_", "."))
            made[-1].write_bytes(content() if callable(content) else content)
        return made

    return make


def sightings(dimension):
    return lambda: observations_csv(simulate_observations(dimension, 5, seed=1).observations)


TFM = b"""#Insight Transform File V1.0
#Transform 0
Transform: AffineTransform_double_3_3
Parameters: 0 0.2 0 0 0 -0.2 -0.2 0 0 10 -20 30.5
FixedParameters: 0 0 0
"""
ROWS = ((0.0, 0.2, 0.0, 10.0), (0.0, 0.0, -0.2, -20.0), (-0.2, 0.0, 0.0, 30.5), (0.0, 0.0, 0.0, 1.0))


def matrix_text(between=" ", newline="\n"):
    return newline.join(between.join(map(repr, row)) for row in ROWS).encode()


def hdf5_transforms(folder):
    pytest.importorskip("h5py", reason="h5py is not installed")
    (folder / "a.h5").write_bytes(itk_h5(some_calibration()))
    (folder / "b.h5").write_bytes(slicer_h5(some_calibration()))
    return [folder / "a.h5", folder / "b.h5"]


def numpy_files(folder):
    np.save(folder / "a.npy", np.array(ROWS))
    np.savez(folder / "b.npz", ImageToProbe=np.array(ROWS), ProbeToTracker=np.eye(4), times=np.arange(9))
    np.savez_compressed(folder / "c.npz", np.array(ROWS, order="F"))
    return [folder / "a.npy", folder / "b.npz", folder / "c.npz"]


OLD_PAGE = b"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="generator" content="sonocal">
<title>Probe calibration: Use it</title></head><body></body></html>
"""


def study_results(folder):
    """Of a run that is done, and of one that goes on."""
    study = msgspec.structs.replace(load_study("needles", trials=2), factors={"needles": [5, 8]})
    done, begun = folder / "done", folder / "begun"
    with threads() as workers:
        store = run_study(study, done, workers)
    rows = summarise(store)
    (done / "summary.json").write_bytes(summary_json(store, rows))
    (done / "summary.csv").write_bytes(summary_csv(store.study, rows))
    Store(begun, study, "0")
    return [
        done / "summary.json",
        done / "summary.csv",
        done / "manifest.json",
        begun / "manifest.json",
        done,
    ]


SOUND = {
    "PLUS sequence metafile, MetaIO image": sequences(".mha", ".mhd"),
    "PLUS and Slicer NRRD sequence, NRRD image": sequences(".nrrd"),
    "CSV of poses": pose_tables,
    "OptiTrack Motive CSV": motive_tables,
    "Vicon CSV": vicon_exports,
    "NDI log": ndi_logs,
    "TUM trajectory": trajectories,
    "C3D": c3d_files,
    "video": videos,
    "ROS bag": rosbags("1", "1 lz4", "mcap file", "mcap zstd", "sqlite3 file", "sqlite3 message"),
    "Slicer scene": scenes,
    "TUS-REC scan": scans,
    "DICOM": dicoms,
    "GE Kretz volume": kretz_volumes,
    "image": pictures,
    "folder of images or of DICOM files": folders,
    "table of sightings": files(a_csv=sightings(2), b_csv=sightings(3)),
    "points found in images": files(a_csv=b"frame,u_px,v_px,sigma_px\n0,10.5,20,0.5\n7,1,2,0.5\n"),
    "points whose place is known": files(a_csv=KNOWN_POINTS, b_csv=TRACKED_POINTS),
    "calibration": files(a_json=lambda: calibration_json(some_calibration())),
    "results of a study": study_results,
    "truth of a simulated sweep": files(
        a_json=lambda: truth_json(simulate_sweep(curvilinear(64, 64, 1.5), BATH, SweepOptions(frames=3)))
    ),
    "log of checks": files(a_jsonl=CHECKED + CHECKED.replace(b"holds", b"changed")),
    "page of sonocal": files(a_html=lambda: report_html(some_calibration()), b_html=OLD_PAGE),
    "needles, wires, points, planes": files(
        a_toml=LINE.encode(),
        b_toml=POINT.encode(),
        c_toml=b"# mm\n\n" + (LINE + POINT).encode(),
        d_toml=(POINT + PLANE).encode(),
    ),
    "PLUS device set": files(
        a_xml=PHANTOM.encode(),
        c_xml=lambda: plus_xml(some_calibration()),
        b_xml=b'<?xml version="1.0"?>\n<!-- ours -->\n' + PHANTOM.encode(),
    ),
    "ITK and 3D Slicer transform, text": files(
        a_tfm=TFM,
        b_tfm=lambda: itk_tfm(some_calibration()),
        c_tfm=lambda: slicer_tfm(some_calibration()),
        d_tfm=TFM.replace(b"Affine", b"MatrixOffset").replace(b"Transform_d", b"TransformBase_d"),
    ),
    "ITK and 3D Slicer transform, HDF5": hdf5_transforms,
    "4 x 4 matrix as text": files(
        a_txt=matrix_text(),
        b_txt=matrix_text(", ") + b"\n",
        c_txt=b"# mm from px\nImageToProbe = [" + matrix_text("\t", ";\n") + b"];\n",
        d_txt=b"[[" + matrix_text(", ", "],\n [") + b"]]",
    ),
    "4 x 4 matrix of NumPy": numpy_files,
}


def sound_paths(folder):
    """Sound files of every format, each format's in a folder of its own: name -> paths."""
    made = {}
    for i, (name, make) in enumerate(SOUND.items()):
        home = folder / str(i)
        home.mkdir()
        made[name] = make(home)
    return made
