"""What must not change the findings; and the fast sums against slow ones that are easy to believe."""

import dataclasses

import numpy as np
import pytest
from benchmarks.simulators.faults import altered
from benchmarks.simulators.scans import scan
from benchmarks.slow_hand import PX, SCALE, found_in, noisy_rows, slow_sweep
from hypothesis import given, reject, settings
from hypothesis import strategies as st

import sonocal as sc
from sonocal.calibration import evidence_of
from sonocal.calibration.mixed import mapped_of
from sonocal.observations import group_codes
from sonocal.registration.noise import stretch_length
from sonocal.setup_checks import Evidence, check_latency, check_setup, check_slip
from sonocal.setup_checks import slip as slip_module
from sonocal.setup_checks.latency import latency_of
from sonocal.setup_checks.motion import motion_of
from sonocal.setup_checks.slip import LEAST_SHRINKING, LEAST_SLIP_MM, ORDERS, _ChangePoint
from sonocal.simulation.scene import simulate_observations
from tests.builders.calibrations import slipped_rows
from tests.builders.similarities import random_similarity

seeds = st.integers(0, 2_000)
faults = st.sampled_from(["sound", "slip", "late"])
OVER_TIME = ("marker-slipped", "latency")


def as_it_stands(rows):
    """Rows over time, with nothing taken off for noise, as slow sums have them."""
    return dataclasses.replace(motion_of(evidence(rows)), pull_by_noise=None)


def rows_of(seed, fault, frames=60, outliers=0.03):
    if fault == "slip":
        rng = np.random.default_rng(seed)
        turn, shift = rng.normal(size=(2, 3))
        slip = (np.radians(2) * turn / np.linalg.norm(turn), 4 * shift / np.linalg.norm(shift))
        return scan(
            seed, frames=frames, slip=slip, slip_at=rng.uniform(0.35, 0.65), outliers=outliers
        ).observations
    latency_s = 0.1 if fault == "late" else 0.0
    return scan(seed, frames=frames, latency_s=latency_s, outliers=outliers).observations


def calibrated(rows, **options):
    """The calibration; a scan so faulty that it is refused says nothing of the checks."""
    try:
        return sc.calibrate(rows, **options)
    except (sc.NoConsensusError, sc.DegenerateGeometryError):
        reject()


def evidence(rows, **options):
    return evidence_of(calibrated(rows, **options), rows)


def over_time(findings):
    return [finding.message for finding in findings if finding.code in OVER_TIME]


# Invariance


@settings(max_examples=10)
@given(seeds, faults)
def test_moving_the_probe_marker_changes_no_finding(seed, fault):
    rows, marker = rows_of(seed, fault), random_similarity(seed, scale=1.0)
    found = calibrated(rows)
    carried = dataclasses.replace(found, probe_from_image=marker @ found.probe_from_image)
    moved = altered(rows, segments_mm=marker @ rows.segments_mm)
    ours, theirs = check_setup(evidence_of(found, rows)), check_setup(evidence_of(carried, moved))
    assert [one.code for one in ours] == [one.code for one in theirs]


@settings(max_examples=10)
@given(seeds, faults)
def test_the_order_of_the_rows_changes_no_finding(seed, fault):
    rows = rows_of(seed, fault)
    shuffled, found = rows.select(np.random.default_rng(seed).permutation(len(rows))), calibrated(rows)
    ours, theirs = (over_time(check_setup(evidence_of(found, part))) for part in (rows, shuffled))
    assert ours == theirs


# In a clock of much longer or shorter units lags would be longer than are looked for, or too short to matter.
@settings(max_examples=10)
@given(seeds, faults, st.floats(0.25, 2.5), st.floats(-1e4, 1e4))
def test_the_clocks_unit_and_start_change_no_more_than_its_words(seed, fault, unit, start):
    rows = rows_of(seed, fault)
    time = np.array([repr(float(text) * unit + start) for text in rows.extra["time_s"]])
    one, other = (motion_of(evidence(part)) for part in (rows, altered(rows, extra={"time_s": time})))
    np.testing.assert_allclose(latency_of(other), unit * latency_of(one), rtol=1e-3, atol=1e-6 * unit)
    assert bool(over_time(check_setup(evidence(rows)))) == bool(
        over_time(check_setup(evidence(altered(rows, extra={"time_s": time}))))
    )


@settings(max_examples=10)
@given(seeds, faults)
def test_renumbered_frames_change_no_more_than_the_number_said(seed, fault):
    rows = altered(rows_of(seed, fault), extra={})
    found = [check_setup(evidence(part)) for part in (rows, altered(rows, frame=rows.frame + 1000))]
    assert [one.code for one in found[0]] == [one.code for one in found[1]]


