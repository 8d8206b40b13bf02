"""Calls of the package's public face, and of its command line, as someone makes them who means harm or has slipped."""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Callable
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from click.testing import CliRunner

import sonocal as sc
from sonocal import registration as reg
from sonocal.calibration import calibration_json, parse_calibration
from sonocal.cli.main import main
from sonocal.observations import observations_csv, parse_observations
from sonocal.simulation.scene import simulate_observations
from sonocal.validation import compare, give_verdict, validate
from tests.builders.damage import KINDS
from tests.builders.file_calls import home
from tests.builders.hostile import Hostile
from tests.builders.mixed_tables import mixed_table
from tests.builders.point_calls import pointed
from tests.builders.readers import READERS, sound_files

OPTIONS: dict[str, list[Any]] = {
    "model": ["similarity", "anisotropic"],
    "weighting": ["likelihood", "geometric"],
    "threshold_mm": [5.0, "auto", 0.5, 50],
    "sigma_px": [None, 1.0],
    "sigma_mm": [None, 0.5],
    "confidence": [0.9999, 0.9],
    "max_samples": [100, 1000],
    "exhaustive_samples": [200, 0, 10],
    "seed": [0, 7],
    "fit_split": [None, ""],
    "test_split": [None, "test"],
    "image_size_px": [None, (500, 500), (500, 500, 500)],
    "tolerance_mm": [2.0, 0.1],
    "scanner_mm_per_px": [None, 0.24, (0.2, 0.3)],
    "marker_above_image": [False, True],
    "expected_rotation": [None, np.eye(3)],
    "treshold": [1],
}
ODD = [
    None,
    True,
    "1",
    "",
    b"a",
    [],
    {},
    [1],
    -1,
    0,
    1.5,
    10**30,
    float("nan"),
    float("inf"),
    1e300,
    np.float64(3),
    np.eye(2),
    object,
]
NEEDLE = b'[[line]]\nname = "a"\nframe = "Needle"\nfrom_mm = [0.0, 0.0, 0.0]\nto_mm = [0.0, 0.0, -333.0]\n'
# Of the commands that write a report, how many are asked not to.
UNREPORTED = 0.98
# Of commands, what is asked of files: each is damaged now and then.
COMMANDS: list[list[str]] = [
    ["calibrate", "table.csv", "-o", "out", "--overwrite"],
    ["calibrate", "solid.csv", "-o", "out", "--overwrite", "--no-report", "--json"],
    ["calibrate", "mixed.csv", "-o", "out", "--overwrite", "--no-report"],
    ["info", "mixed.csv"],
    ["validate", "calibration.json", "mixed.csv", "-o", "out", "--overwrite"],
    ["validate", "calibration.json", "table.csv", "-o", "out", "--overwrite", "--no-report"],
    ["info", "table.csv"],
    ["info", "calibration.json", "--json"],
    ["info", "needle.toml"],
    ["export", "calibration.json", "--to", "plus", "-o", "a.xml", "--overwrite", "--force"],
    [
        "export",
        "calibration.json",
        "--to",
        "plus",
        "--into",
        "devices.xml",
        "-o",
        "b.xml",
        "--overwrite",
        "--force",
    ],
    ["export", "calibration.json", "--to", "itk", "-o", "a.tfm", "--overwrite", "--force"],
]
FLAGS = [
    *(
        ["--no-report"],
        ["--json"],
        ["--seed", "99999999999999999999"],
        ["--seed", "1.5"],
        ["--threshold-mm", "nan"],
    ),
    *(
        ["--threshold-mm", "auto"],
        ["--tolerance-mm", "-1"],
        ["--image-size", "0x0"],
        ["--image-size", "500x500"],
    ),
    *(
        ["--sigma-px", "1e300"],
        ["--model", "anisotropic"],
        ["--fit-split", "no"],
        ["--max-samples", "0"],
        ["--nonsense"],
    ),
]


def options(h: Hostile) -> dict[str, Any]:
    chosen = [name for name in OPTIONS if h.random.random() < 0.15 and (name != "treshold" or h.spoils())]
    return {name: h.pick(ODD) if h.spoils() else h.pick(OPTIONS[name]) for name in chosen}


