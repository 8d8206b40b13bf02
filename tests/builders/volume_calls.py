"""Calls of the core on voxels, with hostile arguments."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from tests.builders.hostile import Hostile

COMPOUNDING = ["mean", "maximum", "latest"]
PLUS_COMPOUNDING = ["MEAN", "IMPORTANCE_MASK", "MAXIMUM", "LATEST"]


def word(h: Hostile, choices: list[str]) -> Any:
    return h.pick(["median", "", None]) if h.spoils() else h.pick(choices)


def scene(h: Hostile) -> tuple[Any, Any, Any, tuple[int, int, int]]:
    """Images, their matrices and the lowest voxel of a box, and the shape of that: most images cross it."""
    count, height, width = h.pick([1, 2, 3]), h.pick([2, 5, 20]), h.pick([2, 6, 30])
    pixel = h.pick([np.uint8, np.uint8, np.uint16])
    images = h.random.integers(0, np.iinfo(pixel).max, (count, height, width), dtype=pixel, endpoint=True)
    matrices = h.random.normal(size=(count, 3, 4)) * h.pick([0.3, 0.0, 1e-6, 1e6])
    matrices[..., 3] = h.random.uniform(-3, 12, (count, 3)) * h.pick([1, 1, 1, 1e9])
    low = h.array(h.random.integers(-3, 3, 3) * h.pick([1, 1, 2**19]), np.int32)
    shape = tuple(int(n) for n in h.random.integers(1, h.pick([2, 9, 20]), 3))
    return h.array(images, pixel), h.array(matrices), low, shape


def spans(h: Hostile, images: Any) -> Any:
    """Runs of pixels, in the image mostly."""
    if not isinstance(images, np.ndarray) or images.ndim != 3 or not images.size:
        return h.array(np.zeros((1, 3)), np.int32)
    _, height, width = images.shape
    ends = np.sort(h.random.integers(0, width + 1, (height, 2)), axis=1)
    return h.array(np.column_stack([np.arange(height), ends]), np.int32)


def which(h: Hostile, images: Any) -> Any:
    return h.array(
        h.random.integers(0, max(1, len(images) if images is not None else 1), h.pick([0, 1, 3])), np.int32
    )


def mask(h: Hostile, images: Any) -> Any:
    shape = np.shape(images)[1:3] if np.ndim(images) == 3 else (2, 2)
    return h.array(h.random.random(shape) < 0.8, np.uint8)


def joined(h: Hostile, images: Any) -> Any:
    return h.array(
        h.random.integers(0, 2, max(0, np.shape(images)[0] - 1 if np.ndim(images) else 0)), np.int32
    )


def nearest(h: Hostile) -> Any:
    images, matrices, low, shape = scene(h)
    cells = h.array(np.zeros(shape), np.uint64)
    h.core.insert_nearest(
        cells, low, images, matrices, which(h, images), spans(h, images), word(h, COMPOUNDING)
    )
    return cells


def linear(h: Hostile) -> Any:
    images, matrices, low, shape = scene(h)
    sums = h.array(np.zeros((*(n + 2 for n in shape), 2)))
    h.core.insert_linear(sums, low, images, matrices, which(h, images), spans(h, images))
    return sums


def between(h: Hostile) -> Any:
    images, matrices, low, shape = scene(h)
    cells = h.array(np.zeros(shape), np.uint64)
    about = low, images, matrices, joined(h, images), mask(h, images), word(h, COMPOUNDING)
    h.core.insert_between(cells, *about)
    return cells


def alone(h: Hostile) -> Any:
    images, matrices, low, shape = scene(h)
    cells = h.array(np.zeros(shape), np.uint64)
    about = low, images, matrices, joined(h, images), mask(h, images), word(h, COMPOUNDING)
    ends = {
        "half_mm": h.number(h.pick([0.0, 0.3])),
        "first": h.pick([True, False]),
        "last": h.pick([True, False]),
    }
    h.core.insert_alone(cells, *about, **ends)
    return cells


def settle_cells(h: Hostile) -> Any:
    shape = tuple(h.random.integers(1, 6, 3))
    pixel = h.pick([np.uint8, np.uint16])
    values, counts = h.array(np.zeros(shape), pixel), h.array(np.zeros(shape), np.uint32)
    cells = h.array(h.random.integers(0, 2**63, shape), np.uint64)
    h.core.settle_cells(cells, word(h, COMPOUNDING), h.count(1, 256), values, counts)
    return values, counts


def settle_sums(h: Hostile) -> Any:
    shape = tuple(h.random.integers(1, 6, 3))
    pixel = h.pick([np.uint8, np.uint16])
    values, counts = h.array(np.zeros(shape), pixel), h.array(np.zeros(shape), np.uint32)
    weights = h.random.random((*(n + 2 for n in shape), 1))
    h.core.settle_sums(h.array(np.concatenate([weights * 200, weights], axis=3)), values, counts)
    return values, counts


def average(h: Hostile) -> Any:
    pixel, shape = h.pick([np.uint8, np.uint16]), (h.pick([2, 5, 40]), h.pick([2, 9, 30]))
    image = h.array(h.random.integers(0, np.iinfo(pixel).max, shape, endpoint=True), pixel)
    averaged = h.array(np.zeros(shape), pixel)
    h.core.average_image(image, h.count(1, 2, 3, 7), h.count(1, 2, 5, 127), averaged)
    return averaged


def plus_insert(h: Hostile) -> Any:
    shape = tuple(int(n) for n in h.random.integers(1, 20, 3))
    height, width = h.pick([2, 9, 40]), h.pick([2, 8, 30])
    image = h.array(h.random.integers(0, 256, (height, width)), np.uint8)
    matrix = h.random.normal(size=(3, 4)) * h.pick([0.3, 0.0, 1e3]) + [0, 0, 0, 5]
    values, weights = (
        h.array(np.zeros(shape), np.uint8),
        h.array(h.random.integers(0, 2**16, shape), np.uint16),
    )
    how = word(h, PLUS_COMPOUNDING)
    importance = (
        h.array(h.random.integers(0, 4, (height, width)), np.uint8) if how == "IMPORTANCE_MASK" else None
    )
    pairs = {
        "clip_origin": (h.number(2.0), h.number(0.0)),
        "clip_size": (h.number(h.pick([0.0, 9.0])), h.number(12.0)),
        "fan_angles_deg": (h.number(h.pick([0.0, -40.0])), h.number(h.pick([0.0, 30.0]))),
        "fan_origin": (h.number(10.0), h.number(-2.0)),
        "fan_radii": (h.number(h.pick([0.0, 5.0])), h.number(20.0)),
    }
    said = {
        "compounding": how,
        "optimization": word(h, ["NONE", "PARTIAL", "FULL"]),
        "linear": h.pick([True, False]),
    }
    rejection = h.number(h.pick([-1.0, 9.0]))
    h.core.plus_insert(
        values, weights, image, h.array(matrix), importance, **said, **pairs, rejection=rejection
    )
    return values, weights


def plus_fill_sticks(h: Hostile) -> Any:
    shape = tuple(int(n) for n in h.random.integers(1, 12, 3))
    values = h.array(h.random.integers(0, 256, shape), np.uint8)
    weights = h.array(h.random.integers(0, 2, shape) * 256, np.uint16)
    filled = h.array(np.zeros(shape), np.uint8)
    h.core.plus_fill_sticks(values, weights, h.count(0, 3, 9), h.count(0, 1, 3), filled)
    return filled


VOLUME_CALLS: dict[str, Callable[[Hostile], Any]] = {
    "insert_nearest": nearest,
    "insert_linear": linear,
    "insert_between": between,
    "insert_alone": alone,
    "settle_cells": settle_cells,
    "settle_sums": settle_sums,
    "average_image": average,
    "plus_insert": plus_insert,
    "plus_fill_sticks": plus_fill_sticks,
}
