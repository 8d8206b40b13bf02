"""Kinds of fault, each with three strengths: a scan made wrong in one way.

A kind takes a seed and a strength and gives a `Case`. NumPy and SciPy alone.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.simulators.trust_scans import (
    Array,
    Scan,
    carried,
    clean,
    in_plane,
    noisy,
    one_direction,
    points_within,
    rigid,
    sound,
    through_port,
    wires,
)


@dataclasses.dataclass(frozen=True)
class Case:
    """What the program under test is given.

    Attributes:
        scan: sightings, and the truth about them.
        recording: given as a recording with detections, not as a table.
        size_known: the image's size is given.
        second: (N, P, D) of a candidate that is fainter than the scan's own, in a recording; or None.
    """

    scan: Scan
    recording: bool = False
    size_known: bool = True
    second: Array | None = None


@dataclasses.dataclass(frozen=True)
class Kind:
    """One way to be wrong.

    Attributes:
        make: of a seed and a strength.
        strengths: three.
        unit: what a strength is, for the table.
        unknowable: why the data cannot show it, or "".
        nothing: the strength that leaves the scan sound, where there is one and its noise is the same.
        forms: how many independent forms the fault may have for all that the rows tell: 1 where it is known.
    """

    make: Callable[[int, float], Case]
    strengths: tuple[float, float, float]
    unit: str
    unknowable: str = ""
    nothing: float | None = None
    forms: int = 1


# A table holds no poses: what is one vector in the tracker's frame may be any smooth function of time in the probe's,
# along three axes, with twice the highest frequency (0.2 / s) times the 15 s of a scan and one for its mean.
WITHOUT_POSES = 3 * (2 * 3 + 1)


def rng_of(seed: int) -> np.random.Generator:
    """The fault's own randomness, independent of the scan's."""
    return np.random.default_rng([seed, 100])


def unit_vector(rng: np.random.Generator) -> Array:
    """A random direction."""
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)


# --- units -----------------------------------------------------------------------------------------------------


def lengths_times(seed: int, factor: float, frames: int = 60) -> Case:
    """Segments in another unit than mm."""
    scan = sound(seed, frames)
    return Case(scan.with_segments(scan.segments_mm() * factor))


def metres(seed: int, frames: float) -> Case:
    """Segments in metres."""
    return lengths_times(seed, 1e-3, int(frames))


def centimetres(seed: int, frames: float) -> Case:
    """Segments in centimetres."""
    return lengths_times(seed, 0.1, int(frames))


def inches(seed: int, frames: float) -> Case:
    """Segments in inches."""
    return lengths_times(seed, 1 / 25.4, int(frames))


def normalised_pixels(seed: int, frames: float) -> Case:
    """Points as shares of the image's width and height."""
    scan = sound(seed, int(frames))
    truth = scan.truth.copy()
    truth[:3, :3] *= 500
    points, corners = scan.points_px / 500, scan.corners_px / 500
    return Case(scan.but(points_px=points, corners_px=corners, truth=truth), size_known=False)


def one_column(seed: int, factor: float) -> Case:
    """The segments' z in another unit."""
    scan = sound(seed)
    return Case(scan.with_segments(scan.segments_mm() * [1, 1, factor]))


# --- configurations near a degenerate one ----------------------------------------------------------------------


def plane(seed: int, sigma_px: float) -> Case:
    """Needles of one plane."""
    frames = int(rng_of(seed).integers(20, 200))
    return Case(noisy(in_plane(seed, frames), rng_of(seed), sigma_px))


def plane_of_unknown_image(seed: int, sigma_px: float) -> Case:
    """Needles of one plane, and no image size."""
    return dataclasses.replace(plane(seed, sigma_px), size_known=False)


def port(seed: int, port_mm: float, frames: int | None = None) -> Case:
    """Needles through a port 40 to 100 mm off the image."""
    rng = rng_of(seed)
    frames = int(rng.integers(30, 600)) if frames is None else frames
    return Case(
        noisy(through_port(seed, frames, port_mm, rng.uniform(40, 100)), rng, rng.uniform(0.5, 3), 0.3)
    )


def direction(seed: int, spread_deg: float) -> Case:
    """Needles of one direction, but for a little."""
    return Case(noisy(one_direction(seed, int(rng_of(seed).integers(20, 200)), spread_deg), rng_of(seed)))


