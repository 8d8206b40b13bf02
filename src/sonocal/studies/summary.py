"""Results in numbers, and the sentence that a study ends in."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator

import msgspec
import numpy as np

from sonocal.geometry import Array
from sonocal.geometry.shown import brief
from sonocal.studies.definition import Answer, Cell, Study
from sonocal.studies.measures import ERRORS, QUANTITIES
from sonocal.studies.store import Store

__all__ = [
    "BOUND",
    "STAGES",
    "Row",
    "answer_sentences",
    "errors_of",
    "summarise",
    "summary_csv",
    "summary_json",
]

STAGES = ("before", "after")
BOUND = "bound"


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """Errors of one method, stage and quantity in one cell.

    Attributes:
        levels: of the cell, by factor.
        method, stage, quantity: what it is of; the bound is a method, too.
        trials: errors there are, and how many trials `failed` to give one; those count as errors without end.
        median, q1, q3, p95: quantiles, with 95 % confidence intervals of the median and of `p95`.
        rms: root mean square of the errors there are.
    """

    levels: dict[str, float]
    method: str
    stage: str
    quantity: str
    trials: int
    failed: int
    median: float
    median_low: float
    median_high: float
    q1: float
    q3: float
    p95: float
    p95_low: float
    p95_high: float
    rms: float

    __repr__ = brief


def errors_of(store: Store, index: int, method: str, stage: str, quantity: str) -> Array:
    """Errors (T,) of a cell by its index: of all trials, NaN where a method failed; those of wires one by one.

    The bound's are draws from its distribution.
    """
    if method == BOUND:
        return store.read(index, "bound_draws")[:, ERRORS.index(quantity)]
    at = store.study.cells()[index].methods.index(method)
    values = store.read(index, "wire_errors" if quantity == "pra_mm" else "errors", at)[
        :, STAGES.index(stage)
    ]
    return values.reshape(-1) if quantity == "pra_mm" else values[:, ERRORS.index(quantity)]


def summarise(store: Store) -> list[Row]:
    """All rows of a complete study."""
    return [row for index, cell in enumerate(store.study.cells()) for row in _cell_rows(store, index, cell)]


def _cell_rows(store: Store, index: int, cell: Cell) -> Iterator[Row]:
    quantities = [q for q in QUANTITIES if q in ERRORS or cell.scene.crosswires]
    for at, method in enumerate(cell.methods):
        errors = store.read(index, "errors", at)
        wires = store.read(index, "wire_errors", at)
        for s, stage in enumerate(STAGES):
            for quantity in quantities:
                values = (
                    wires[:, s].reshape(-1) if quantity == "pra_mm" else errors[:, s, ERRORS.index(quantity)]
                )
                yield _row(cell, method, stage, quantity, values)
    draws, rms = store.read(index, "bound_draws"), store.read(index, "bound")
    for q, quantity in enumerate(ERRORS):
        if np.isfinite(draws[:, q]).any():
            exact = float(np.sqrt(np.nanmean(rms[:, q].astype(float) ** 2)))
            yield msgspec.structs.replace(_row(cell, BOUND, "after", quantity, draws[:, q]), rms=exact)


def _row(cell: Cell, method: str, stage: str, quantity: str, values: Array) -> Row:
    there = values[np.isfinite(values)].astype(float)
    # A trial without an answer is worse than any with one.
    ordered = np.sort(np.where(np.isfinite(values), values, np.inf).astype(float))
    median, median_low, median_high = _quantile(ordered, 0.5)
    p95, p95_low, p95_high = _quantile(ordered, 0.95)
    return Row(
        levels=cell.levels,
        method=method,
        stage=stage,
        quantity=quantity,
        trials=len(there),
        failed=len(values) - len(there),
        median=median,
        median_low=median_low,
        median_high=median_high,
        q1=_quantile(ordered, 0.25)[0],
        q3=_quantile(ordered, 0.75)[0],
        p95=p95,
        p95_low=p95_low,
        p95_high=p95_high,
        rms=float(np.sqrt(np.mean(there**2))) if len(there) else np.nan,
    )


def _quantile(ordered: Array, share: float) -> tuple[float, float, float]:
    """A quantile of sorted errors and its 95 % confidence interval from order statistics, exact for any number of them.

    From 0, or without end, where there are too few to say: no error of 50 need be beyond the 95 % of all.

    Source: Conover, Practical Nonparametric Statistics, section 3.2.
    """
    from scipy.stats import binom

    count, last = len(ordered), len(ordered) - 1
    at = share * last
    below = ordered[int(at)]
    above = ordered[min(int(at) + 1, last)]
    middle = below if below == above or at == int(at) else below + (at - int(at)) * (above - below)
    first, end = (int(rank) for rank in binom.ppf([0.025, 0.975], count, share))
    low = ordered[first - 1] if first > 0 else 0.0
    high = ordered[end] if end < count else np.inf
    return float(middle), float(low), float(high)


def summary_csv(study: Study, rows: list[Row]) -> bytes:
    """The rows as a table, a column each factor and field."""
    fields = [name for name in Row.__struct_fields__ if name != "levels"]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*study.factors, *fields])
    for row in rows:
        numbers = [getattr(row, name) for name in fields]
        shown = [f"{value:.6g}" if isinstance(value, float) else value for value in numbers]
        writer.writerow([*(f"{row.levels[name]:g}" for name in study.factors), *shown])
    return text.getvalue().encode()


def answer_sentences(study: Study, rows: list[Row]) -> list[str]:
    """The answer for each level of the factors after the first; none where the study asks nothing."""
    answer = study.answer
    if answer is None:
        return []
    x_name = next(iter(study.factors))
    series: dict[tuple[float, ...], list[Row]] = {}
    for row in rows:
        if (row.method, row.stage, row.quantity) == (answer.method, "after", answer.quantity):
            rest = tuple(level for name, level in row.levels.items() if name != x_name)
            series.setdefault(rest, []).append(row)
    return [_sentence(answer, x_name, own) for own in series.values()]


def _sentence(answer: Answer, x_name: str, rows: list[Row]) -> str:
    def value(row: Row) -> float:
        return float(getattr(row, answer.statistic))

    good = [row for row in rows if value(row) <= answer.goal]
    pick = max if answer.wanted == "greatest" else min
    # A level counts if all easier ones reach the goal, too: chance may lift one above it or sink it below.
    easier = [
        row
        for row in good
        if all(
            other in good
            for other in rows
            if (other.levels[x_name] < row.levels[x_name]) == (answer.wanted == "greatest")
            and other is not row
        )
    ]
    if easier:
        row, template = pick(easier, key=lambda row: row.levels[x_name]), answer.reached
    else:
        row, template = min(rows, key=value), answer.missed
    shown = {"x": f"{row.levels[x_name]:g}", "value": f"{value(row):.2f}", "goal": f"{answer.goal:g}"}
    for name, text in (shown | {name: f"{level:g}" for name, level in row.levels.items()}).items():
        template = template.replace("{" + name + "}", text)
    return template


def summary_json(store: Store, rows: list[Row]) -> bytes:
    """Study, digest, answers and rows, for programs; numbers that are no numbers are null."""
    record = {
        "study": msgspec.to_builtins(store.study),
        "digest": store.digest,
        "answers": answer_sentences(store.study, rows),
        "rows": rows,
    }
    return msgspec.json.format(msgspec.json.encode(record)) + b"\n"