@settings(max_examples=10)
@given(seeds, faults)
def test_reversed_segments_and_another_split_name_change_no_finding(seed, fault):
    rows = rows_of(seed, fault)
    turned = altered(rows, segments_mm=rows.segments_mm[:, ::-1], split=np.full(len(rows), "a"))
    found = calibrated(rows)
    ours, theirs = (over_time(check_setup(evidence_of(found, part))) for part in (rows, turned))
    assert ours == theirs


@settings(max_examples=10)
@given(seeds, faults)
def test_the_same_seed_finds_the_same(seed, fault):
    one = evidence(rows_of(seed, fault))
    assert check_setup(one, seed=3) == check_setup(one, seed=3)


# What calibrate() carries


@settings(max_examples=10)
@given(seeds, st.sampled_from([2, 3]), faults)
def test_calibrate_carries_what_the_checks_find(seed, dimension, fault):
    rows = rows_of(seed, fault) if dimension == 2 else scan(seed, dimension=3).observations
    found = calibrated(rows)
    findings = check_setup(evidence_of(found, rows))
    assert [one for one in found.diagnostics if one in findings] == sorted(
        findings, key=lambda one: one.severity != "warning"
    )


def test_calibrate_tells_the_checks_what_it_is_told():
    rows = simulate_observations(2, 40, seed=5).observations
    upside_down = altered(rows, points_px=[0, 500] + rows.points_px * np.array([1, -1]))
    mirrored = calibrated(rows).probe_from_image.rotation @ np.diag([-1.0, 1, -1])
    codes = [
        [d.code for d in calibrated(part, **known).warnings]
        for part, known in (
            (rows, {}),
            (rows, {"scanner_mm_per_px": 0.3}),
            (rows, {"expected_rotation": mirrored}),
            (upside_down, {}),
        )
    ]
    assert codes == [[], ["scale-differs-from-scanner"], ["flipped-image"], []]


@pytest.mark.parametrize(
    ("degrees", "code"), [(30, None), (90, "unexpected-orientation"), (170, "flipped-image")]
)
def test_only_turns_near_a_flip_are_called_one(degrees, code):
    rows = simulate_observations(2, 40, seed=5).observations
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turn = np.array([[1, 0, 0], [0, cosine, -sine], [0, sine, cosine]])
    expected = calibrated(rows).probe_from_image.rotation @ turn
    found = calibrated(rows, expected_rotation=expected).warnings
    assert [one.code for one in found] == ([] if code is None else [code])


@pytest.mark.parametrize("count", [4, 5, 8, 15, 16])
@pytest.mark.parametrize("sigma", [0.0, 1.0])
def test_few_rows_and_rows_without_noise_are_no_obstacle(count, sigma):
    rows = simulate_observations(2, count, sigma_px=sigma, sigma_mm=sigma, seed=3).observations
    assert not over_time(calibrated(rows).diagnostics)


def test_needles_that_stand_still_have_no_velocity_and_no_latency():
    rows = rows_of(0, "sound")
    still = altered(rows, extra={"time_s": np.full(len(rows), "1.0")})
    motion = motion_of(evidence(still))
    assert not motion.usable.any()
    assert latency_of(motion) == 0.0
    assert not list(check_latency(evidence(still)))


# Against slow sums


def slow_velocities(rows, mapped):
    """One needle after the other, one sighting after the other."""
    velocity, usable = np.zeros((len(rows), 3)), np.zeros(len(rows), dtype=bool)
    time = rows.extra["time_s"].astype(float)
    for split, target in {(str(s), str(t)) for s, t in zip(rows.split, rows.target, strict=True)}:
        index = [i for i in range(len(rows)) if (rows.split[i], rows.target[i]) == (split, target)]
        index.sort(key=lambda i: time[i])
        for before, here, after in zip(index, index[1:], index[2:], strict=False):
            start, end = rows.segments_mm[here]
            length = np.linalg.norm(end - start)
            along = (end - start) / length
            share = (mapped[here] - start) @ along / length
            change = (rows.segments_mm[after] - rows.segments_mm[before]) / (time[after] - time[before])
            moved = (1 - share) * change[0] + share * change[1]
            velocity[here], usable[here] = moved - (moved @ along) * along, True
    return velocity, usable