def points_on_a_line(seed: int, height_px: float) -> Case:
    """Image points in a low band."""
    return Case(noisy(points_within(seed, int(rng_of(seed).integers(20, 200)), 400, height_px), rng_of(seed)))


def small_area(seed: int, side_px: float) -> Case:
    """Image points in a small part of the image."""
    return Case(
        noisy(points_within(seed, int(rng_of(seed).integers(20, 200)), side_px, side_px), rng_of(seed))
    )


def small_area_of_unknown_image(seed: int, side_px: float) -> Case:
    """Image points in a small part of the image, and no image size."""
    return dataclasses.replace(small_area(seed, side_px), size_known=False)


# --- errors that sightings share -------------------------------------------------------------------------------


def correlated(rng: np.random.Generator, steps: int, frames: float, count: int) -> Array:
    """(steps, count): AR(1) of unit variance with a correlation time in frames."""
    keep = np.exp(-1 / frames)
    values = rng.normal(size=(steps, count))
    for i in range(1, steps):
        values[i] = keep * values[i - 1] + np.sqrt(1 - keep**2) * values[i]
    return values


def shaken(scan: Scan, turn: Array, shift: Array) -> Scan:
    """The probe's marker turned (N, 3), rad, and moved (N, 3), mm, from where it belongs."""
    return scan.but(tracker_from_probe=scan.tracker_from_probe @ rigid(turn, shift))


def autocorrelated(seed: int, seconds: float) -> Case:
    """Tracking errors of 0.5 mm that last some seconds, in a scan of 30 s."""
    scan = sound(seed, 300)
    errors = correlated(rng_of(seed), 300, 10 * seconds, 6) * 0.5
    # An error of a marker's pose is one of place and, over some 100 mm, of turning.
    return Case(shaken(scan, errors[:, :3] / 100, errors[:, 3:]))


def drift(seed: int, millimetres: float) -> Case:
    """The marker creeps on the probe."""
    scan, rng = sound(seed, 200), rng_of(seed)
    share = np.linspace(0, 1, 200)[:, None] - 0.5
    turn, shift = unit_vector(rng) * millimetres / 100, unit_vector(rng) * millimetres
    return Case(shaken(scan, share * turn, share * shift))


def wandering(seed: int, millimetres: float) -> Case:
    """The marker's place is a random walk."""
    scan = sound(seed, 200)
    walk = np.cumsum(rng_of(seed).normal(size=(200, 6)), axis=0) / np.sqrt(200) * millimetres
    return Case(shaken(scan, walk[:, :3] / 100, walk[:, 3:]))


def field_at(rng: np.random.Generator, millimetres: float) -> Callable[[Array], Array]:
    """A smooth vector field of some rms, fixed in the tracker's frame; waves of 300 to 900 mm."""
    wave = rng.normal(size=(6, 3))
    wave *= (2 * np.pi / rng.uniform(300, 900, 6) / np.linalg.norm(wave, axis=1))[:, None]
    phase, size = rng.uniform(0, 2 * np.pi, 6), rng.normal(size=(6, 3)) * millimetres / 3
    return lambda places: np.sin(places @ wave.T + phase) @ size


def distortion(seed: int, millimetres: float, *, still: bool = False) -> Case:
    """An electromagnetic field bent by metal: both sensors are displaced by a smooth field.

    `still`: a recording of images each held anew, so that neighbours in time have nothing in common.
    """
    scan = sound(seed, 150, still=still)
    bend = field_at(rng_of(seed), millimetres)
    poses = scan.tracker_from_probe.copy()
    poses[:, :3, 3] += bend(poses[:, :3, 3])
    bent = scan.but(ends_mm=scan.ends_mm + bend(scan.ends_mm), tracker_from_probe=poses)
    return Case(bent, recording=still)


def sag(seed: int, millimetres: float, *, still: bool = False) -> Case:
    """The needle's tip hangs down where the needle lies level; its marker does not know. `still` as of `distortion`."""
    scan = sound(seed, 150, still=still)
    down = unit_vector(rng_of(seed))
    along = scan.ends_mm[:, 1] - scan.ends_mm[:, 0]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    level = np.linalg.norm(np.cross(along, down), axis=1)
    ends = scan.ends_mm.copy()
    ends[:, 1] -= (millimetres * level)[:, None] * down
    return Case(scan.but(ends_mm=ends), recording=still)


