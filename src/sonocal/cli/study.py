"""The command `sonocal study`."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click
from click.shell_completion import CompletionItem

from sonocal.cli.help import command
from sonocal.cli.options import WRITTEN, console
from sonocal.cli.outputs import reserve
from sonocal.cli.screen.plain import say, say_json
from sonocal.errors import UnsupportedError

if TYPE_CHECKING:
    from rich.console import RenderableType

    from sonocal.studies import Row, Store, Workers

__all__ = ["study"]

# Where stderr is no terminal, a line so often, s.
LINE_EVERY_S = 10.0


def _names(_: click.Context, __: click.Parameter, begun: str) -> list[CompletionItem]:
    """What a shell may put in the place of a word that was begun."""
    from sonocal.studies import built_in_names

    names = [CompletionItem(name) for name in built_in_names() if name.startswith(begun)]
    return names or [CompletionItem(begun, type="file")]


@command(
    "Answer a question of practice by thousands of simulated trials.",
    groups={
        "What is simulated": ("trials", "seed"),
        "Who computes it": ("workers", "scheduler"),
        "What is written and shown": ("output", "figure", "as_json"),
    },
    examples=(
        "sonocal study",
        "sonocal study needles",
        "sonocal study needles --trials 100 -o quick",
    ),
)
@click.argument("name", metavar="[NAME|FILE.toml]", required=False, shell_complete=_names)
@click.option(
    "-o",
    "--output",
    type=WRITTEN,
    help="Folder for results, figure and summary; continued if it holds a part.  [default: study-NAME]",
)
@click.option(
    "--trials", type=click.IntRange(1), help="Of every combination of levels.  [default: the study's]"
)
@click.option("--seed", type=click.IntRange(0), help="Of everything random.  [default: the study's]")
@click.option(
    "--workers",
    type=click.IntRange(1),
    metavar="N",
    help="Dask worker processes on this machine.  [default: threads on all cores]",
)
@click.option("--scheduler", metavar="tcp://HOST:PORT", help="An existing Dask cluster, instead.")
@click.option("--no-figure", "figure", is_flag=True, flag_value=False, default=True, help="Draw no figure.")
@click.option(
    "--json", "as_json", is_flag=True, help="Print the summary as JSON on stdout instead of tables."
)
def study(
    name: str | None,
    *,
    output: Path | None,
    trials: int | None,
    seed: int | None,
    workers: int | None,
    scheduler: str | None,
    figure: bool,
    as_json: bool,
) -> None:
    """Run a study: the paper's experiments, a question of practice, or your own (TOML).

    Without a name, list the studies there are. A run that was stopped goes on where it stopped when it is started
    again; the results are the same whoever computes them.
    """
    from sonocal.studies import built_in_names, load_study, run_study, summarise

    if workers is not None and scheduler is not None:
        raise click.UsageError("give --workers or --scheduler, not both")
    if name is None:
        for each in built_in_names():
            loaded = load_study(each)
            console().print(_listed(each, loaded.question or loaded.title))
        return
    changes = {"trials": trials, "seed": seed}
    loaded = load_study(name, **{key: value for key, value in changes.items() if value is not None})
    folder = output or Path(f"study-{loaded.name}")
    if not (folder / "manifest.json").exists():
        reserve(*(folder / name for name in ("summary.csv", "summary.json", f"{loaded.name}.png")))
    with _workers(workers, scheduler) as who, _progress(loaded.name) as progress:
        store = run_study(loaded, folder, who, progress=progress)
    rows = summarise(store)
    written = _write(folder, store, rows, figure=figure)
    if as_json:
        from sonocal.studies.summary import summary_json

        say_json(summary_json(store, rows))
        return
    from sonocal.cli.screen.study import print_study

    print_study(loaded, rows)
    say(f"Wrote {', '.join(str(folder / file) for file in written)}")


def _workers(workers: int | None, scheduler: str | None) -> AbstractContextManager[Workers]:
    from sonocal.studies import cluster, threads

    if scheduler is not None:
        return cluster.existing(scheduler)
    return threads() if workers is None else cluster.local(workers)


def _write(folder: Path, store: Store, rows: list[Row], *, figure: bool) -> list[str]:
    from sonocal.files import write_into_folder
    from sonocal.studies.figures import figure_png
    from sonocal.studies.summary import summary_csv, summary_json

    files = {"summary.csv": summary_csv(store.study, rows), "summary.json": summary_json(store, rows)}
    if figure:
        try:
            files[f"{store.study.name}.png"] = figure_png(store, rows)
        except UnsupportedError as error:
            say(f"Note: {error}", err=True)
    write_into_folder(folder, files)
    return list(files)


@contextmanager
def _progress(name: str) -> Iterator[Callable[[int, int], None]]:
    """Progress with the time left, on stderr."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from sonocal.cli.screen.terminal import Terminal

    errors = Terminal(stderr=True)
    if not errors.is_terminal:
        yield _lines(name)
        return
    columns = (
        TextColumn(name),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("trials,"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, TextColumn("left"), console=errors, transient=True) as bar:
        task = bar.add_task(name, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def _lines(name: str) -> Callable[[int, int], None]:
    start = shown = time.monotonic()
    before: int | None = None

    def report(done: int, total: int) -> None:
        nonlocal shown, before
        now = time.monotonic()
        before = done if before is None else before
        if now - shown < LINE_EVERY_S or done <= before:
            return
        shown = now
        left = (now - start) * (total - done) / (done - before)
        say(f"{name}: {done} of {total} trials, {left:.0f} s left", err=True)

    return report


def _listed(name: str, words: str) -> RenderableType:
    """A study's name and what it asks, below one another's words where the terminal is narrow."""
    from rich.table import Table
    from rich.text import Text

    row = Table.grid(padding=(0, 1))
    row.add_column(min_width=20, no_wrap=True)
    row.add_column()
    row.add_row(Text(name), Text(words))
    return row
