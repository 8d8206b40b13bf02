"""A simulated sweep: a hand moves a tracked needle through a probe's image, and a tracker and scanner record it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sonocal.errors import InputError
from sonocal.geometry import Array, Similarity
from sonocal.recording import (
    Frames,
    ImageGeometry,
    Poses,
    Provenance,
    Recording,
)
from sonocal.recording.frames import Image
from sonocal.simulation.sweep_motion import HandMotion
from sonocal.simulation.ultrasound import Echo, Look, UltrasoundImager
from sonocal.simulation.ultrasound_probe import ProbeGeometry, curvilinear
from sonocal.simulation.ultrasound_scenery import Scenery
from sonocal.targets import Line

__all__ = [
    "NEEDLE_MM",
    "SimulatedSweep",
    "SweepOptions",
    "Truth",
    "check_sweep",
    "draw_overlay",
    "random_calibration",
    "runs",
    "simulate_sweep",
]

NEEDLE_MM = 400.0
CLEAR_MM = 5.0
FAINT = 0.02  # amplitude below which another echo is lost in speckle
NEEDLE = Line("needle", "Needle", np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -NEEDLE_MM]]))


def check_sweep(frames: int, rate_hz: float, sigma_px: float, sigma_mm: float, **shares: float) -> None:
    """Refuse settings that no sweep has.

    Raises:
        InputError: there is no image, no rate, less noise than none, or a share of the images is none.
    """
    if frames < 1 or not rate_hz > 0:
        raise InputError(f"a sweep needs frames and a rate; got {frames} at {rate_hz} Hz")
    if not (sigma_px >= 0 and sigma_mm >= 0):
        raise InputError(f"noise cannot be negative; got {sigma_px} px and {sigma_mm} mm")
    for name, share in shares.items():
        if not 0 <= share <= 1:
            raise InputError(f"{name} is between 0 and 1; got {share}")


@dataclass(frozen=True)
class SweepOptions:
    """What happens in a sweep.

    Attributes:
        frames: how many images.
        rate_hz: images a second.
        sigma_px: of the image point about the needle along each axis: bending, refraction.
        sigma_mm: tracking noise of the needle's two ends along each axis.
        hidden_share: share of the images in which the needle does not show.
        dropout_share: share of the items without a valid pose.
        latency_s: how much later the tracker stamps an instant than the images do.
        compact, interfaces: bright things in view on average, beside the needle.
        overlay: whether text and a ruler are drawn over the image, as in a screen capture.
        seed: of everything random.
    """

    frames: int = 500
    rate_hz: float = 20.0
    sigma_px: float = 1.0
    sigma_mm: float = 1.0
    hidden_share: float = 0.2
    dropout_share: float = 0.0
    latency_s: float = 0.0
    compact: float = 2.0
    interfaces: float = 0.5
    overlay: bool = False
    seed: int = 0

    def __post_init__(self) -> None:
        shares = {"hidden_share": self.hidden_share, "dropout_share": self.dropout_share}
        check_sweep(self.frames, self.rate_hz, self.sigma_px, self.sigma_mm, **shares)


@dataclass(frozen=True, eq=False)
class Truth:
    """What is true of a sweep.

    Attributes:
        probe_from_image: the calibration.
        points_px: (N, 2): where the needle crosses the image; (N, 2, 3) in 3D: two points of it.
        shown_px: the same with the image point's noise: where the image shows them.
        visible: (N,): whether it shows; a needle that passes the image's edges by does not.
        clear: (N,): whether it shows and nothing else bright, nor the fan's edge, is within 5 mm of it, nor a
            shadow over it (2D).
        latency_s: of the tracker behind the images.
    """

    probe_from_image: Similarity
    points_px: Array
    shown_px: Array
    visible: NDArray[np.bool_]
    clear: NDArray[np.bool_]
    latency_s: float


@dataclass(frozen=True, eq=False)
class SimulatedSweep:
    """A recording, the needle that was moved, and the truth."""

    recording: Recording
    lines: tuple[Line, ...]
    truth: Truth
    options: SweepOptions = field(default_factory=SweepOptions)


def simulate_sweep(
    geometry: ProbeGeometry | None = None, look: Look | None = None, options: SweepOptions | None = None
) -> SimulatedSweep:
    """A sweep with known truth; its images are made when they are asked for.

    Args:
        geometry: the probe; default: a curvilinear 2D probe of 500 x 500 px and 0.24 mm.
        look: the images' appearance.
        options: what happens.

    Returns:
        The sweep; the same seed gives the same images in whatever order they are asked for.
    """
    geometry, options = geometry or curvilinear(), options or SweepOptions()
    rng = np.random.default_rng([options.seed, 0])
    motion = HandMotion(geometry, options.frames / options.rate_hz, rng)
    times = np.arange(options.frames) / options.rate_hz
    visible = ~runs(rng, options.frames, options.hidden_share)
    probe_from_image = random_calibration(rng, geometry.scale_mm_per_px)
    needle_mm = motion.needle(times)
    jitter = np.zeros_like(needle_mm)
    jitter[..., : geometry.dimension] = rng.normal(
        scale=options.sigma_px * geometry.scale_mm_per_px,
        size=(options.frames, geometry.dimension - 1, geometry.dimension),
    )
    shown = _points(needle_mm + jitter, geometry)
    if geometry.dimension == 2:
        visible &= geometry.inside(shown * geometry.scale_mm_per_px)
    frames = SimulatedFrames(geometry, look, options, needle_mm + jitter, visible)
    recording = Recording(
        times=times,
        frames=frames,
        poses=_poses(motion, probe_from_image, times, options, rng),
        image=ImageGeometry(
            geometry.size_px, 1, "uint8", "MFA" if geometry.dimension == 3 else "MF", np.eye(4)
        ),
        provenance=Provenance(name=f"simulation (seed {options.seed})"),
    )
    points = _points(needle_mm, geometry)
    clear = visible if geometry.dimension == 3 else visible & frames.apart(points * geometry.scale_mm_per_px)
    truth = Truth(probe_from_image, points, shown, visible, clear, options.latency_s)
    return SimulatedSweep(recording, (NEEDLE,), truth, options)


class SimulatedFrames(Frames):
    """Images of a needle, made when they are asked for, each from its own random numbers."""

    def __init__(
        self,
        geometry: ProbeGeometry,
        look: Look | None,
        options: SweepOptions,
        needle_mm: Array,
        visible: NDArray[np.bool_],
    ) -> None:
        self._geometry = geometry
        self._imager = UltrasoundImager(geometry, look)
        self._options, self._needle, self._visible = options, needle_mm, visible
        self._scenery = Scenery(
            geometry, len(visible) / options.rate_hz, options.compact, options.interfaces, options.seed
        )
        self.shape, self.dtype = geometry.size_px[::-1], np.dtype(np.uint8)

    def __len__(self) -> int:
        return len(self._visible)

    def read(self, index: int) -> Image:
        """Image `index`."""
        rng = np.random.default_rng([self._options.seed, 2, index])
        echoes = self._scenery.echoes(index / self._options.rate_hz, rng)
        if self._visible[index]:
            echoes.append(self._imager.needle(self._needle[index], rng))
        image = self._imager.image(echoes, rng)
        if self._options.overlay:
            draw_overlay(image)
        image.flags.writeable = False
        return image

    def apart(self, points_mm: Array) -> NDArray[np.bool_]:
        """(N,): whether the points (N, 2), one an image, are clear of other echoes, shadows and the fan's edge."""
        angles = np.linspace(0, 2 * np.pi, 8, endpoint=False)
        around = CLEAR_MM * np.column_stack([np.cos(angles), np.sin(angles)])
        clear = np.asarray(self._geometry.inside(points_mm[:, None] + around).all(axis=1))
        for index in np.flatnonzero(clear).tolist():
            point = points_mm[index]
            rng = np.random.default_rng([self._options.seed, 2, index])
            echoes = self._scenery.echoes(index / self._options.rate_hz, rng)
            clear[index] = all(
                _apart(self._geometry, e, point) for e in echoes if np.abs(e.amplitudes).max() > FAINT
            )
        return clear