def offset_in_tracker(seed: int, millimetres: float) -> Case:
    """The needle is off by one vector of the tracker's frame."""
    scan = sound(seed, 150)
    return Case(scan.but(ends_mm=scan.ends_mm + millimetres * unit_vector(rng_of(seed))))


def offset_in_probe(seed: int, millimetres: float) -> Case:
    """The needle is off by one vector of the probe's frame."""
    scan = sound(seed)
    return Case(scan.with_segments(scan.segments_mm() + millimetres * unit_vector(rng_of(seed))))


def repeated(seed: int, times: float) -> Case:
    """Every row stands several times, as of further frames."""
    scan = sound(seed, 30, still=True)
    again = scan.rows(np.repeat(np.arange(30), int(times)))
    return Case(again.but(time_s=np.arange(len(again.time_s)) / 10))


def nearly_repeated(seed: int, times: float) -> Case:
    """Every sighting was recorded several times while nothing moved: its error is one."""
    scan = sound(seed, 20, still=True)
    again = scan.rows(np.repeat(np.arange(20), int(times)))
    again = again.but(time_s=np.arange(len(again.time_s)) / 10)
    return Case(noisy(again, rng_of(seed), 0.1, 0.05))


def few_wires(seed: int, count: float) -> Case:
    """One to three wires whose places are off by 0.5 mm."""
    scan, rng = noisy(wires(seed, 60, int(count)), rng_of(seed), 1.0, 0.1), rng_of(seed + 1)
    off = 0.5 * rng.normal(size=(int(count), 2, 3))
    return Case(scan.but(ends_mm=scan.ends_mm + off[np.unique(scan.target, return_inverse=True)[1]]))


# --- time and frames -------------------------------------------------------------------------------------------


def late(seed: int, seconds: float, speed: float, *, recording: bool) -> Case:
    """Tracker and image are not of one instant; by the seed one or the other is late."""
    lag = seconds if seed % 2 else -seconds
    return Case(sound(seed, 150, speed=speed, latency_s=lag), recording=recording)


def inverted(seed: int, frames: float) -> Case:
    """The probe's poses are inverse."""
    scan = sound(seed, int(frames))
    return Case(scan.but(tracker_from_probe=np.linalg.inv(scan.tracker_from_probe)), recording=True)


def transposed(seed: int, frames: float) -> Case:
    """The rotations of the probe's poses are transposed."""
    scan = sound(seed, int(frames))
    poses = scan.tracker_from_probe.copy()
    poses[:, :3, :3] = poses[:, :3, :3].transpose(0, 2, 1)
    return Case(scan.but(tracker_from_probe=poses), recording=True)


def other_quaternion_order(seed: int, frames: float) -> Case:
    """The probe's quaternions (w, x, y, z) are read as (x, y, z, w)."""
    scan = sound(seed, int(frames))
    poses = scan.tracker_from_probe.copy()
    x, y, z, w = Rotation.from_matrix(poses[:, :3, :3]).as_quat().T
    poses[:, :3, :3] = Rotation.from_quat(np.column_stack([w, x, y, z])).as_matrix()
    return Case(scan.but(tracker_from_probe=poses), recording=True)


def axes_swapped(seed: int, frames: float) -> Case:
    """Two axes of the probe's places are exchanged, not those of its rotations."""
    scan = sound(seed, int(frames))
    poses = scan.tracker_from_probe.copy()
    poses[:, :3, 3] = poses[:, [1, 0, 2], 3]
    return Case(scan.but(tracker_from_probe=poses), recording=True)


def slip(seed: int, millimetres: float) -> Case:
    """The marker slips on the probe, once: some mm and as many half degrees."""
    scan, rng = sound(seed, 150), rng_of(seed)
    after = (np.arange(150) >= 150 * rng.uniform(0.3, 0.7))[:, None]
    turn, shift = np.radians(millimetres / 2) * unit_vector(rng), millimetres * unit_vector(rng)
    return Case(shaken(scan, after * turn, after * shift))


def turned_marker(seed: int, degrees: float) -> Case:
    """The marker turns on its post half-way through."""
    scan = sound(seed, 150)
    after = (np.arange(150) >= 75)[:, None]
    return Case(shaken(scan, after * np.radians(degrees) * unit_vector(rng_of(seed)), np.zeros((150, 3))))


def tracker_frame(seed: int, frames: float) -> Case:
    """The table's segments are in the tracker's frame."""
    scan = sound(seed, int(frames))
    return Case(scan.with_segments(scan.ends_mm))


