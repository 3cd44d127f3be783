"""Progress of a command that may take longer than a second."""

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from time import monotonic
from typing import TypeVar

from circnav_mav.foreign import printable

T = TypeVar("T")
Show = Callable[[float, str], None]
"""Function that takes the amount done and a note."""


@contextmanager
def progress(what: str, total: float | None = None, done: float = 0.0) -> Iterator[Show]:
    """Show on a terminal what the command does, and the elapsed time. Print nothing elsewhere.

    total: amount of work, to show a bar and the time left. done: amount that is done already.
    """
    if not sys.stderr.isatty():
        yield _ignored
        return
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import (
        BarColumn,
        Progress,
        ProgressColumn,
        SpinnerColumn,
        TaskProgressColumn,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns: list[ProgressColumn] = [SpinnerColumn(), TextColumn("{task.description}")]
    if total is not None:
        columns += [BarColumn(), TaskProgressColumn(), TextColumn("{task.fields[note]}")]
    columns.append(TimeElapsedColumn())
    if total is not None:
        columns += [TextColumn("left:"), TimeRemainingColumn()]
    bar = Progress(
        *columns,
        console=Console(stderr=True),
        transient=True,
        redirect_stdout=False,
        redirect_stderr=False,
    )
    task = bar.add_task(escape(printable(what)), total=total, completed=int(done), note="")
    shown = monotonic()

    def show(done: float, note: str) -> None:
        nonlocal shown
        # 0.1: least time between two updates, s. A replay reports thousands of steps per second.
        if monotonic() - shown >= 0.1:
            shown = monotonic()
            bar.update(task, completed=done, note=note)

    with bar:
        yield show


def _ignored(done: float, note: str) -> None:
    """Show nothing: the output is no terminal."""


def each(what: str, items: Iterable[T], count: int) -> Iterator[T]:
    """Yield items, and show how many of them are done."""
    with progress(what, count) as show:
        for done, item in enumerate(items):
            show(done, "")
            yield item