@given(seeds, st.integers(1, 4), st.integers(1, 2))
def test_velocities_are_those_of_each_needles_neighbouring_sightings(seed, targets, splits):
    rows, rng = rows_of(seed, "sound", frames=40, outliers=0.0), np.random.default_rng(seed)
    rows = altered(
        rows,
        target=rng.integers(0, targets, len(rows)).astype(str),
        split=rng.integers(0, splits, len(rows)).astype(str),
    )
    one = evidence(rows)
    motion = motion_of(one)
    velocity, usable = slow_velocities(rows, one.transform @ rows.points_px)
    np.testing.assert_array_equal(motion.usable, usable[motion.rows])
    np.testing.assert_allclose(motion.velocity, velocity[motion.rows], atol=1e-8)


@given(seeds, faults)
def test_a_latency_is_the_least_squares_one(seed, fault):
    motion = as_it_stands(rows_of(seed, fault))
    j, v = motion.jacobian[motion.usable], motion.velocity[motion.usable]
    columns = np.concatenate([j, v[:, :, None]], axis=2).reshape(-1, motion.parameters + 1)
    scale = np.linalg.norm(columns, axis=0)
    solved = np.linalg.lstsq(columns / scale, motion.residuals[motion.usable].ravel(), rcond=None)[0] / scale
    assert latency_of(motion) == pytest.approx(solved[-1], rel=1e-5, abs=1e-9)


def slow_explained(motion, frame, split, latency):
    """Squares that a step at a split explains, frames renumbered: by two fits of all rows."""
    j, r = motion.jacobian, (motion.residuals - latency * motion.velocity).ravel()
    late = (frame >= split)[:, None, None]
    whole = np.concatenate([j, np.where(late, j[:, :, :6], 0.0)], axis=2).reshape(len(r), -1)

    def left(columns):
        columns = columns / np.linalg.norm(columns, axis=0)
        return np.sum((r - columns @ np.linalg.lstsq(columns, r, rcond=None)[0]) ** 2)

    return left(whole[:, : j.shape[2]]) - left(whole)


