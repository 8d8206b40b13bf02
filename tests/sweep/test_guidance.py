"""Laws of the next pose to hold: what is said is what is meant, and holding it tells most."""

from functools import lru_cache
from xml.etree import ElementTree

import numpy as np
import pytest

import sonocal as sc
from sonocal import InputError, UnsupportedError
from sonocal.geometry import Similarity
from sonocal.simulation.scene import simulate_observations
from sonocal.sweep.guidance import Reach, first_holds, holds_met, next_holds
from sonocal.sweep.hold import Hold, held

SIZE = (500, 400)


@lru_cache
def calibrated(needles=30, seed=1):
    return sc.calibrate(simulate_observations(needles=needles, seed=seed).observations)


def hold(place=(100.0, 300.0), tilt=30.0, around=0.0, side=1, scale=0.2):
    return Hold(place, tilt, around, side, SIZE, scale)


def segment_of(one, transform, length_mm=200.0):
    """A needle held as asked, its hub second."""
    crossing = transform @ np.array([one.place_px])
    along = transform.rotation @ one.direction
    return crossing + np.array([[-length_mm / 3], [length_mm]]) * along


@pytest.mark.parametrize(
    "one, words",
    [
        (
            hold(around=0.0),
            "tilt 30 degrees to the marked side, 6 cm deep, 3 cm to the unmarked side",
        ),
        (
            hold((400.0, 100.0), 60, 270.0),
            "tilt 60 degrees towards the probe, 2 cm deep, 3 cm to the marked side",
        ),
        (hold((250.0, 20.0), 2.0), "straight through the image, 4 mm deep, in the middle"),
        (
            hold((100.0, 300.0), scale=None, around=130.0),
            "tilt 30 degrees to the unmarked side and away from the probe, 75 % of the image deep, "
            "30 % of the image to the unmarked side",
        ),
    ],
)
def test_words(one, words):
    assert one.words == words


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("seed", range(5))
def test_a_needle_that_is_held_as_asked_misses_by_nothing(seed, side):
    rng = np.random.default_rng(seed)
    transform = calibrated(seed=2).probe_from_image
    one = hold(tuple(rng.uniform(0, 400, 2)), rng.uniform(5, 70), rng.uniform(0, 360), side)
    now = held(transform, segment_of(one, transform), SIZE)
    np.testing.assert_allclose(one.misses(now), 0, atol=1e-3)
    assert now.side == side
    assert now.around_deg == pytest.approx(one.around_deg, abs=1e-6)
    assert held(transform, segment_of(one, transform)[::-1], SIZE, hub=0).side == side


def test_a_needle_that_is_lost_or_along_the_image_is_held_nowhere():
    identity = Similarity(np.eye(3), np.zeros(3), 0.2)
    assert held(identity, np.full((2, 3), np.nan), SIZE) is None
    assert held(identity, np.array([[0.0, 0, 1], [10, 0, 1]]), SIZE) is None


def test_the_sketch_and_the_picture_show_it():
    one = hold((400.0, 100.0), 45.0, 90.0)
    rows = one.sketch(hold((20.0, 380.0))).splitlines()
    assert len({len(row) for row in rows}) == 1
    ((row, column),) = [(i, line.index("x")) for i, line in enumerate(rows) if "x" in line]
    assert rows[row + 1][column] == "↓"
    assert rows[-2][2] == "o"
    picture = ElementTree.fromstring(one.svg(hold()))
    assert picture[0].text == one.words
    assert len(picture.findall(".//{*}circle")) == 2


def test_the_first_poses_are_apart_and_within_reach():
    reach = Reach(most_tilt_deg=30.0)
    holds = first_holds(SIZE, count=8, reach=reach)
    assert all(one.tilt_deg <= 30.0 and one.scale_mm_per_px is None for one in holds)
    assert len({(one.place_px, one.tilt_deg, one.around_deg) for one in holds}) == 8
    assert len({(one.place_px[0] > 250, one.place_px[1] > 200) for one in holds[:5]}) == 4


def test_holding_what_is_asked_makes_a_calibration_surer_than_other_poses():
    found = calibrated()
    truth = found.probe_from_image
    (asked,) = next_holds(found)
    rng = np.random.default_rng(0)
    rows = simulate_observations(needles=30, seed=1).observations

    def expected(one):
        segments = np.array([segment_of(one, truth)] * 5)
        points = np.array([one.place_px] * 5)
        more = sc.Observations(
            np.vstack([rows.points_px, points]),
            np.vstack([rows.segments_mm, segments]),
            image_size_px=(500, 500),
        )
        return np.linalg.slogdet(sc.calibrate(more).covariance)[1]

    others = [
        Hold(tuple(rng.uniform(0, 499, 2)), rng.uniform(0, 60), rng.uniform(0, 360), 1, (500, 500))
        for _ in range(6)
    ]
    assert expected(asked) < min(expected(one) for one in others)


def test_places_where_the_image_shows_nothing_are_not_asked_for():
    mask = np.zeros((500, 500), dtype=bool)
    mask[200:400, 100:300] = True
    for one in next_holds(calibrated(), count=6, reach=Reach(mask=mask)):
        u, v = one.place_px
        assert mask[round(v), round(u)]


def test_poses_that_were_held_are_counted_in_their_order():
    found = calibrated()
    reach = Reach()
    holds = next_holds(found, count=3, reach=reach)
    transform = found.probe_from_image
    segments = np.array([segment_of(one, transform) for one in holds])
    lost = np.full((1, 2, 3), np.nan)
    assert holds_met(holds, transform, segments, reach) == 3
    assert holds_met(holds, transform, np.concatenate([lost, segments[:1], lost]), reach) == 1
    assert holds_met(holds, transform, segments[1:][::-1], reach) <= 1
    assert holds_met(holds, transform, lost, reach) == 0


def test_the_scale_of_the_image_and_the_marker_do_not_matter():
    small = first_holds((250, 200), count=4, reach=Reach(miss_px=12.5))
    large = first_holds((500, 400), count=4, reach=Reach(miss_px=25.0))
    assert [(one.tilt_deg, one.around_deg) for one in small] == [
        (one.tilt_deg, one.around_deg) for one in large
    ]


@pytest.mark.parametrize(
    "call, sentence",
    [
        (lambda: Reach(most_tilt_deg=90), "most_tilt_deg must be from 5 to 80 degrees; got 90"),
        (lambda: Reach(miss_px=-1), "a hand misses by 0 px or more"),
        (lambda: Reach(side=0), "side must be 1 or -1; got 0"),
        (lambda: Reach(mask=np.zeros((3, 3), bool)), "some pixels that are True"),
        (lambda: next_holds(calibrated(), count=0), "count must be a whole number from 1 to 1000; got 0"),
        (lambda: first_holds((1, 5)), r"image_size_px must be \(width, height\)"),
        (lambda: next_holds("calibration.json"), "found must be"),
    ],
)
def test_what_means_nothing_is_refused(call, sentence):
    with pytest.raises(InputError, match=sentence):
        call()


def test_a_volume_shows_the_whole_needle():
    found = sc.calibrate(simulate_observations(3, seed=1).observations)
    with pytest.raises(UnsupportedError, match="keep it moving"):
        next_holds(found)
