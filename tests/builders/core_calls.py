"""Every call that the core offers, with hostile arguments, and what is done with the answer."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np

from tests.builders.hostile import Hostile
from tests.builders.volume_calls import VOLUME_CALLS

REFUSALS = (ValueError, TypeError)
SOLVERS = ["closed_form", "paper_four_points", "paper_two_lines", "linear"]


def minimal(h: Hostile, name: str, rows: int, dimension: int, *settings: Any) -> Any:
    lead = h.batch()
    count = int(np.prod(lead))
    scenes = [h.scene(rows, dimension) for _ in range(count)]
    points = np.array([p[:, :2] if name.endswith("four_points") else p for p, _ in scenes])
    x = (
        points.reshape(*lead, rows, 2 if name.endswith("four_points") else 3)
        if count
        else np.empty((0, rows, 2))
    )
    lines = np.array([s for _, s in scenes]).reshape(*lead, rows, 2, 3)
    if name == "two_lines":
        x, lines = x.reshape(*lead, 2, 2, 3), lines[..., ::2, :, :]
    return getattr(h.core, name)(h.array(x), h.array(lines), *settings)


def steps(h: Hostile) -> tuple[Any, Any, Any]:
    return h.count(0, 1, 3), h.number(h.pick([0.0, 0.24])), threads(h)


def threads(h: Hostile) -> Any:
    return h.count(1, 1, 1, 2)


def mixed(h: Hostile, name: str, *settings: Any) -> Any:
    lead, rows = h.batch(), h.pick([0, 6, 7, 8, 12, 13, 20])
    points = h.random.uniform(0, 500, (*lead, rows, 3)) * [1, 1, name != "two_conics" or h.spoils()]
    planes = h.random.normal(size=(*lead, rows, 4))
    return getattr(h.core, name)(h.array(points), h.array(planes), *settings)


def pairs(h: Hostile, *settings: Any) -> Any:
    lead = h.batch()
    sides = (
        h.random.uniform(-500, 500, (*lead, 3, 3)) * h.pick([1.0, 1.0, 0.0, 1e-30, 1e50]) for _ in range(2)
    )
    return h.core.three_points(*map(h.array, sides), *settings)


def estimate(h: Hostile) -> Any:
    table, _, model = h.lines()
    return h.core.estimate(table, h.options(model))


def refine(h: Hostile) -> Any:
    table, rows, model = h.lines()
    return h.core.refine(table, h.chosen(rows), h.transform(), h.options(model))


def white_residuals(h: Hostile) -> Any:
    table, rows, model = h.lines()
    return h.core.white_residuals(table, h.chosen(rows), h.transform(), h.options(model))


def targets(h: Hostile) -> Any:
    """Points on points, lines and planes, a few of each."""
    spans = h.random.integers(1, 4, h.pick([1, 4, 12])) + (h.pick([-3, 9]) if h.spoils() else 0)
    first = np.cumsum([0, *h.random.integers(1, 4, len(spans))])
    dimension = h.pick([2, 3])
    points = h.random.uniform(0, 500, (first[-1], 3)) * [1, 1, dimension - 2]
    spanning = h.random.uniform(-100, 100, (len(spans), 3, 3)) * h.pick([1.0, 1.0, 0.0, 1e-6, 1e50])
    factors = [
        h.pick([None, h.array(np.full(size, h.number(2.0), object) if h.spoils() else np.full(size, 2.0))])
        for size in (len(points), len(spans))
    ]
    about = h.array(points), h.array(first, np.int32), h.array(spanning), h.array(spans, np.int32)
    return h.core.Table.of_targets(*about, *factors, dimension=h.count(dimension))


def maximise(h: Hostile) -> Any:
    table = h.lines()[0] if h.spoils() else targets(h)
    return h.core.maximise(table, h.transform(), h.options(h.model()))


def certificate(h: Hostile) -> Any:
    weights = h.pick([None, h.array(np.full(h.pick([5, 20]), 0.5))])
    if h.pick([True, False]):
        table, rows, model = h.lines()
        about = h.chosen(rows), h.transform(), h.options(model)
        return h.core.certificate(table, *about, weights=weights)
    about = h.chosen(h.pick([1, 2, 3, 4, 5, 12])), h.transform(), h.options(h.model())
    return h.core.certificate(h.pick([h.planes, lambda: targets(h)])(), *about, weights=weights)


def noise_sums(h: Hostile) -> Any:
    table, rows, model = h.lines()
    side = h.unknowns + h.spoils()
    root = h.random.normal(size=(side, side)) * 1e-2
    groups = [h.codes(rows, most) for most in (1, 3, rows)][: h.pick([0, 1, 3])]
    about = h.transform(), h.options(model), h.array(root @ root.T), groups
    known = {"known_px": h.pick([True, False]), "known_mm": h.pick([True, False])}
    known["time"] = h.pick([None, h.array(np.cumsum(h.random.random(rows)) * h.pick([0.0, 1.0, 1e9]))])
    return h.core.noise_sums(table, h.chosen(rows), *about, **known)


def extent(h: Hostile) -> Any:
    table, rows, _ = h.lines()
    return h.core.extent(table, h.pick([None, h.chosen(rows)]))


def residual_vectors(h: Hostile) -> Any:
    return h.core.residual_vectors(h.lines()[0], h.transform())


def stretch_length(h: Hostile) -> Any:
    rows = h.pick([1, 15, 16, 40, 200])
    residuals = np.cumsum(h.random.normal(size=(rows, 3)), axis=0) * h.pick([0.0, 1.0, 1e59])
    return h.core.stretch_length(h.array(residuals), h.codes(rows, h.pick([1, rows, 10**6])))


def blobs(h: Hostile) -> Any:
    shape = tuple(h.random.integers(1, h.pick([3, 12, 40]), 2))
    scales = [h.number(s) for s in (1.0, 1.5, 2.5, 4.0)][: h.pick([0, 1, 3, 4, 4])]
    mask = h.array(h.random.random(shape) < h.pick([0.0, 0.9, 1.0]), np.uint8)
    found = h.core.BlobFilter(mask, scales * (100 if h.spoils() else 1), h.count(1, 2, 3, 50))
    image = h.random.random(h.pick([shape, shape, shape, shape[::-1]])) * h.pick([0.0, 1.0, 255.0, 1e30])
    limits = [h.number(x) for x in (0.0, 0.0, 0.5, 0.5)]
    return found.detect(h.array(image, np.float32), h.count(1, 5, 10**6), *limits, h.pick([True, False]))


def trials(h: Hostile, size: int, rows: int, dimension: int) -> tuple[Any, Any]:
    scenes = [h.scene(rows, dimension) for _ in range(size)]
    points = np.array([p for p, _ in scenes]).reshape(size, rows, 3)
    return h.array(points), h.array(np.array([s for _, s in scenes]).reshape(size, rows, 2, 3))


def study_trials(h: Hostile) -> Any:
    size, rows, dimension = h.pick([0, 1, 3]), h.rows(), h.pick([2, 3])
    return h.core.study_trials(
        *trials(h, size, rows, dimension),
        h.array(h.random.integers(0, 2**63, size), np.uint64),
        dimension=h.count(dimension),
        solver="best" if h.spoils() else h.pick(SOLVERS),
        likelihood=h.pick([True, False]),
        threshold_mm=h.number(5.0),
        level_px=h.number(h.pick([0.0, 1.0])),
        level_mm=h.number(h.pick([0.0, 1.0])),
        confidence=h.number(0.99),
        max_samples=h.pick([0, -1, 2**40]) if h.spoils() else h.pick([1, 50]),
        threads=threads(h),
    )


def study_bounds(h: Hostile) -> Any:
    size, rows, dimension = h.pick([0, 1, 3]), h.rows(), h.pick([2, 3])
    truth = np.tile(np.eye(4), (size, 1, 1)) * h.pick([0.24, 0.0, 1e50])
    return h.core.study_bounds(
        *trials(h, size, rows, dimension),
        h.array(h.random.random((size, rows)) < 0.8, bool),
        h.array(truth),
        dimension=h.count(dimension),
        level_px=h.number(h.pick([0.0, 1.0])),
        level_mm=h.number(h.pick([0.0, 1.0])),
        threads=threads(h),
    )


def agreement(h: Hostile) -> Any:
    """Correspondences of one to three rows each."""
    each = h.pick([1, 2, 3])
    rows = each * h.pick([1, 5, 12])
    planes = h.random.normal(size=(rows, 4)) * [1, 1, 1, 50]
    table = h.core.Table.of_planes(
        h.array(h.random.uniform(0, 500, (rows, 3))),
        h.array(planes / np.linalg.norm(planes[:, :3], axis=1, keepdims=True)),
        h.array(np.arange(0, rows + 1, each), np.int32),
    )
    residuals = h.array(np.abs(h.random.normal(size=rows // each)) * h.pick([1.0, 0.0, 1e30]))
    return h.core.agreement(table, h.transform(), residuals, h.number(h.pick([5.0, 0.0])))


def sightings_of_places(h: Hostile) -> tuple[Any, ...]:
    """Points, and poses of the probe against what they are of: a few targets, placed or not."""
    random, rows, count = h.random, h.pick([1, 3, 8, 14, 30]), h.pick([1, 1, 2, 3])
    dimension, free = h.pick([2, 3]), h.pick([0.0, 0.5, np.inf, np.inf])
    points = random.uniform(0, 500, (rows, 3)) * [1, 1, dimension - 2]
    turns = np.linalg.qr(random.normal(size=(rows, 3, 3)))[0]
    turns *= np.linalg.det(turns)[:, None, None]
    if h.spoils():
        turns[:] = turns[0]
    poses = np.concatenate([turns, random.normal(size=(rows, 3, 1)) * h.pick([50.0, 0.0, 1e6])], axis=2)
    changes = h.pick([None, None, h.array(random.normal(size=(rows, 3, 4)))])
    target, sigma = random.integers(0, count, rows), np.where(random.random(count) < 0.5, free, np.inf)
    return (
        *(h.array(points), h.array(poses), changes),
        *(h.array(np.sort(random.integers(0, rows, rows)), np.int32), h.array(target, np.int32)),
        *(h.array(random.integers(1, 4, count), np.int32), h.array(random.normal(size=(count, 3, 3)) * 100)),
        *(h.array(sigma), h.array(np.minimum(sigma, h.pick([0.0, 0.1, np.inf])))),
        *(h.array(random.integers(-1, 2, count), np.int32), h.count(dimension)),
    )


def find_places(h: Hostile) -> Any:
    *arrays, dimension = sightings_of_places(h)
    start = h.pick([None, None, np.vstack([h.random.normal(size=(3, 4)), [[0, 0, 0, 1]]])])
    return h.core.find_places(
        *arrays,
        dimension=dimension,
        start=None if start is None else h.array(start),
        scales=h.count(1, 1, 2),
        level_px=h.number(h.pick([1.0, 1e-6])),
        level_mm=h.number(h.pick([0.3, 1e-6])),
        rad_per_mm=h.number(h.pick([0.0116, 0.0])),
        levels_known=h.pick([True, False]),
        threshold_mm=h.number(h.pick([5.0, 1e6])),
        max_samples=h.pick([0, -1, 2**40]) if h.spoils() else h.pick([1, 4]),
        seed=h.count(0, 2**64 - 1),
    )


def crc64(h: Hostile) -> Any:
    values = h.random.integers(0, 256, h.pick([0, 1, 7, 8, 9, 100, 4099]))
    return h.core.crc64(h.array(values, np.uint8), h.count(0, 2**64 - 1))


def labels(h: Hostile) -> tuple[Any, Any, Any]:
    """Dots of some frames, where each frame's begin, and the frames' wires."""
    random, frames, wires = h.random, h.pick([1, 2, 5, 0]), h.pick([1, 2, 4, 9])
    counts = random.integers(0, h.pick([1, 5, 12]), frames)
    first = np.concatenate([[0], np.cumsum(counts)]) + (h.pick([0, 0, 1, -1]) if h.spoils() else 0)
    points = random.uniform(0, 500, (int(counts.sum()), 2)) * h.pick([1.0, 1.0, 0.0, 1e50])
    ends = random.uniform(-50, 50, (frames, wires, 2, 3)) * h.pick([1.0, 1.0, 0.0, 1e50])
    return h.array(points), h.array(first, np.int32), h.array(ends)


def search_labels(h: Hostile) -> Any:
    most = h.pick([0, 100, 2000])
    scales = h.number(0.0), h.number(h.pick([0.0, 0.24]))
    reach = h.number(h.pick([1.0, 1e-6, 1e6]))
    return h.core.search_labels(*labels(h), reach, h.count(1, 5), most, 1.0, *scales, h.count(0, 2**64 - 1))


def settle_labels(h: Hostile) -> Any:
    starts = h.random.normal(size=(h.pick([0, 1, 3]), 4, 4)) * h.pick([1.0, 0.0, 1e50])
    return h.core.settle_labels(*labels(h), h.array(starts), h.number(h.pick([1.0, 1e-6, 1e6])))


def shift_labels(h: Hostile) -> Any:
    starts = h.random.normal(size=(h.pick([0, 1, 3]), 4, 4)) * h.pick([1.0, 0.0, 1e50])
    errors = h.number(h.pick([0.2, 1e-6, 1e6])), h.number(h.pick([0.6, 1e-6, 1e6]))
    return h.core.shift_labels(*labels(h), h.array(starts), h.number(h.pick([1.0, 1e-6, 1e6])), *errors)


CALLS: dict[str, Callable[[Hostile], Any]] = {
    "four_points": lambda h: minimal(h, "four_points", 4, 2, *steps(h)),
    "two_lines": lambda h: minimal(h, "two_lines", 4, 3, *steps(h)),
    "three_quadrics": lambda h: mixed(h, "three_quadrics", *steps(h)),
    "three_points": lambda h: pairs(h, h.number(h.pick([0.0, 0.24])), threads(h)),
    "two_conics": lambda h: mixed(h, "two_conics", *steps(h)),
    "paper_two_lines": lambda h: minimal(h, "paper_two_lines", 4, 3, threads(h)),
    "paper_four_points": lambda h: minimal(h, "paper_four_points", 4, 2, threads(h)),
    "linear": lambda h: mixed(h, "linear", h.pick([True, False]), threads(h)),
    "estimate": estimate,
    "refine": refine,
    "white_residuals": white_residuals,
    "certificate": certificate,
    "estimate_correspondences": lambda h: h.core.estimate_correspondences(
        (h.lines()[0] if h.spoils() else h.planes()),
        h.options(h.model()),
        refine=h.pick([True, False]),
        weights=h.pick([None, h.array(np.full(h.pick([5, 20]), 0.5))]),
    ),
    "maximise": maximise,
    "agreement": agreement,
    "noise_sums": noise_sums,
    "extent": extent,
    "residual_vectors": residual_vectors,
    "stretch_length": stretch_length,
    "find_places": find_places,
    "search_labels": search_labels,
    "settle_labels": settle_labels,
    "shift_labels": shift_labels,
    "BlobFilter": blobs,
    "study_trials": study_trials,
    "study_bounds": study_bounds,
    "crc64": crc64,
    **VOLUME_CALLS,
    "kernel": lambda h: len(h.core.kernel()),
}
# What the calls above make or are given.
REACHED = {
    "Table",
    "Options",
    "Transform",
    "Estimate",
    "NoiseSums",
    "Drift",
    "Extent",
    "Agreement",
    "FoundPlaces",
}


def touch(result: Any) -> None:
    """Read every number of a result: memory that was freed or never written would show."""
    if isinstance(result, np.ndarray):
        np.isfinite(result).sum()
    elif isinstance(result, (tuple, list)):
        for part in result:
            touch(part)
    elif not isinstance(result, (int, float)):
        for name in dir(result):
            if not name.startswith("_"):
                touch(
                    getattr(result, name, None) if name != "detect" else None
                ) if result is not None else None


def call(core: ModuleType, seed: int, number: int, name: str) -> bool:
    """Make one call; whether it was answered."""
    random = np.random.default_rng([seed, number])
    try:
        touch(CALLS[name](Hostile(core, random)))
    except REFUSALS as error:
        assert str(error).strip(), f"call {number} of {name} is refused without a word"
        return False
    return True


def missing(core: ModuleType) -> set[str]:
    """What the core offers and no call here reaches."""
    return {name for name in dir(core) if not name.startswith("_")} - set(CALLS) - REACHED