def mixed(h: Hostile) -> sc.Observations:
    """A table of points, lines and planes."""
    rows = mixed_rows(int(h.random.integers(50)), h.pick([1, 3, 8]), h.pick([True, False]))
    scale = h.pick([1.0, 1e-3, 1e6, 1e-9, 0.0]) if h.spoils() else 1.0
    names = h.pick([rows.target, rows.frame.astype(str), np.full(len(rows), "wall")])
    return sc.Observations.of_targets(
        h.array(rows.points_px), h.array(rows.spanning_mm * scale), frame=rows.frame, target=names
    )


def table(h: Hostile) -> sc.Observations:
    if h.random.random() < 0.2:
        return mixed(h)
    dimension = h.pick([2, 2, 3])
    rows = simulated_rows(dimension, h.pick([4, 5, 8, 20, 40]), int(h.random.integers(50)))
    columns: dict[str, Any] = {"frame": rows.frame, "target": rows.target}
    if h.spoils():
        columns[h.pick(["frame", "target", "split", "sigma_px", "sigma_mm", "extra"])] = h.pick(
            [
                *ODD,
                h.array(rows.frame, np.int64),
                h.array(rows.points_px),
                {"a": [1]},
                {"time_s": rows.target},
            ]
        )
    if h.spoils():
        columns["extra"] = {"time_s": h.array(rows.frame * 0.1) if h.spoils() else rows.frame.astype(str)}
    scale = h.pick([1.0, 1.0, 1.0, 1e-3, 1e6, 1e-9, 0.0])
    return sc.Observations(
        h.array(rows.points_px), h.array(rows.segments_mm * (scale if h.spoils() else 1.0)), **columns
    )


def whole(found: sc.Calibration, h: Hostile) -> None:
    """Everything that is asked of a calibration."""
    give_verdict(found)
    list(found.diagnostics)
    parse_calibration(calibration_json(found), "again.json")
    if found.covariance is not None:
        found.predicted_errors()
        found.predict(h.array(h.random.uniform(0, 500, (3, found.dimension))))
    found.probe_from_image @ h.array(h.random.uniform(0, 500, (2, 3)))


def calibrated(h: Hostile) -> None:
    whole(sc.calibrate(table(h), **options(h)), h)


def validated(h: Hostile) -> None:
    found = sound()
    validate(h.pick([found, found, *ODD[:2]]), h.pick([table(h), *ODD[:2]]), resample=False)
    compare(found, h.pick([found, sc.calibrate(table(h)), *ODD[:2]]))


def registered(h: Hostile) -> None:
    size = h.pick([0, 1, 3, 7, 20])
    points, lines = h.random.uniform(-1, 1, (2, size, 3)), h.random.uniform(-100, 100, (2, size, 2, 3))
    planes = h.pick([h.random.normal(size=(2, size, 4)), h.random.normal(size=(2, size, 3, 3))])
    kinds: list[Callable[[], Any]] = [
        lambda: reg.constraints.point_point(h.array(points[0]), h.array(points[1])),
        lambda: reg.constraints.point_line(h.array(points[0]), h.array(lines[0])),
        lambda: reg.constraints.point_plane(h.array(points[0]), h.array(planes[0])),
        lambda: reg.constraints.line_line(h.array(lines[0]), h.array(lines[1])),
        lambda: reg.constraints.line_plane(h.array(lines[0]), h.array(planes[0])),
        lambda: reg.constraints.plane_plane(h.array(planes[0]), h.array(planes[1])),
    ]
    chosen = [h.pick(kinds)() for _ in range(h.pick([1, 1, 2, 3]))]
    given = h.pick(ODD) if h.spoils() else chosen[0] if len(chosen) == 1 else reg.constraints.rows(*chosen)
    how = {
        name: value
        for name, value in options(h).items()
        if name in ("threshold_mm", "confidence", "seed", "max_samples")
    }
    reg.register(given, **how)


