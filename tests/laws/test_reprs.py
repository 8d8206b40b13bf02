"""What a session shows of an object: one short line with units, whatever is in it and however much."""

import dataclasses
import importlib
import inspect
import itertools
import pkgutil
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sonocal as sc
from sonocal import igtl, live, studio
from sonocal.calibration import Options, fit_rows
from sonocal.detection import PointDetector, WallDetector
from sonocal.devices import Ndi, OptiTrack, Tracker, Video
from sonocal.errors import MirroredVolumeError
from sonocal.existing import Existing
from sonocal.findings import Diagnostic, Findings
from sonocal.geometry import AxisScaled, Similarity
from sonocal.geometry.shown import brief
from sonocal.reconstruction import Grid, LiveVolume
from sonocal.recording import ArrayFrames, Frames
from sonocal.recording.formats import GrowingSequence
from sonocal.registration import Registration, point_line, register
from sonocal.simulation.scene import simulate_observations
from sonocal.simulation.sweep import NEEDLE
from sonocal.studies import Store, load_study
from sonocal.studio.needle import Asked
from tests.builders.recordings import random_recording
from tests.builders.tracker_devices import FakeNdi

MOST = 400
LONG = "a\n\x1b[31m\U0001f600" * 500
ROWS = {dimension: simulate_observations(dimension, 12, seed=1).observations for dimension in (2, 3)}


def public_classes():
    """All classes of the package's face and of those of its rooms."""
    rooms = [module.name for module in pkgutil.walk_packages(sc.__path__, "sonocal.") if module.ispkg]
    faces = [
        importlib.import_module(name) for name in ("sonocal", "sonocal.errors", "sonocal.findings", *rooms)
    ]
    named = [getattr(face, name) for face in faces for name in getattr(face, "__all__", ())]
    return sorted(
        {one for one in named if inspect.isclass(one)}, key=lambda one: (one.__module__, one.__name__)
    )


CLASSES = public_classes()
BY_FIELDS = [one for one in CLASSES if one.__repr__ is brief]


def unopened(kind, **fields):
    """What would need a machine, with what its repr tells."""
    one = object.__new__(kind)
    vars(one).update(fields)
    return one


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    """Objects of every class that says in its own words what it is."""
    rows, finding = ROWS[2], Diagnostic(LONG, "warning", LONG, LONG)
    folder = tmp_path_factory.mktemp("a folder with a long name" * 8)
    errors = {
        one: one(
            LONG,
            *(
                [LONG]
                if one is sc.DegenerateGeometryError
                else [3]
                if issubclass(one, sc.NoConsensusError)
                else []
            ),
        )
        for one in CLASSES
        if issubclass(one, sc.SonocalError)
    }
    with igtl.Server() as server:
        client, session = igtl.Client("127.0.0.1", server.port), sc.sweep.Session([NEEDLE], name=LONG)
        with live.Live(client, session) as running:
            feed = studio.Feed(running, LONG, close=client.close)
            feed.close()
        client.close()
    points = np.column_stack([rows.points_px, np.zeros(len(rows))])
    frames = ArrayFrames(np.zeros((3, 4, 5), np.uint8))
    return {
        "table": rows,
        "feed": feed,
        "what a needle is found from": Asked(Path(LONG)),
        "live volume": LiveVolume(np.eye(4), name=LONG),
        "table of a volume": ROWS[3],
        "table of a long name": rows.with_sound(source=LONG),
        "calibration": sc.calibrate(rows),
        "calibration of two scales": sc.calibrate(rows, model="anisotropic"),
        "calibration of a volume": sc.calibrate(ROWS[3], image_size_px=(500, 500, 500)),
        "calibration that predicts nothing": dataclasses.replace(sc.calibrate(rows), covariance=None),
        "similarity": Similarity.identity(),
        "similarities": Similarity(np.tile(np.eye(3), (5, 1, 1)), np.zeros((5, 3)), np.ones(5)),
        "two scales": AxisScaled(np.eye(3), np.zeros(3), np.array([0.1, 0.2, 0.15])),
        "recording": random_recording(0, n=3, size=(5, 4)),
        "poses alone": dataclasses.replace(
            random_recording(0, n=3, size=(5, 4)), frames=sc.recording.frames.no_frames()
        ),
        "registration": register(point_line(points, rows.segments_mm)),
        "existing": Existing(LONG, LONG, LONG, np.eye(4), (finding,) * 50),
        "finding": finding,
        "findings": Findings([finding] * 50),
        "no findings": Findings(),
        "frames": frames,
        "some frames": frames[1:],
        "fit": fit_rows(rows, Options()),
        "report": sc.report.Report(b"x" * 10**6),
        "detector": PointDetector(np.ones((300, 200), dtype=bool)),
        "detector of walls": WallDetector(np.ones((300, 200), dtype=bool)),
        "volume": sc.Volume(
            np.zeros((3, 4, 5), np.uint8),
            Grid(np.zeros(3), np.ones(3), (5, 4, 3)),
            LONG,
            10**9,
            0,
            60,
            source=LONG,
        ),
        "server": server,
        "client": client,
        "server of PLUS": sc.igtl.PlusServer(client, LONG),
        "guide": live.Guide(sc.sweep.Session([NEEDLE], name=LONG)),
        "NDI": Ndi({}, LONG, api=FakeNdi({})),
        "OptiTrack": unopened(OptiTrack, _where=LONG, _names={}),
        "video": unopened(Video, _source=LONG),
        "growing": sc.recording.RecordingStream(LONG),
        "growing file": GrowingSequence(folder / "growing.mhd"),
        "session": session,
        "live": running,
        "pairing": live.Pairing(),
        "replay": live.Replay(random_recording(0, n=3, size=(5, 4))),
        "store": Store(folder, load_study("needles"), "0"),
        **errors,
    }