@given(seeds, faults)
def test_what_a_step_explains_is_what_two_fits_say(seed, fault):
    motion = as_it_stands(rows_of(seed, fault))
    latency = latency_of(motion)
    test = _ChangePoint(motion, latency)
    steps = test.steps(None)
    for s in (0, len(test.splits) // 2, len(test.splits) - 1):
        slow = slow_explained(motion, motion.frame, test.splits[s], latency)
        assert steps.explained[s] == pytest.approx(slow, rel=1e-3, abs=1e-6)


@given(seeds)
def test_random_orders_are_explained_one_by_one_as_in_a_batch(seed):
    motion = as_it_stands(rows_of(seed, "slip"))
    test = _ChangePoint(motion, 0.0)
    rng = np.random.default_rng(seed)
    orders = np.array([rng.permutation(motion.frames) for _ in range(5)])
    together = test.steps(orders).explained
    for order, explained in zip(orders, together, strict=True):
        np.testing.assert_allclose(test.steps(order[None]).explained[0], explained, rtol=1e-9)
        renumbered = np.argsort(order)[motion.frame]
        middle = len(test.splits) // 2
        slow = slow_explained(motion, renumbered, test.splits[middle], 0.0)
        assert explained[middle] == pytest.approx(slow, rel=1e-3, abs=1e-6)


def slow_slip(one, seed=0):
    """The test as it is defined: all orders at once, everything compared."""
    motion = motion_of(one)
    latency = latency_of(motion)
    test = _ChangePoint(motion, latency)
    explained, rng = test.steps(None).explained, np.random.default_rng(seed)
    orders = np.array([rng.permutation(motion.frames) for _ in range(ORDERS)])
    if np.any(test.steps(orders).explained >= explained.max()):
        return None
    split = int(test.splits[np.argmax(explained)])
    moved, share, drifts = slip_module._step(motion, latency, split)
    return None if drifts or moved < LEAST_SLIP_MM or share < LEAST_SHRINKING else split


@pytest.mark.parametrize("fault", ["sound", "slip", "late"])
def test_stopping_early_finds_what_comparing_everything_finds(fault):
    found = 0
    for seed in range(15):
        one = evidence(rows_of(seed, fault, frames=60, outliers=0.0))
        quick = list(check_slip(one))
        assert bool(quick) == (slow_slip(one) is not None), seed
        found += bool(quick)
    # A latency leaves an order in time that can pass for a slip: where there is one, no slip is looked for.
    least, most = {"sound": (0, 1), "slip": (11, 15), "late": (1, 15)}[fault]
    assert least <= found <= most


def test_orders_are_drawn_as_one_after_the_other(monkeypatch):
    """Batches change how many are drawn, and not which."""
    motion = motion_of(evidence(slipped_rows()))
    test, drawn = _ChangePoint(motion, 0.0), []
    steps = test.steps
    monkeypatch.setattr(test, "steps", lambda orders: (drawn.append(orders), steps(orders))[1])
    assert len(list(test.explained_by_chance(7))) > 3
    rng = np.random.default_rng(7)
    expected = np.array([rng.permutation(motion.frames) for _ in range(ORDERS)])
    np.testing.assert_array_equal(np.concatenate(drawn), expected)


def test_batches_of_orders_stay_within_the_memory_they_may_take(monkeypatch):
    monkeypatch.setattr(slip_module, "MOST_NUMBERS", 20_000)
    motion = motion_of(evidence(slipped_rows()))
    test, sizes = _ChangePoint(motion, 0.0), []
    steps = test.steps
    monkeypatch.setattr(test, "steps", lambda orders: (sizes.append(len(orders)), steps(orders))[1])
    list(test.explained_by_chance(0))
    assert sum(sizes) == ORDERS
    assert max(sizes) * motion.frames * 56 <= 20_000


@given(seeds, st.integers(1, 5))
def test_sums_over_frames_do_not_depend_on_how_rows_are_ordered(seed, rows_a_frame):
    rng = np.random.default_rng(seed)
    frame = np.repeat(np.arange(20), rows_a_frame)
    motion = motion_of(evidence(rows_of(1, "sound", outliers=0.0)))
    values = rng.normal(size=(len(frame), 3))
    order = rng.permutation(len(frame))
    expected = np.array([values[frame == f].sum(axis=0) for f in range(20)])
    for index in (np.arange(len(frame)), order):
        np.testing.assert_allclose(motion.summed(values[index], frame[index]), expected, atol=1e-12)


@given(seeds, faults)
def test_what_is_mapped_once_is_what_is_mapped_each_time(seed, fault):
    rows = rows_of(seed, fault)
    found = calibrated(rows)
    mapped = evidence_of(found, rows).mapped
    np.testing.assert_allclose(mapped.distances, found.residuals_mm, atol=1e-9)
    np.testing.assert_allclose(np.einsum("ni,ni->n", mapped.residuals, mapped.directions), 0, atol=1e-9)
    foot = rows.segments_mm[:, 0] + mapped.along_mm[:, None] * mapped.directions
    np.testing.assert_allclose(foot + mapped.residuals, found.probe_from_image @ rows.points_px, atol=1e-9)
    lengths = [
        stretch_length(part, group_codes(rows.frame)) for part in (mapped.residuals, -mapped.residuals)
    ]
    assert lengths[0] == lengths[1]


def test_rows_far_off_take_no_part_in_time():
    rows = slipped_rows()
    one = evidence(rows)
    motion = motion_of(dataclasses.replace(one, threshold_mm=one.threshold_mm / 4))
    far = one.mapped.distances > one.threshold_mm
    assert not np.isin(np.flatnonzero(far), motion.rows).any()
    assert motion.frames == len(np.unique(rows.frame[motion.rows]))


@pytest.mark.parametrize("dimension", [2, 3])
def test_what_noise_makes_of_motions_and_residuals_is_known_in_the_mean(dimension):
    (turn, shift), points, segments, frame = slow_sweep(3, "still", 100, dimension)
    truth, rng = sc.Similarity(turn, shift, SCALE), np.random.default_rng(dimension)
    area = np.array([[0.0] * dimension, [640.0] * dimension])
    found, said = [], []
    for _ in range(100):
        noise, both = rng.normal(0, PX, points.shape), []
        for sign in (1.0, -1.0):  # what is odd in the noise is no part of the mean
            rows = sc.Observations(points + sign * noise, segments, frame=frame)
            one = Evidence(rows, mapped_of(truth, rows), "similarity", None, area, 5.0, 0.2, sigma_px=PX)
            motion = motion_of(one)
            both.append(np.einsum("nik,ni->k", motion.jacobian, motion.residuals))
        found.append(np.mean(both, axis=0))
        said.append(motion.pull_by_noise.sum(axis=0))
    unsure = np.std(found, axis=0) / np.sqrt(len(found)) + 1e-9
    assert np.abs(np.mean(said, axis=0) / unsure).max() > 20.0
    np.testing.assert_array_less(np.abs(np.mean(found, axis=0) - np.mean(said, axis=0)), 4.0 * unsure)


@pytest.mark.parametrize("hand", ["still", "slow"])
def test_a_hand_that_hardly_moves_has_no_marker_that_slips(hand):
    accused = [{*OVER_TIME} & found_in(noisy_rows(seed, hand, 0.02)) for seed in range(40)]
    assert sum(map(bool, accused)) <= 2
