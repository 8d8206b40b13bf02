"""What `sonocal study` shows: the answer first, then the medians behind it."""

from __future__ import annotations

from sonocal.cli.screen.tables import NumberTable
from sonocal.cli.screen.terminal import Terminal
from sonocal.studies import Row, Study, answer_sentences
from sonocal.studies.measures import QUANTITIES
from sonocal.studies.results_file import StudyResults
from sonocal.studies.summary import BOUND

__all__ = ["print_results", "print_study"]


def print_study(study: Study, rows: list[Row]) -> None:
    """Answers, and a table of each quantity of the figure."""
    console = Terminal(highlight=False)
    if study.question:
        console.print(study.question, style="bold", markup=False)
    for sentence in answer_sentences(study, rows):
        console.print(sentence, markup=False)
    statistic = study.figure.statistic if study.figure.form == "curves" else "median"
    for quantity in study.figure.quantities:
        console.print(_table(study, rows, quantity, statistic))


def print_results(found: StudyResults) -> None:
    """What is in a folder of results: the answers, or how far a run is."""
    console, study = Terminal(highlight=False), found.study
    varied = ", ".join(f"{name} ({len(levels)} levels)" for name, levels in study.factors.items())
    console.print(
        f"{found.name}: results of the study {study.name!r}, {study.trials} trials of each of {len(study.cells())} "
        f"combinations of {varied}",
        markup=False,
    )
    if found.rows:
        print_study(study, list(found.rows))
    else:
        console.print("It goes on: no summary is there yet. Start it again, and it takes what is there.")


def _table(study: Study, rows: list[Row], quantity: str, statistic: str) -> NumberTable:
    words = {"median": "median", "p95": "95 % are below", "rms": "rms"}[statistic]
    methods = [*study.methods, BOUND]
    chosen = [row for row in rows if row.quantity == quantity and row.stage == "after"]
    there = [method for method in methods if any(row.method == method for row in chosen)]
    first, *others = study.factors
    table = NumberTable(f"{QUANTITIES[quantity]}, after refinement: {words}", *others, *there, first=first)
    by_cell: dict[tuple[float, ...], dict[str, Row]] = {}
    for row in chosen:
        by_cell.setdefault(tuple(row.levels.values()), {})[row.method] = row
    for levels, own in by_cell.items():
        numbers = [f"{getattr(own[method], statistic):.3g}" if method in own else "" for method in there]
        table.add_row(*(f"{level:g}" for level in levels), *numbers)
    return table