def wrong_end(seed: int, share: float) -> Case:
    """The needle's second end is on the wrong side of the first."""
    scan = sound(seed, int(share))
    ends = scan.ends_mm.copy()
    ends[:, 1] = 2 * ends[:, 0] - ends[:, 1]
    return Case(scan.but(ends_mm=ends))


# --- what is scanned -------------------------------------------------------------------------------------------


def turned_needle(scan: Scan, rng: np.random.Generator, degrees: float, shift_mm: float) -> Scan:
    """The needle's own axis off by a turn and a shift that roll with the needle."""
    along = scan.ends_mm[:, 1] - scan.ends_mm[:, 0]
    length = np.linalg.norm(along, axis=1, keepdims=True)
    side = np.cross(along / length, rng.normal(size=(len(along), 3)))
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    ends = scan.ends_mm + shift_mm * side[:, None]
    ends[:, 1] += np.tan(np.radians(degrees)) * length * side
    return scan.but(ends_mm=ends)


def tilted_axis(seed: int, degrees: float) -> Case:
    """The needle's calibrated axis is tilted; the hand rolls it anyhow."""
    return Case(turned_needle(sound(seed, 150), rng_of(seed), degrees, 0.0))


def fixed_roll(scan: Scan, rng: np.random.Generator, degrees: float) -> Scan:
    """The needle's axis off by a turn; the needle is held with one side up in the probe's frame."""
    segments = scan.segments_mm()
    along = segments[:, 1] - segments[:, 0]
    length = np.linalg.norm(along, axis=1, keepdims=True)
    side = np.cross(along / length, unit_vector(rng))
    segments[:, 1] += np.tan(np.radians(degrees)) * length * side
    return scan.with_segments(segments)


def tilted_axis_held(seed: int, degrees: float) -> Case:
    """The needle's calibrated axis is tilted; the hand keeps one side of it up."""
    return Case(fixed_roll(sound(seed, 150), rng_of(seed), degrees))


def bent(seed: int, millimetres: float) -> Case:
    """The shaft is bent: its middle is off the line, and rolls with it."""
    scan, rng = sound(seed, 150), rng_of(seed)
    segments = scan.segments_mm()
    along = segments[:, 1] - segments[:, 0]
    length = np.linalg.norm(along, axis=1)
    place = np.einsum("nk,nk->n", tips(scan) - segments[:, 0], along) / length**2
    side = np.cross(along / length[:, None], rng.normal(size=along.shape))
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    bow = 4 * place * (1 - place) * millimetres
    return Case(scan.with_segments(segments - (bow[:, None] * side)[:, None]))


def tips(scan: Scan) -> Array:
    """(N, 3): where what is seen is, by the truth."""
    places = scan.points_px.mean(axis=1)
    return places @ scan.truth[:3, : scan.dimension].T + scan.truth[:3, 3]


def other_needle(seed: int, share: float) -> Case:
    """A share of the rows saw a second needle, held beside the first by 15 mm, under its name."""
    scan, rng = sound(seed, 150), rng_of(seed)
    wrong = rng.random(150) < share
    beside = 15 / np.linalg.norm(scan.truth[:3, 0]) * np.array([np.cos(a := rng.uniform(0, 6.3)), np.sin(a)])
    return Case(scan.but(points_px=scan.points_px + wrong[:, None, None] * beside))


def swapped_wires(seed: int, count: float) -> Case:
    """Two wires of several bear each other's names."""
    scan = noisy(wires(seed, 60, int(count)), rng_of(seed), 1.0, 0.3)
    names = scan.target.copy()
    ends = scan.ends_mm.copy()
    first, second = names == "w0", names == "w1"
    if first.any() and second.any():
        ends[first], ends[second] = scan.ends_mm[second][0], scan.ends_mm[first][0]
    return Case(scan.but(ends_mm=ends))


def twin(seed: int, millimetres: float) -> Case:
    """A reverberation below the needle is brighter than the needle."""
    scan = sound(seed, 150)
    down = np.array([0.0, millimetres / np.linalg.norm(scan.truth[:3, 0])])
    return Case(scan.but(points_px=scan.points_px + down), recording=True, second=scan.points_px)


# --- the image -------------------------------------------------------------------------------------------------


def stretched(scan: Scan, axis: int, factor: float) -> Scan:
    """The image's axis in px is longer than the truth's; corners are measured at places as given."""
    points = scan.points_px.copy()
    points[..., axis] *= factor
    truth = scan.truth.copy()
    truth[:3, axis] /= factor
    return scan.but(points_px=points, truth=truth)


