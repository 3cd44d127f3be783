"""The loop of every program that flies many flights.

A program is a table of rows and a function that flies one row with one seed. The loop flies all
cells (row, seed) on the cores of this computer and returns their results, row by row. With `--keep`
each result is a line of a JSON file, and a cell of this file is not flown again unless it failed.
"""

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterable
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from math import inf
from pathlib import Path
from typing import Any

from circnav_mav.runtime.jobs import cores

Result = dict[str, Any]
Fly = Callable[[str, int], Result]


def parser(
    text: str | None, rows: Iterable[str], seeds: tuple[int, int]
) -> argparse.ArgumentParser:
    """Return a parser with the options of every program. text: docstring of the program. seeds:
    first and last seed by default."""
    every = list(rows)
    found = argparse.ArgumentParser(
        description=text, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    found.add_argument("--rows", nargs="+", choices=every, default=every, metavar="ROW")
    found.add_argument("--seeds", type=int, nargs=2, default=seeds, metavar=("FIRST", "LAST"))
    found.add_argument("--keep", type=Path, metavar="FILE", help="flights flown, one a line")
    found.add_argument("--processes", type=int, default=cores())
    found.add_argument("--minutes", type=float, default=inf, help="time for starting flights")
    return found


def read(path: Path | None) -> dict[tuple[str, int], Result]:
    """Return the newest result of each cell of a file."""
    lines = path.read_text().splitlines() if path is not None and path.is_file() else []
    return {(one["row"], one["seed"]): one for one in map(json.loads, lines)}


def flown(
    fly: Fly, options: argparse.Namespace, pool: Callable[[int], Executor] = ProcessPoolExecutor
) -> dict[str, list[Result]]:
    """Fly the cells that are not in the file, seed by seed, so that an interrupted program has all
    rows. Return the results of each row, including those of the file."""
    found = read(options.keep)
    until = time.monotonic() + 60 * options.minutes
    first, last = options.seeds
    with pool(options.processes) as workers:
        jobs = [
            workers.submit(_cell, fly, row, seed, until)
            for seed in range(first, last + 1)
            for row in options.rows
            if "failed" in found.get((row, seed), {"failed": "not flown"})
        ]
        for job in as_completed(jobs):
            if (one := job.result()) is None:
                continue
            found[one["row"], one["seed"]] = one
            line = json.dumps(one)
            print(line, file=sys.stderr, flush=True)
            if options.keep is not None:
                with options.keep.open("a") as file:
                    file.write(line + "\n")
    return {row: [found[cell] for cell in sorted(found) if cell[0] == row] for row in options.rows}


def _cell(fly: Fly, row: str, seed: int, until: float) -> Result | None:
    return None if time.monotonic() > until else {"row": row, "seed": seed, **fly(row, seed)}


def table(head: str, rows: Iterable[Iterable[object]]) -> str:
    """Return a table in Markdown. head: titles of the columns, separated by `|`. A cell is a text,
    or a number with two decimals; None: not known."""
    lines = [f"| {head} |", "|---" * (head.count("|") + 1) + "|"]
    return "\n".join([*lines, *(f"| {' | '.join(map(_text, row))} |" for row in rows)])


def _text(value: object) -> str:
    if value is None:
        return "-"
    return f"{value:.2f}" if isinstance(value, float) else str(value)
