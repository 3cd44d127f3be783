"""The command `circnav bench`."""

import os
from collections.abc import Iterable
from pathlib import Path

from circnav_mav.cli.exits import Exit, Refused, refusing, say
from circnav_mav.extras.bench import bench
from circnav_mav.extras.bench.flight import POLICIES
from circnav_mav.extras.bench.situations import SITUATIONS
from circnav_mav.runtime.worker_pool import WorkerDiedError


def fly_bench(
    flights: int, laws: tuple[str, ...], situations: tuple[str, ...], seed: int, out: str | None
) -> int:
    """Fly the requested situations with the requested laws, by default all, and print a line for
    each pair. Raises Refused."""
    _known("--law", laws, POLICIES)
    _known("--situation", situations, SITUATIONS)
    folder = Path(out) if out else None
    cells = [(situation, law) for situation in situations or SITUATIONS for law in laws or POLICIES]
    with refusing(out or "bench"):
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
            (folder / "table.csv").open("ab").close()  # fail now, not after hours of flight
        try:
            bench.run(cells, flights, seed, folder, report=say, cores=os.cpu_count() or 1)
        except WorkerDiedError:
            raise Refused(
                "a worker process died (out of memory?): reduce --flights", Exit.INTERNAL
            ) from None
    return Exit.DONE


def _known(option: str, names: tuple[str, ...], table: Iterable[str]) -> None:
    for name in names:
        if name not in table:
            raise Refused(f'{option}: "{name}" is not one of: {"; ".join(table)}')
