"""Progress of a command that may take longer than a second."""

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from time import monotonic
from typing import TypeVar

from circnav_mav.cli.exits import say
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


@contextmanager
def flights(done: int, total: int) -> Iterator[Callable[[bool], None]]:
    """Show the flights done, the flights not kept, and the time left: a bar on a terminal,
    otherwise a line every 10 s. Yield a function to call after each flight: show(kept)."""
    before = done
    began = reported = monotonic()
    lost = 0
    on_terminal = sys.stderr.isatty()
    with progress("flights", total, done) as update:

        def show(kept: bool) -> None:
            nonlocal done, lost, reported
            done += 1
            lost += not kept
            update(done, f"{done} of {total}, {lost} not kept")
            now = monotonic()
            if not on_terminal and now - reported >= 10.0:
                reported = now
                left = (total - done) * (now - began) / (done - before)
                say(f"  {done} of {total} flights, {left:.0f} s left")

        yield show
