"""The files that commands on the documentation's pages name, small enough to be worked on in seconds."""

import shutil
from dataclasses import replace

import numpy as np
from benchmarks.phantom_places import table as phantom_table
from benchmarks.phantom_places import wires_of
from benchmarks.simulators.phantom_sweep import THREE, phantom_sweep
from benchmarks.simulators.stepper import stepper

import sonocal as sc
from sonocal.detection import Detections
from sonocal.geometry import Similarity
from sonocal.recording import Poses, Recording
from sonocal.recording.formats import write_recording
from sonocal.simulation.scene import simulate_observations
from sonocal.simulation.sweep import SweepOptions, simulate_sweep
from sonocal.simulation.sweep_files import write_sweep
from sonocal.simulation.ultrasound import BATH
from sonocal.simulation.ultrasound_probe import curvilinear
from sonocal.sweep.placed import placed_rows
from sonocal.sweep.tabulate import Posing
from sonocal.targets import Unplaced, lines_toml
from tests.builders.phantoms import write_drags, write_session, write_touches
from tests.builders.recordings import random_poses
from tests.builders.tank import resting_in_room
from tests.builders.tracked_tools import AXIS, TIP, pivoting, spinning

DEVICES = """<PlusConfiguration version="2.9">
  <CoordinateDefinitions>
    <Transform From="Phantom" To="Reference" Matrix="1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1" />
  </CoordinateDefinitions>
</PlusConfiguration>
"""
STYLUS = f'[[point]]\nname = "tip"\nframe = "Stylus"\nat_mm = {TIP.tolist()}\n'


def write_files(folder):
    """A sweep and its points, tables of sightings and of points, tools' recordings, a device set, a calibration."""
    write_swept(folder)
    write_tables(folder)
    write_phantom(folder)
    write_tools(folder)
    write_tank(folder)
    write_touches(folder)
    write_drags(folder)
    write_session(folder)
    (folder / "devices.xml").write_text(DEVICES)
    (folder / "stylus.toml").write_text(STYLUS)


def write_swept(folder):
    options = SweepOptions(frames=60, rate_hz=8, sigma_px=0.5, sigma_mm=0.3, seed=2)
    sweep = simulate_sweep(curvilinear(250, 250, 0.48), BATH, options)
    write_sweep(sweep, folder)
    frames = np.flatnonzero(sweep.truth.visible)
    rows = [f"{i},{u},{v}" for i, (u, v) in zip(frames, sweep.truth.points_px[frames], strict=True)]
    (folder / "points.csv").write_text("\n".join(["frame,u_px,v_px", *rows]) + "\n")
    numbers = " ".join(map(str, sweep.truth.probe_from_image.matrix.ravel().tolist()))
    matrix = f'<Transform From="Image" To="Probe" Matrix="{numbers}" />\n'
    (folder / "calibrated.xml").write_text(DEVICES.replace("  </Coord", f"    {matrix}  </Coord"))


def write_tank(folder):
    """A thread in the room that nobody placed, in a recording and in a table of points and poses."""
    options = SweepOptions(
        frames=90, rate_hz=8, sigma_px=0.5, sigma_mm=0.3, hidden_share=0.0, compact=0.3, seed=2
    )
    sweep = simulate_sweep(curvilinear(250, 250, 0.48), BATH, options)
    recording = resting_in_room(sweep.recording)
    write_recording(recording, folder / "tank.igs.mha")
    (folder / "thread.toml").write_text('[[line]]\nname = "thread"\nframe = "Tracker"\nplace = "unknown"\n')
    seen = np.flatnonzero(sweep.truth.visible)
    points = Detections.of_points(seen, sweep.truth.shown_px[seen])
    rows = placed_rows(recording, [Unplaced("line", "thread", "Tracker")], points, Posing())
    sc.write_observations(rows, folder / "tank.csv")


def write_phantom(folder):
    """A sweep of a phantom of known shape that stands anywhere, as a table of its dots by the wires' names."""
    scene = phantom_sweep(1, THREE, frames=40, tilt_deg=40, turn_deg=40)
    sc.write_observations(phantom_table(scene), folder / "phantom.csv")
    (folder / "placeless.toml").write_bytes(lines_toml("placeless.toml", (), unplaced=wires_of(THREE)))


def write_tables(folder):
    """Sightings of which a third is to be held out, an earlier calibration of the same probe, a cross-wire."""
    scene = simulate_observations(2, 30, seed=3)
    split = np.where(np.arange(30) % 3 == 0, "test", "fit")
    sc.write_observations(replace(scene.observations, split=split), folder / "needle.csv")
    cal = sc.calibrate(simulate_observations(2, 30, seed=4).observations)
    for path in ("calibration.json", "earlier/calibration.json"):
        (folder / path).parent.mkdir(exist_ok=True)
        cal.save(folder / path)
    (folder / "crosswire.csv").write_text(crosswire_csv(scene.probe_from_image))


def crosswire_csv(probe_from_image: Similarity, count=12):
    """A fixed point that a moving probe sees at places all over its image."""
    rng = np.random.default_rng(0)
    pixels, poses = rng.uniform(50, 450, (count, 2)), random_poses(rng, count)
    poses[:, :3, 3] = -np.einsum("nij,nj->ni", poses[:, :3, :3], probe_from_image @ pixels)
    header = ["frame", "target", "u_px", "v_px", *(f"probe_{i}{j}" for i in range(3) for j in range(4))]
    rows = [[i, "wire", *pixels[i], *poses[i, :3].ravel()] for i in range(count)]
    return "\n".join(",".join(map(str, row)) for row in [header, *rows]) + "\n"


def write_tools(folder):
    """Two pivots and a spin of a needle, and a stylus that touches two places of it."""
    rng = np.random.default_rng(0)
    write_poses(folder / "pivot.igs.mha", Needle=pivoting(rng))
    write_poses(folder / "stylus.igs.mha", Stylus=pivoting(rng))
    write_poses(folder / "other.igs.mha", Needle=pivoting(rng, tip=TIP + 100 * AXIS))
    write_poses(folder / "spin.igs.mha", Needle=spinning(rng))
    turned, moved, _ = stepper(1)
    write_poses(folder / "turned.igs.mha", Probe=turned)
    write_poses(folder / "moved.igs.mha", Probe=moved)
    stylus = pivoting(rng, n=140, noise_mm=0.05)
    touched = np.array([[5.0, -3.0, -20.0], [6.0, -2.0, -140.0]])
    stylus[:, :3, 3] += touched[(np.arange(140) >= 65).astype(int)] - [100, -50, -1000]
    write_poses(folder / "touch.igs.mha", Needle=np.tile(np.eye(4), (140, 1, 1)), Stylus=stylus)


def write_poses(path, **tools):
    poses = [Poses.of(tool, "Tracker", matrices) for tool, matrices in tools.items()]
    write_recording(Recording(times=np.arange(len(poses[0])) / 20, poses={p.name: p for p in poses}), path)


def copy_of(files, folder):
    """A copy of them to work in; what else is in the folder stays."""
    shutil.copytree(files, folder, dirs_exist_ok=True)
    return folder
