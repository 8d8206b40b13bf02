"""A phantom put in place by dragging a stylus along its faces and edges: found whatever the order, refused by name."""

import numpy as np
import pytest
from benchmarks.drags import SETS, covered, off_mm, one, points_of, registered, targets_of
from benchmarks.simulators.drag_session import DIVOTS, EDGES, FACES, drag_session

from sonocal import DegenerateGeometryError, InputError, NoConsensusError, SonocalError
from sonocal.targets import Line, Plane, Point
from sonocal.tools.cliques import largest_cliques
from sonocal.tools.drags import find_drags
from sonocal.tools.features import features_of, free_motions

FULL = SETS["three faces, an edge, two divots"]
STEPS = [np.eye(4), np.array([[0, -1, 0, 30.0], [1, 0, 0, -400], [0, 0, 1, 900], [0, 0, 0, 1]])]


def session_of(seed, order=FULL, **options):
    times, poses, truth, _ = drag_session(np.random.default_rng(seed), order, **options)
    return times, poses, truth


@pytest.mark.parametrize("seed", [0, 2])
@pytest.mark.parametrize("name", ["three faces, an edge, two divots", "two edges, three divots"])
def test_drags_and_touches_in_any_order_put_the_phantom_in_place(name, seed):
    found, truth, spans = one(seed, SETS[name])
    assert off_mm(found, truth).max() < 1.0
    six, ends = covered(found, truth)
    assert six.sum() >= 4
    assert ends.all()
    # Every drag lies where the stylus went along that line or plane.
    where = {name: (first, last) for name, first, last in spans}
    for along in found.features:
        for first, last in along.frames:
            a, b = where[along.name]
            assert a - 12 <= first < last <= b + 12


def test_moving_everything_moves_the_place_with_it():
    times, poses, _ = session_of(2)
    here, there = (registered(times, step @ poses, targets_of(FULL)) for step in STEPS)
    np.testing.assert_allclose(
        there.reference_from_phantom, STEPS[1] @ here.reference_from_phantom, atol=1e-6
    )
    np.testing.assert_allclose(
        here.target_errors[0].within_95_mm, there.target_errors[0].within_95_mm, rtol=1e-6
    )


def test_moving_the_phantoms_frame_moves_the_place_against_it():
    times, poses, _ = session_of(2)
    step = STEPS[1]
    moved = [
        type(one)(one.name, one.frame, one.spanning_mm @ step[:3, :3].T + step[:3, 3])
        for one in targets_of(FULL)
    ]
    points = points_of(DIVOTS @ step[:3, :3].T + step[:3, 3])
    here = registered(times, poses, targets_of(FULL))
    there = registered(times, poses, moved, points)
    np.testing.assert_allclose(there.reference_from_phantom @ step, here.reference_from_phantom, atol=1e-5)


@pytest.mark.parametrize(
    ("names", "motions"),
    [
        (("front",), 3),
        (("front", "back"), 3),
        (("left", "roof"), 1),
        (("left edge",), 2),
        (("left edge", "roof"), 1),
        (("left", "front", "roof"), 0),
        (("left edge", "front edge"), 0),
    ],
)
def test_motions_that_stay_free_are_counted_and_change_nothing(names, motions):
    features = features_of([], targets_of(names))
    assert len(free_motions(features)) == motions


def test_a_phantom_that_may_slide_is_refused_with_where_to():
    times, poses, _ = session_of(0, ("left", "roof"))
    with pytest.raises(
        DegenerateGeometryError,
        match=r"by left, roof alone the phantom is free: it may slide along \(0.00, 1.00",
    ) as caught:
        registered(times, poses, targets_of(("left", "roof")), [])
    assert caught.value.code == "phantom-free"
    # Though another face is named that was never dragged along.
    with pytest.raises(DegenerateGeometryError, match="by left, roof alone the phantom is free"):
        registered(times, poses, targets_of(("left", "roof", "front")), [])