def parsed(h: Hostile) -> None:
    """Text of a table, damaged."""
    content = damaged(h, h.pick(sound_tables()))
    whole(sc.calibrate(parse_observations(content, "a.csv")), h)


def loaded(h: Hostile) -> None:
    whole(parse_calibration(damaged(h, calibration_json(sound())), "a.json"), h)


def commanded(h: Hostile) -> None:
    """A command of damaged files, in a folder of its own."""
    command = [*h.pick(COMMANDS), *(h.pick(FLAGS) if h.random.random() < 0.5 else [])]
    # A report takes a hundred times as long as the rest of a command.
    if "out" in command and h.random.random() < UNREPORTED and "--no-report" not in command:
        command.append("--no-report")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for file, content in files().items():
            (folder / file).write_bytes(damaged(h, content) if file in command else content)
        there = [
            str(folder / word) if "." in word and not word.startswith("-") and word[0].isalpha() else word
            for word in command
        ]
        there = [str(folder / "out") if word == "out" else word for word in there]
        done = CliRunner(env={"TERM": "dumb", "COLUMNS": "80"}).invoke(main, there)
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    assert done.exit_code in {0, 1, 2}, done.output
    if done.exit_code:
        raise sc.SonocalError("refused")


def read(h: Hostile) -> None:
    """A damaged file of any format, by its reader."""
    name = h.pick(sorted(READERS))
    path = home() / f"input{READERS[name].suffix}"
    path.write_bytes(damaged(h, h.pick(sound_files(name))))
    READERS[name].read(path)


def damaged(h: Hostile, content: bytes) -> bytes:
    for _ in range(h.pick([0, 1, 2, 4])):
        kind = h.pick(KINDS)
        content = kind(content, *map(int, h.random.integers(10**6, size=2))) if content else content
    return content


@cache
def simulated_rows(dimension: int, count: int, seed: int) -> sc.Observations:
    return simulate_observations(dimension, count, seed=seed).observations


@cache
def mixed_rows(seed: int, count: int, flat: bool) -> sc.Observations:
    return mixed_table(seed, count, flat=flat)[1]


@cache
def sound_tables() -> list[bytes]:
    """Tables of needles in 2D and 3D, and of targets of every kind."""
    needles = [simulate_observations(dimension, 12, seed=1).observations for dimension in (2, 3)]
    return [
        observations_csv(rows)
        for rows in (*needles, *(mixed_table(1, flat=flat)[1] for flat in (True, False)))
    ]


@lru_cache
def sound() -> sc.Calibration:
    return sc.calibrate(simulate_observations(2, 20, seed=1).observations)


@lru_cache
def files() -> dict[str, bytes]:
    return {
        "table.csv": observations_csv(simulate_observations(2, 20, seed=1).observations),
        "mixed.csv": observations_csv(mixed_table(1)[1]),
        "solid.csv": observations_csv(simulate_observations(3, 12, seed=1).observations),
        "calibration.json": calibration_json(sound()),
        "needle.toml": NEEDLE,
        "devices.xml": b"<PlusConfiguration>\n  <CoordinateDefinitions/>\n</PlusConfiguration>\n",
    }


CALLS: dict[str, Callable[[Hostile], Any]] = {
    "calibrate": calibrated,
    "validate": validated,
    "points": lambda h: pointed(h, sound()),
    "register": registered,
    "parse_observations": parsed,
    "parse_calibration": loaded,
    "calibrate again": calibrated,
    "register again": registered,
    "parse again": parsed,
    "command": commanded,
    "read": read,
}


def call(_: Any, seed: int, number: int, name: str) -> bool:
    """Make one call; whether it was answered. A sentence is one line; anything else that is raised is a fault."""
    random = np.random.default_rng([seed, number])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            CALLS[name](Hostile(None, random))
        except sc.SonocalError as error:
            assert str(error).strip(), f"call {number} of {name} is refused without a word"
            assert "\n" not in str(error), f"call {number} of {name}: {error}"
            return False
    return True


def missing(_: Any) -> set[str]:
    """Nothing: the face is what the laws of the package's names reach."""
    return set()