def unequal_voxels(seed: int, percent: float) -> Case:
    """Slices of a volume are farther apart than its voxels are wide."""
    return Case(stretched(sound(seed, 60, 3), 2, 1 - percent / 100))


def unequal_pixels(seed: int, percent: float) -> Case:
    """Pixels are wider than high."""
    return Case(stretched(sound(seed), 1, 1 - percent / 100))


def speed_of_sound(seed: int, percent: float, dimension: int = 2) -> Case:
    """Depth of a linear probe is off: the water is not at 1540 m/s."""
    return Case(stretched(sound(seed, 100 if dimension == 2 else 60, dimension), 1, 1 + percent / 100))


def bent_sound(seed: int, percent: float) -> Case:
    """The same of a curved probe: places move along rays from a point 60 mm above the image."""
    scan = sound(seed)
    apex = np.array([250.0, -250.0])
    ray = scan.points_px - apex
    depth = np.linalg.norm(ray, axis=2, keepdims=True)
    # The probe's face, 250 px from the apex, stays where it is.
    longer = 250 + np.maximum(depth - 250, 0) * (1 + percent / 100)
    return Case(scan.but(points_px=apex + ray / depth * np.where(depth > 250, longer, depth)))


def refracted(seed: int, percent: float) -> Case:
    """An error that grows with the square of the depth, in per cent of the image at its bottom."""
    scan = sound(seed)
    points = scan.points_px.copy()
    points[..., 1] += 5 * percent * (points[..., 1] / 500) ** 2
    return Case(scan.but(points_px=points))


def thick_slice(seed: int, millimetres: float) -> Case:
    """A slice of that thickness, in which the shallower end of a needle's streak is taken for the needle."""
    scan = sound(seed, 200, still=True)
    inverse = np.linalg.inv(scan.truth[:3, :3])
    segments = scan.segments_mm()
    along = (segments[:, 1] - segments[:, 0]) @ inverse.T
    lean = along[:, :2] / along[:, 2:]
    end = -np.sign(lean[:, 1:]) * lean * millimetres / 2 / np.linalg.norm(scan.truth[:3, 0])
    return Case(scan.but(points_px=scan.points_px + end[:, None]))


def mirrored_volume(seed: int, axis: float) -> Case:
    """A volume mirrored along one axis."""
    scan = sound(seed, 60, 3)
    points, truth = scan.points_px.copy(), scan.truth.copy()
    points[..., int(axis)] = 219 - points[..., int(axis)]
    truth[:3, 3] += 219 * truth[:3, int(axis)]
    truth[:3, int(axis)] *= -1
    return Case(scan.but(points_px=points, truth=truth))


def mirrored(seed: int, axes: float) -> Case:
    """An image mirrored along u (1), along v (2), or turned by half a turn (3); the user knows of none."""
    scan = sound(seed)
    points = scan.points_px.copy()
    for axis in (0, 1):
        if int(axes) & (1 << axis):
            points[..., axis] = 499 - points[..., axis]
    return Case(scan.but(points_px=points))


def depth_knob(seed: int, percent: float) -> Case:
    """The depth was changed half-way: px are larger from then on."""
    scan = sound(seed, 150)
    points = scan.points_px.copy()
    points[75:] = [250, 0] + (points[75:] - [250, 0]) / (1 + percent / 100)
    return Case(scan.but(points_px=points))


# --- noise -----------------------------------------------------------------------------------------------------


def clustered(seed: int, share: float) -> Case:
    """Outliers that are one bright spot of the image."""
    scan, rng = sound(seed, 150), rng_of(seed)
    wrong = rng.random(150) < share
    points = scan.points_px.copy()
    points[wrong] = rng.uniform(50, 450, 2) + 5 * rng.normal(size=(wrong.sum(), 1, 2))
    return Case(scan.but(points_px=points))


def minority(seed: int, share: float) -> Case:
    """A share of the rows agrees with another map: the marker was bumped for that time."""
    scan, rng = sound(seed, 150), rng_of(seed)
    wrong = (np.arange(150) >= (1 - share) * 150)[:, None]
    return Case(shaken(scan, wrong * np.radians(4) * unit_vector(rng), wrong * 8 * unit_vector(rng)))