def _apart(geometry: ProbeGeometry, echo: Echo, point_mm: Array) -> bool:
    """Whether a point is neither near an echo nor behind one that casts a shadow."""
    beams, place = geometry.beams_of(echo.points_mm), geometry.beams_of(np.append(point_mm, 0.0))
    near = (np.linalg.norm(echo.points_mm[:, :2] - point_mm, axis=1) < CLEAR_MM).any()
    under = (
        echo.shadow > 0
        and np.min(beams[:, 1]) < place[1] < np.max(beams[:, 1])
        and place[0] > beams[:, 0].min()
    )
    return not (near or under)


def _points(needle_mm: Array, geometry: ProbeGeometry) -> Array:
    if geometry.dimension == 3:
        return needle_mm / geometry.scale_mm_per_px
    start, along = needle_mm[:, 0], needle_mm[:, 1] - needle_mm[:, 0]
    crossing = start - along * (start[:, 2] / along[:, 2])[:, None]
    return np.asarray(crossing[:, :2] / geometry.scale_mm_per_px)


def _poses(
    motion: HandMotion,
    probe_from_image: Similarity,
    times: Array,
    options: SweepOptions,
    rng: np.random.Generator,
) -> dict[str, Poses]:
    # The pose stamped t was true at t - latency.
    instants = times - options.latency_s
    tracker_from_probe = motion.probe(instants)
    ends_probe = probe_from_image @ (motion.needle_ends(instants, NEEDLE_MM) / probe_from_image.scale)
    ends_probe = ends_probe + rng.normal(scale=options.sigma_mm, size=ends_probe.shape)
    probe_from_needle = _needle_poses(ends_probe, motion.roll(instants))
    lost = runs(rng, len(times), options.dropout_share)
    status = tuple("INVALID" if bad else "OK" for bad in lost)
    tracked = {"Probe": tracker_from_probe, "Needle": tracker_from_probe @ probe_from_needle}
    poses = [Poses(name, "Tracker", matrices, ~lost, status) for name, matrices in tracked.items()]
    return {pose.name: pose for pose in poses}