def test_a_symmetric_block_tells_no_order_unless_it_is_said():
    names = SETS["four faces"]
    times, poses, truth = session_of(1, names)
    with pytest.raises(DegenerateGeometryError, match="fits the phantom in 2 ways") as caught:
        registered(times, poses, targets_of(names), [])
    assert caught.value.code == "landmarks-ambiguous"
    found = registered(times, poses, targets_of(names), [], in_order=True)
    assert off_mm(found, truth).max() < 1.5


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        (lambda places: places * [1, 1, -1], NoConsensusError, "of the mirrored phantom"),
        (
            lambda places: places / 1000,
            InputError,
            "in metres; give the phantom in mm: multiply its places by 1000",
        ),
        (
            lambda places: places @ np.diag([1.6, 0.4, 3.0]),
            SonocalError,
            "lines and planes fit what the|fits the phantom in",
        ),
    ],
)
def test_a_phantom_that_is_wrong_is_refused_by_what_is_wrong(change, error, words):
    times, poses, _ = session_of(2)
    wrong = [type(one)(one.name, one.frame, change(one.spanning_mm)) for one in targets_of(FULL)]
    with pytest.raises(error, match=words):
        registered(times, poses, wrong, points_of(change(DIVOTS)))


def test_a_face_that_lies_off_is_left_out_and_named():
    times, poses, truth = session_of(2)
    wrong = [
        Plane("roof", "Phantom", FACES["roof"] + [0, 0, 2.0]) if one.name == "roof" else one
        for one in targets_of(FULL)
    ]
    found = registered(times, poses, wrong)
    assert [one.name for one in found.features if not one.used] == ["roof"]
    assert "landmark-off" in [finding.code for finding in found.diagnostics]
    assert off_mm(found, truth).max() < 1.5


def test_what_is_named_to_drag_along_must_be_of_the_phantom():
    times, poses, _ = session_of(2)
    with pytest.raises(InputError, match="nothing is named that the stylus was dragged along"):
        registered(times, poses, [])
    with pytest.raises(InputError, match="in the frames Phantom and Other"):
        registered(times, poses, [*targets_of(FULL), Line("more", "Other", EDGES["left edge"])])
    with pytest.raises(InputError, match="dragged along lines and planes; got"):
        registered(times, poses, [Point("a", "Phantom", [0, 0, 0])])


def test_a_stylus_that_rests_is_dragged_along_nothing():
    times, poses, _ = session_of(0, (0, 1, 2, 3), false=0)
    with pytest.raises(SonocalError, match=r"nothing straight or flat|the phantom is free|fits? (the|what)"):
        registered(times, poses, targets_of(("front", "left", "roof")), [])


def test_drags_are_found_where_they_are():
    rng = np.random.default_rng(0)
    times = np.arange(300) / 20
    sway = np.sin(2 * np.pi * times / 3)
    places = np.column_stack([40 * sway, 0 * sway, 0 * sway])
    places[150:, 1] = 25 * np.cos(2 * np.pi * times[150:] / 1.7)
    places[150:, 2] = 60
    found = find_drags(places + rng.normal(0, 0.2, places.shape), times)
    assert [one.kind for one in found] == ["line", "plane"]
    assert (found[0].first, found[0].last) == (pytest.approx(0, abs=4), pytest.approx(149, abs=4))
    assert (found[1].first, found[1].last) == (pytest.approx(150, abs=4), pytest.approx(299, abs=4))
    assert np.degrees(np.arccos(abs(found[1].axes[2, 2]))) < 1.0


def test_cliques_are_those_of_a_graph_that_one_can_see():
    joined = np.zeros((6, 6), dtype=bool)
    for a, b in [(0, 1), (1, 2), (0, 2), (2, 3), (3, 4), (4, 5), (3, 5)]:
        joined[a, b] = joined[b, a] = True
    found = [tuple(sorted(one)) for one in largest_cliques(joined, range(6), 9)]
    assert sorted(found) == [(0, 1, 2), (2, 3), (3, 4, 5)]
    assert len(found[0]) == 3
    assert len(found[-1]) == 2