def scattered(seed: int, share: float) -> Case:
    """Outliers anywhere."""
    scan, rng = sound(seed, 150), rng_of(seed)
    wrong = rng.random(150) < share
    points = scan.points_px.copy()
    points[wrong] = rng.uniform(0, 500, (wrong.sum(), 1, 2))
    return Case(scan.but(points_px=points))


def heavy_tails(seed: int, freedom: float) -> Case:
    """Student's t on points and ends."""
    scan, rng = clean(seed), rng_of(seed)
    return Case(
        scan.but(
            points_px=scan.points_px + rng.standard_t(freedom, scan.points_px.shape),
            ends_mm=scan.ends_mm + 0.4 * rng.standard_t(freedom, scan.ends_mm.shape),
        )
    )


def uneven(seed: int, most: float) -> Case:
    """Noise that grows with depth, from 0.5 px to `most` px at the bottom."""
    scan, rng = sound(seed, sigma_px=0.0), rng_of(seed)
    sigma = 0.5 + (most - 0.5) * (scan.points_px[..., 1:] / 500).clip(0, 1)
    return Case(scan.but(points_px=scan.points_px + sigma * rng.normal(size=scan.points_px.shape)))


def rounded_pixels(seed: int, step: float) -> Case:
    """Points rounded to some px."""
    scan = sound(seed)
    return Case(scan.but(points_px=np.round(scan.points_px / step) * step))


def rounded_poses(seed: int, step: float) -> Case:
    """The probe's places rounded to some mm, its angles to as many degrees."""
    scan = sound(seed, 150)
    angles = Rotation.from_matrix(scan.tracker_from_probe[:, :3, :3]).as_euler("ZYX", degrees=True)
    turns = Rotation.from_euler("ZYX", np.round(angles / step) * step, degrees=True).as_rotvec()
    return Case(
        scan.but(tracker_from_probe=rigid(turns, np.round(scan.tracker_from_probe[:, :3, 3] / step) * step))
    )


N = ("rows", (20.0, 60.0, 200.0))
SLOW, FAST = 0.5, 2.5

