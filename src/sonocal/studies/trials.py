"""A run of trials of one cell: simulated, calibrated by every method, and measured."""

from __future__ import annotations

import numpy as np

from sonocal.geometry import Array
from sonocal.studies.definition import Cell
from sonocal.studies.measures import bound_errors, calibration_errors, wire_errors
from sonocal.studies.methods import run_method
from sonocal.studies.scene import BLOCK_TRIALS, simulate_block

__all__ = ["run_trials"]


def run_trials(cell: Cell, first: int, last: int) -> dict[str, Array]:
    """Errors of the trials first ... last - 1 of a cell, the same however a cell is cut into runs.

    Args:
        cell: what to simulate, and by which methods.
        first: a multiple of BLOCK_TRIALS.
        last: past the last trial.

    Returns:
        By name, as single precision: ``errors`` (T, M, 2, 4), of every method before and after refinement in the
        order of ERRORS; ``wire_errors`` (T, M, 2, K), mm; ``bound`` and ``bound_draws`` (T, 4).
    """
    blocks = [
        _run_block(cell, first // BLOCK_TRIALS + i, min(BLOCK_TRIALS, last - begin))
        for i, begin in enumerate(range(first, last, BLOCK_TRIALS))
    ]
    return {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}


def _run_block(cell: Cell, block: int, count: int) -> dict[str, Array]:
    scene = cell.scene
    trials = simulate_block(scene, cell.study.seed, cell.key, block).first(count)
    answers = [
        np.stack(run_method(name, scene, trials, threshold_mm=cell.study.threshold_mm), axis=1)
        for name in cell.methods
    ]
    found = np.stack(answers, axis=1)
    bound, draws = bound_errors(scene, trials)
    results = {
        "errors": calibration_errors(scene, found, trials.truth[:, None, None]),
        "wire_errors": wire_errors(found, trials),
        "bound": bound,
        "bound_draws": draws,
    }
    return {name: np.ascontiguousarray(values, dtype=np.float32) for name, values in results.items()}
