"""A phantom with landmarks as PLUS's users have it, and a session in which they are touched."""

import numpy as np
from benchmarks.simulators.drag_session import DIVOTS, EDGES, FACES, drag_session
from benchmarks.simulators.landmark_session import EIGHT, TIP, session
from benchmarks.simulators.tool_sessions import session as tool_session

from sonocal.recording import Poses, Recording
from sonocal.recording.formats import write_recording
from sonocal.targets import Line, Plane, Point, lines_toml

WIRES = '<Pattern Type="NWire"><Wire Name="a" EndPointFront="30 0 20" EndPointBack="30 40 20"/></Pattern>'


def device_set(landmarks=EIGHT, tip=TIP):
    places = "".join(
        f'<Landmark Name="#{i + 1}" Position="{" ".join(map(str, x))}"/>' for i, x in enumerate(landmarks)
    )
    matrix = " ".join(f"{x} " for x in np.vstack([np.column_stack([np.eye(3), tip]), [0, 0, 0, 1]]).ravel())
    return (
        "<PlusConfiguration>\r\n  <CoordinateDefinitions>\r\n"
        f'    <Transform From="StylusTip" To="Stylus"   Matrix="{matrix}"/>\r\n  </CoordinateDefinitions>\r\n'
        f"<PhantomDefinition><Geometry>{WIRES}<Landmarks>{places}</Landmarks></Geometry></PhantomDefinition>"
        "<!-- kept -->\r\n</PlusConfiguration>\r\n"
    )


def write_session(folder):
    """``session.igs.mha``: several tools, pivoted, spun, touched and moved one after the other."""
    made = tool_session(3, touches=1)
    poses = [Poses.of(tool, "Tracker", one) for tool, one in made.poses.items()]
    write_recording(Recording(made.times, poses={one.name: one for one in poses}), folder / "session.igs.mha")


def write_touches(folder):
    """``touches.igs.mha`` and ``phantom.xml``; gives where the phantom is."""
    times, poses, truth, _ = session(np.random.default_rng(11), seconds=(1.5, 3.0), lost=0.0)
    pose = Poses.of("Stylus", "Reference", poses)
    write_recording(Recording(times, poses={pose.name: pose}), folder / "touches.igs.mha")
    (folder / "phantom.xml").write_bytes(device_set().encode())
    return truth


def write_drags(folder):
    """``drags.igs.mha`` and ``block.toml``; gives where the block is."""
    order = ("front", "left", "roof", "left edge", 0, 1)
    times, poses, truth, _ = drag_session(np.random.default_rng(2), order, lost=0.0)
    pose = Poses.of("Stylus", "Reference", poses)
    write_recording(Recording(times, poses={pose.name: pose}), folder / "drags.igs.mha")
    planes = [Plane(name, "Block", FACES[name]) for name in ("front", "left", "roof")]
    points = [Point(f"#{i + 1}", "Block", place) for i, place in enumerate(DIVOTS)]
    lines = [Line("left edge", "Block", EDGES["left edge"])]
    (folder / "block.toml").write_bytes(lines_toml("block.toml", lines, points, planes=planes))
    return truth