LAGS = (0.05, 0.1, 0.19)
KINDS: dict[str, Kind] = {
    "segments in metres": Kind(metres, N[1], N[0]),
    "segments in centimetres": Kind(centimetres, N[1], N[0]),
    "segments in inches": Kind(inches, N[1], N[0]),
    "points as shares of the image": Kind(normalised_pixels, N[1], N[0]),
    "z in another unit": Kind(one_column, (0.1, 1 / 25.4, 1e-3), "factor"),
    "one plane": Kind(plane, (0.5, 1.0, 3.0), "px noise"),
    "one plane, no image size": Kind(plane_of_unknown_image, (0.5, 1.0, 3.0), "px noise"),
    "narrow port": Kind(port, (1.0, 3.0, 5.0), "mm rms"),
    "one direction": Kind(direction, (0.0, 0.5, 2.0), "deg spread"),
    "points in a low band": Kind(points_on_a_line, (0.0, 2.0, 10.0), "px high"),
    "small area": Kind(small_area, (10.0, 20.0, 40.0), "px wide"),
    "small area, no image size": Kind(small_area_of_unknown_image, (10.0, 20.0, 40.0), "px wide"),
    "autocorrelated tracking": Kind(autocorrelated, (0.5, 2.0, 5.0), "s"),
    "marker creeps": Kind(drift, (1.0, 2.0, 4.0), "mm", nothing=0.0),
    "marker wanders": Kind(wandering, (1.0, 2.0, 4.0), "mm", nothing=0.0),
    "EM distortion": Kind(distortion, (0.7, 1.5, 3.0), "mm rms", nothing=0.0, forms=WITHOUT_POSES),
    "EM distortion, recording of stills": Kind(
        lambda s, x: distortion(s, x, still=True), (0.7, 1.5, 3.0), "mm rms", nothing=0.0
    ),
    "needle sags": Kind(sag, (1.0, 2.0, 4.0), "mm", nothing=0.0, forms=WITHOUT_POSES),
    "needle sags, recording of stills": Kind(
        lambda s, x: sag(s, x, still=True), (1.0, 2.0, 4.0), "mm", nothing=0.0
    ),
    "offset in the tracker's frame": Kind(
        offset_in_tracker, (1.0, 2.0, 4.0), "mm", nothing=0.0, forms=WITHOUT_POSES
    ),
    "offset in the probe's frame": Kind(
        offset_in_probe, (1.0, 2.0, 4.0), "mm", "a shift of all needles is a shift of the probe's marker", 0.0
    ),
    "rows repeated": Kind(repeated, (2.0, 5.0, 10.0), "times"),
    "still frames repeated": Kind(nearly_repeated, (2.0, 5.0, 10.0), "times"),
    "few wires, 0.5 mm off": Kind(few_wires, (1.0, 2.0, 3.0), "wires"),
    "late, slow hand, table": Kind(lambda s, x: late(s, x, SLOW, recording=False), LAGS, "s", nothing=0.0),
    "late, fast hand, table": Kind(lambda s, x: late(s, x, FAST, recording=False), LAGS, "s", nothing=0.0),
    "late, slow hand, recording": Kind(lambda s, x: late(s, x, SLOW, recording=True), LAGS, "s", nothing=0.0),
    "late, fast hand, recording": Kind(lambda s, x: late(s, x, FAST, recording=True), LAGS, "s", nothing=0.0),
    "poses inverted": Kind(inverted, N[1], N[0]),
    "poses transposed": Kind(transposed, N[1], N[0]),
    "other quaternion order": Kind(other_quaternion_order, N[1], N[0]),
    "axes of places exchanged": Kind(axes_swapped, N[1], N[0]),
    "marker slips": Kind(slip, (0.7, 2.0, 5.0), "mm, half deg", nothing=0.0),
    "marker turns half-way": Kind(turned_marker, (1.0, 10.0, 90.0), "deg", nothing=0.0),
    "segments in the tracker's frame": Kind(tracker_frame, N[1], N[0]),
    "wrong end of the needle": Kind(wrong_end, N[1], N[0]),
    "needle's axis tilted, rolling": Kind(tilted_axis, (0.5, 1.0, 2.0), "deg"),
    "needle's axis tilted, one side up": Kind(tilted_axis_held, (0.3, 1.0, 2.0), "deg", nothing=0.0),
    "bent shaft, rolling": Kind(bent, (1.0, 2.0, 4.0), "mm"),
    "a second needle under its name": Kind(other_needle, (0.2, 0.3, 0.45), "share"),
    "two wires exchanged": Kind(swapped_wires, (3.0, 4.0, 6.0), "wires"),
    "reverberation brighter": Kind(twin, (3.0, 6.0, 11.0), "mm deeper"),
    "unequal voxels": Kind(unequal_voxels, (1.0, 3.0, 10.0), "%", nothing=0.0),
    "unequal pixels": Kind(unequal_pixels, (1.0, 3.0, 6.0), "%", nothing=0.0),
    "speed of sound, linear": Kind(speed_of_sound, (1.0, 3.0, 6.0), "%", nothing=0.0),
    "speed of sound, curved": Kind(bent_sound, (1.0, 3.0, 6.0), "%", nothing=0.0),
    "speed of sound, volume": Kind(lambda s, x: speed_of_sound(s, x, 3), (1.0, 3.0, 6.0), "%", nothing=0.0),
    "error growing with depth": Kind(refracted, (0.5, 1.0, 2.0), "% at the bottom", nothing=0.0),
    "slice of some thickness": Kind(thick_slice, (2.0, 4.0, 6.0), "mm", nothing=0.0),
    "volume mirrored": Kind(mirrored_volume, (0.0, 1.0, 2.0), "axis"),
    "image mirrored or turned": Kind(
        mirrored,
        (1.0, 2.0, 3.0),
        "u, v, both",
        "a plane's image mirrored is the plane seen from its other side",
    ),
    "depth knob turned half-way": Kind(depth_knob, (2.0, 5.0, 25.0), "%"),
    "outliers at one place": Kind(clustered, (0.3, 0.45, 0.6), "share"),
    "a consistent minority": Kind(minority, (0.2, 0.3, 0.4), "share"),
    "outliers anywhere": Kind(scattered, (0.3, 0.45, 0.6), "share"),
    "heavy tails": Kind(heavy_tails, (3.0, 2.0, 1.5), "freedom"),
    "noise uneven over the image": Kind(uneven, (3.0, 5.0, 8.0), "px"),
    "points rounded": Kind(rounded_pixels, (1.0, 5.0, 10.0), "px"),
    "poses rounded": Kind(rounded_poses, (0.5, 1.0, 2.0), "mm and deg"),
}


__all__ = ["KINDS", "Case", "Kind", "carried", "correlated", "port"]