def _needle_poses(ends: Array, roll: Array) -> Array:
    """(N, 4, 4): the tip (the first end) at the origin, the needle along -z, turned about itself by `roll`."""
    z = ends[:, 0] - ends[:, 1]
    z = z / np.linalg.norm(z, axis=1, keepdims=True)
    helper = np.where(np.abs(z[:, :1]) < 0.7, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    x = np.cross(helper, z)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    y = np.cross(z, x)
    c, s = np.cos(roll)[:, None], np.sin(roll)[:, None]
    poses = np.tile(np.eye(4), (len(ends), 1, 1))
    poses[:, :3, :3] = np.stack([c * x + s * y, c * y - s * x, z], axis=-1)
    poses[:, :3, 3] = ends[:, 0]
    return poses


def runs(rng: np.random.Generator, count: int, share: float, length: int = 10) -> NDArray[np.bool_]:
    """A mask with that share of true entries, in runs: needles and markers vanish for a while at a time."""
    wanted = round(share * count)
    mask = np.zeros(count, dtype=bool)
    while mask.sum() < wanted:
        start = int(rng.integers(count))
        room = wanted - int(mask.sum())
        mask[start : start + min(length, room)] = True
    return mask


def random_calibration(rng: np.random.Generator, scale: float) -> Similarity:
    """A calibration of any rotation, within 100 mm of the marker along each axis."""
    from scipy.spatial.transform import Rotation

    return Similarity(Rotation.random(random_state=rng).as_matrix(), rng.uniform(-100, 100, 3), scale)


def draw_overlay(image: Image) -> None:
    """Draw over an image a ruler along the right edge and a block of strokes like text in the upper left corner."""
    rows, cols = image.shape[-2:]
    for row in range(rows // 10, rows, max(rows // 12, 4)):
        image[..., row : row + 2, cols - cols // 30 : cols - 6] = 230
    strokes = np.random.default_rng(0).random((7, 60)) < 0.5
    block = np.kron(strokes, np.ones((2, 2), dtype=bool))[: rows - 8, : cols - 8]
    image[..., 8 : 8 + block.shape[0], 8 : 8 + block.shape[1]][..., block] = 220