def test_no_public_class_is_left_out(shown):
    made = {type(one) for one in shown.values()} | set(BY_FIELDS)
    assert set(CLASSES) - made == {Frames, Tracker}, (
        "make one of it in `shown`"
    )  # which have no objects of their own
    assert len(CLASSES) > 50 < len(BY_FIELDS) + 20
    assert {Registration, MirroredVolumeError, sc.Line} <= set(CLASSES)


def test_a_repr_is_one_short_line(shown):
    for name, one in shown.items():
        assert repr(one).startswith(
            (f"<{type(one).__name__}", f"{type(one).__name__}('", "<SelectedFrames")
        ), name
        assert repr(one).isprintable(), name
        assert len(repr(one)) <= MOST, name


VALUES = st.recursive(
    st.one_of(
        st.none(),
        st.booleans(),
        st.integers(),
        st.floats(),
        st.text(max_size=5).map(lambda text: text * 999),
        st.integers(0, 60).map(np.zeros),
        st.integers(1, 6).map(lambda n: np.zeros((n,) * n, dtype=bool)),
        st.sampled_from(
            [ROWS[2], Diagnostic(LONG, "info", LONG, LONG), object(), LONG, np.float32(3), print]
        ),
    ),
    lambda inner: (
        st.lists(inner, max_size=5)
        | st.dictionaries(st.text(max_size=9), inner, max_size=5)
        | st.tuples(inner)
    ),
    max_leaves=8,
)


def fields_of(kind):
    if dataclasses.is_dataclass(kind):
        return [field.name for field in dataclasses.fields(kind)]
    return kind.__struct_fields__


@pytest.mark.parametrize("kind", BY_FIELDS, ids=lambda kind: f"{kind.__module__}.{kind.__name__}")
@settings(max_examples=8)
@given(st.data())
def test_a_repr_of_fields_is_one_short_line_whatever_they_hold(kind, data):
    drawn = data.draw(
        st.lists(VALUES, min_size=1, max_size=4)
    )  # in turn: one for each of many fields is slow
    values = dict(zip(fields_of(kind), itertools.cycle(drawn), strict=False))
    if dataclasses.is_dataclass(kind):  # as they are, unchecked
        one = object.__new__(kind)
        for name, value in values.items():
            object.__setattr__(one, name, value)
    else:
        one = kind(**values)
    assert re.match(rf"<{kind.__name__}[ >]", repr(one))
    assert repr(one).isprintable()
    assert len(repr(one)) <= MOST


def test_reprs_say_what_is_in_them(shown):
    assert (
        repr(shown["table"])
        == "<Observations of a 2D probe: 12 rows, 12 frames, 1 target, from 'simulation (seed 1)'>"
    )
    assert "mm/px, 12 of 12 rows, errors up to" in repr(shown["calibration"])
    assert "no error is predicted" in repr(shown["calibration that predicts nothing"])
    assert repr(shown["similarity"]) == "<Similarity: 1 mm/px, turned by 0.0 deg, origin at (0, 0, 0) mm>"
    assert repr(shown["two scales"]).startswith("<AxisScaled: 0.1 x 0.2 x 0.15 mm/px")
    line = sc.Line("needle", "Needle", np.array([[0, 0, 0], [0, 0, -333.0]]))
    assert repr(line) == "<Line name='needle', frame='Needle', segment_mm=array of 2 x 3>"
    assert repr(sc.recording.Lag(0.04, 0.001, 0.98, 200)) == (
        "<Lag latency_s=0.04, deviation_s=0.001, correlation=0.98, samples=200>"
    )


UNIT = re.compile(r"_(mm|px|s|ms|deg|hz|mm_per_px|nats)$")
# Numbers without a unit.
BARE = {
    "ratio",
    "size_ratio",
    "size_ratio_deviation",
    "confidence",
    "score",
    "correlation",
    "goal",
    "crossing",
    "outlier_share",
    "p_value",
    "f_statistic",
    "freedom",
    "level",
    "apart",
    "apart_95",
    "said_deviations",
    "said_chance",
    "shape_chance",
    "shape_excess",
    "scale_change",
    "power_mean",
    "power_least",
    # shares
    "share",
    "share_of_labels",
    "invalid",
    "gaps",
    "reordered",
}


def test_numbers_have_their_units_in_the_names_of_their_fields():
    for kind in (one for one in BY_FIELDS if one.__name__ != "Row"):  # whose quantity says it
        for name, of in kind.__annotations__.items():
            assert not re.match(r"float\b", str(of)) or UNIT.search(name) or name in BARE, (kind, name)
