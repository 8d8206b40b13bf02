"""A study as data: factors x levels x trials x seed, read from TOML."""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np

from sonocal.errors import FormatError, InputError
from sonocal.files.toml import read_toml_text
from sonocal.geometry.shown import brief
from sonocal.studies.measures import QUANTITIES
from sonocal.studies.methods import METHODS
from sonocal.studies.scene import Scene

__all__ = ["Answer", "Cell", "Figure", "Study", "built_in_names", "load_study"]

Stage = Literal["before", "after"]
Statistic = Literal["median", "p95", "rms"]
SUFFIX = ".toml"


class Figure(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How results are drawn.

    Attributes:
        form: boxes as in the paper, or a statistic's curve over the first factor.
        quantities: one panel each.
        stages: before refinement, after it, or both.
        statistic: of a curve.
        log: a logarithmic axis for the errors.
    """

    form: Literal["boxes", "curves"] = "boxes"
    quantities: tuple[str, ...] = ("rotation_deg", "translation_mm", "scale_mm_per_px")
    stages: tuple[Stage, ...] = ("before", "after")
    statistic: Statistic = "p95"
    log: bool = False

    __repr__ = brief


class Answer(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The sentence that a study ends in, for each level of the other factors.

    Attributes:
        method: whose error, after refinement.
        quantity, statistic: what must stay at or below the goal.
        goal: in the quantity's unit.
        wanted: the least level of the first factor that reaches the goal, or the greatest.
        reached: the sentence, with {x} the level, {value} the error there, {goal}, and {NAME} the level of factor
            NAME.
        missed: the sentence where no level reaches the goal; {x} is the level with the least error.
    """

    method: str = "sonocal"
    quantity: str = "target_mm"
    statistic: Statistic = "p95"
    goal: float
    wanted: Literal["least", "greatest"]
    reached: str
    missed: str

    __repr__ = brief


class Study(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Factors x levels x trials x seed.

    Attributes:
        name: of its files.
        title: of its figure.
        question: what a user asks, if it answers one.
        trials: of every combination of levels.
        seed: of everything random.
        methods: names of METHODS; in every cell those that apply to its scene.
        threshold_mm: of RANSAC (paper section 9).
        scene: settings that stay.
        factors: settings of the scene that vary, each with its levels; the first is a figure's horizontal axis.
        figure: how results are drawn.
        answer: the sentence to end in.
    """

    name: Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", max_length=80)]
    title: str
    question: str = ""
    trials: Annotated[int, msgspec.Meta(ge=1, le=100_000_000)] = 100
    seed: Annotated[int, msgspec.Meta(ge=0)] = 0
    methods: Annotated[list[str], msgspec.Meta(min_length=1)]
    threshold_mm: Annotated[float, msgspec.Meta(gt=0)] = 5.0
    scene: Scene = Scene()
    factors: dict[str, Annotated[list[float | int], msgspec.Meta(min_length=1)]]
    figure: Figure = Figure()
    answer: Answer | None = None

    __repr__ = brief

    def cells(self) -> list[Cell]:
        """Every combination of levels, the last factor varying fastest."""
        names = list(self.factors)
        return [
            Cell(
                dict(zip(names, levels, strict=True)),
                self._scene(dict(zip(names, levels, strict=True))),
                self,
            )
            for levels in itertools.product(*self.factors.values())
        ]

    def _scene(self, levels: dict[str, float]) -> Scene:
        return msgspec.convert(msgspec.structs.asdict(self.scene) | levels, Scene)


@dataclass(frozen=True)
class Cell:
    """One combination of levels.

    Attributes:
        levels: by factor.
        scene: what its trials look like.
        study: it is of.
    """

    levels: dict[str, float]
    scene: Scene
    study: Study

    @property
    def methods(self) -> list[str]:
        """The study's methods that apply here."""
        return [name for name in self.study.methods if METHODS[name].applies(self.scene)]

    @property
    def key(self) -> int:
        """A number that stands for the scene: other cells, methods and trials do not change what is simulated."""
        return int.from_bytes(hashlib.sha256(msgspec.json.encode(self.scene)).digest()[:8], "big")


def built_in_names() -> list[str]:
    """Names of the studies that come with the package."""
    folder = resources.files("sonocal.studies").joinpath("builtin")
    return sorted(
        entry.name.removesuffix(SUFFIX) for entry in folder.iterdir() if entry.name.endswith(SUFFIX)
    )


def load_study(name: str | Path, **changes: Any) -> Study:
    """A built-in study by its name, or one from a TOML file.

    Args:
        name: such as "paper-2d" or "my_study.toml".
        changes: fields to set instead of the file's, such as ``trials=1000``.

    Raises:
        InputError: there is no such study, or it makes no sense.
        FormatError: the file is not a study.
    """
    source, text = _text_of(str(name))
    try:
        study = msgspec.toml.decode(text, type=Study)
        study = msgspec.convert(msgspec.to_builtins(study) | changes, Study)
    except (msgspec.DecodeError, RecursionError) as error:  # a ValidationError too
        raise FormatError(f"{source}: {error}; docs/studies.md lists what a study may hold") from None
    _check(study, source)
    return study


def _text_of(name: str) -> tuple[str, str]:
    if name in built_in_names():
        file = resources.files("sonocal.studies").joinpath("builtin", name + SUFFIX)
        return name, file.read_text(encoding="utf-8")
    if not name.endswith(SUFFIX):
        raise InputError(
            f"there is no study {name!r}; there are {', '.join(built_in_names())}, and any TOML file's name"
        )
    return Path(name).name, read_toml_text(Path(name), "a study")


def _check(study: Study, source: str) -> None:
    for problem in _problems(study):
        raise InputError(f"{source}: {problem}")


def _problems(study: Study) -> Iterator[str]:
    for name in set(study.methods) - set(METHODS):
        yield f"methods: there is no {name!r}; there are {', '.join(METHODS)}"
    for name in study.factors:
        if name not in Scene.__struct_fields__:
            yield f"factors.{name}: is no setting of a scene; those are {', '.join(Scene.__struct_fields__)}"
    if not study.factors:
        yield "factors: at least one setting must vary, or have one level"
    quantities = [*study.figure.quantities, *([study.answer.quantity] if study.answer else [])]
    for name in quantities:
        if name not in QUANTITIES:
            yield f"figure or answer: there is no quantity {name!r}; there are {', '.join(QUANTITIES)}"
    if study.answer and study.answer.method not in study.methods:
        yield f"answer.method: {study.answer.method!r} is not among the methods"
    try:
        cells = study.cells()
    except msgspec.ValidationError as error:
        yield f"factors: {error}"
        return
    for cell in cells:
        yield from _scene_problems(cell, quantities)
    for name in study.methods:
        if not any(name in cell.methods for cell in cells):
            yield f"methods: {name!r} applies to no cell; {METHODS[name].needs}"


def _scene_problems(cell: Cell, quantities: list[str]) -> Iterator[str]:
    scene = cell.scene
    where = ", ".join(f"{name} = {level:g}" for name, level in cell.levels.items())
    for name, value in msgspec.structs.asdict(scene).items():
        if not (np.isfinite(value) and value >= 0):
            yield f"{where}: {name} must be a number, zero or more; got {value}"
    for name in ("image_px", "scale_mm_per_px", "needle_mm", "tilt_deg"):
        if not getattr(scene, name) > 0:
            yield f"{where}: {name} must be more than zero"
    if scene.dimension not in (2, 3):
        yield f"{where}: a probe has 2 or 3 dimensions; got {scene.dimension}"
    if scene.tilt_deg > 90:
        yield f"{where}: a tilt from the normal is at most 90 degrees; got {scene.tilt_deg:g}"
    if not scene.outlier_share < 1:
        yield f"{where}: the share of outliers is less than 1; got {scene.outlier_share:g}"
    if scene.pool and scene.pool < scene.needles:
        yield f"{where}: {scene.needles} needles cannot be taken from a pool of {scene.pool}"
    if not cell.methods:
        yield f"{where}: none of the methods applies; {METHODS[cell.study.methods[0]].needs}"
    if "pra_mm" in quantities and scene.crosswires == 0:
        yield f"{where}: pra_mm needs crosswires, how often the cross-wire is seen in a trial"
