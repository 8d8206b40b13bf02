"""Arguments of the core as someone gives them who means harm or has slipped."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np

SPECIAL = [np.nan, np.inf, -np.inf, 0.0, -0.0, 1e300, -1e300, 5e-324, 1e60, 1e-60, 1e155, 2**53]
COUNTS = [0, -1, 1, 2, 3, 2**31 - 1, 2**31, -(2**31), 2**63, 2**70]
SCALES = [1.0, 1.0, 1.0, 1e-6, 1e6, 1e-150, 1e50, 1e150]
CODES = [-1, -(2**31), 2**31 - 1, 10**6]


class Hostile:
    """Arguments as someone would give them who means harm, or has slipped; mostly sound, for the rest to be reached."""

    def __init__(self, core: ModuleType, random: np.random.Generator) -> None:
        self.core, self.random = core, random
        self.unknowns = 7  # of the model that goes with the last table
        # Some calls are spoilt in many places, some in none.
        self.malice = random.choice([0.0, 0.02, 0.1, 0.4])

    def spoils(self) -> bool:
        return bool(self.random.random() < self.malice)

    def pick(self, choices: list[Any]) -> Any:
        return choices[int(self.random.integers(len(choices)))]

    def number(self, sound: float) -> Any:
        return self.pick([*SPECIAL, -sound, None, "1"]) if self.spoils() else sound

    def count(self, *sound: int) -> Any:
        return self.pick([*COUNTS, 1.5, None]) if self.spoils() else self.pick(list(sound))

    def array(self, values: Any, dtype: Any = float) -> Any:
        """The values, now and then with others among them, of another shape, stride or type."""
        array = np.ascontiguousarray(values, dtype=dtype)
        if self.spoils() and array.size:
            array = array.copy()
            places = self.random.integers(array.size, size=int(self.random.integers(1, 4)))
            array.flat[places] = self._intruders(array.dtype, len(places))
        if self.spoils():
            array = self._reshaped(array)
        return self._retyped(array) if self.spoils() else array

    def _intruders(self, dtype: np.dtype[Any], count: int) -> Any:
        if dtype.kind == "f":
            with np.errstate(over="ignore"):
                return self.random.choice(SPECIAL, count).astype(dtype)
        return np.array([self.pick(CODES) for _ in range(count)]).astype(dtype)

    def _reshaped(self, array: Any) -> Any:
        axis = int(self.random.integers(max(array.ndim, 1)))
        changes = [
            lambda a: a[:0],
            lambda a: np.delete(a, 0, axis=axis) if a.ndim and a.shape[axis] else a,
            lambda a: np.concatenate([a, a], axis=axis) if a.ndim else a,
            lambda a: a[None],
            lambda a: a.ravel(),
            lambda a: a.reshape(*a.shape, 1),
            lambda a: np.empty((0,) * a.ndim, dtype=a.dtype),
        ]
        return np.ascontiguousarray(self.pick(changes)(array))

    def _retyped(self, array: Any) -> Any:
        changes = [
            lambda a: a[::-1],
            lambda a: np.repeat(a, 2, axis=0)[::2] if a.ndim else a,
            np.asfortranarray,
            lambda a: a.astype(np.float32),
            lambda a: a.astype(">f8"),
            lambda a: a.astype(object),
            lambda a: a.tolist(),
            lambda a: None,
        ]
        with np.errstate(over="ignore", invalid="ignore"):
            return self.pick(changes)(array)

    def scene(self, rows: int, dimension: int) -> tuple[Any, Any]:
        """Points and the lines through where a similarity carries them, near a configuration that is none at times."""
        random, size = self.random, self.pick(SCALES) if self.spoils() else 1.0
        points = np.zeros((rows, 3))
        points[:, :dimension] = random.uniform(0, 500, (rows, dimension))
        along = random.normal(size=(rows, 3))
        if dimension == 3 and rows > 1:
            points[1::2] = points[0 : 2 * (rows // 2) : 2] + random.normal(size=(rows // 2, 3))
            along[1::2] = along[0 : 2 * (rows // 2) : 2] = points[1::2] - points[0 : 2 * (rows // 2) : 2]
        if self.spoils():
            points, along = self.pick(DEGENERATE)(points, along)
        turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
        turn *= np.sign(np.linalg.det(turn))
        with np.errstate(all="ignore"):
            middle = 0.24 * points @ turn.T + random.normal(size=3) * 100
            middle += random.normal(size=middle.shape) * self.pick([0.0, 0.3, 3.0, 1000.0])
            along = along @ turn.T * 30
            segments = np.stack([middle - along, middle + along], axis=1)
            return points * self.pick([1.0, size]), segments * size

    def batch(self) -> tuple[int, ...]:
        return self.pick([(), (1,), (3,), (17,), (2, 3), (0,), (1,) * 20 if self.spoils() else (4,)])

    def rows(self) -> int:
        return self.pick([1, 2, 3, 4, 5, 6, 8, 12, 20, 33])

    def codes(self, rows: int, most: int) -> Any:
        return self.array(self.random.integers(0, max(most, 1), rows), np.int32)

    def sightings(self, rows: int) -> Any:
        groups = self.pick([np.arange(rows) // 2, np.arange(rows) // 3, np.arange(rows), np.zeros(rows)])
        return self.array(groups, np.int32)

    def factors(self, rows: int) -> Any:
        return self.pick([None, self.array(self.random.uniform(0.5, 2, rows))])

    def lines(self) -> tuple[Any, int, str]:
        """A table, how many rows it has and a model."""
        dimension, rows = self.pick([2, 3]), self.rows()
        model = self.model()
        self.unknowns = 6 + {"similarity": 1, "rigid": 0, "anisotropic": dimension}[model]
        points, segments = self.scene(rows, dimension)
        table = self.core.Table.of_lines(
            self.array(points),
            self.array(segments),
            self.sightings(rows) if dimension == 3 else None,
            self.pick([None, self.codes(rows, rows // 2)]),
            self.pick([None, self.codes(rows, 2)]),
            self.factors(rows),
            self.factors(rows),
            dimension=self.count(dimension),
        )
        return table, rows, model

    def planes(self) -> Any:
        rows = self.pick([1, 7, 8, 9, 14, 30])
        points = self.random.uniform(0, 500, (rows, 3)) * self.pick(SCALES if self.spoils() else [1.0])
        planes = self.random.normal(size=(rows, 4)) * [1, 1, 1, 50]
        planes[:, :3] /= np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
        first = np.unique([0, *self.random.integers(0, rows, 4), rows])
        return self.core.Table.of_planes(self.array(points), self.array(planes), self.array(first, np.int32))

    def model(self) -> str:
        return str(self.pick(["similarity", "anisotropic", "rigid"]))

    def options(self, model: str = "similarity") -> Any:
        return self.core.Options(
            model=self.pick(["rigid", "anisotropic", "", None]) if self.spoils() else model,
            scale=self.number(self.pick([0.24, 1e-9, 1e9]) if model == "rigid" else 0.0),
            weighting="" if self.spoils() else self.pick(["likelihood", "geometric"]),
            threshold=self.number(self.pick([5.0, 0.0, 1e-3, np.inf])),
            level_px=self.number(self.pick([0.0, 1.0, 1e-9])),
            level_mm=self.number(self.pick([0.0, 1.0, 1e9])),
            confidence=self.number(self.pick([0.99, 0.5])),
            max_samples=self.pick([0, -1, 2**31, 2**70]) if self.spoils() else self.pick([1, 20, 300]),
            exhaustive_samples=self.pick([-1, 2**31, 2**20 + 1]) if self.spoils() else self.pick([0, 200]),
            seed=self.count(0, 2**64 - 1),
        )

    def transform(self) -> Any:
        turn = np.linalg.qr(self.random.normal(size=(3, 3)))[0]
        return self.core.Transform(
            self.array(turn),
            self.array(self.random.normal(size=3) * self.pick([100.0, 1e55])),
            self.array(np.full(3, self.pick([0.24, 1e-300, 1e55]))),
        )

    def chosen(self, rows: int) -> Any:
        return self.array(
            self.random.random(rows) < (0.0 if self.spoils() else self.pick([0.5, 1.0, 1.0])), bool
        )


DEGENERATE: list[Callable[[Any, Any], tuple[Any, Any]]] = [
    lambda x, along: (np.zeros_like(x), along),
    lambda x, along: (x * [1, 0, 0], along),
    lambda x, along: (x, np.broadcast_to(along[:1], along.shape)),
    lambda x, along: (x, along * 0),
    lambda x, along: (x, along * [1, 1, 0]),
    lambda x, along: (x + 1e12, along),
    lambda x, along: (np.broadcast_to(x[:1], x.shape), np.broadcast_to(along[:1], along.shape)),
    lambda x, along: (x, along * 1e-12),
]
