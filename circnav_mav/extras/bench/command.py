"""The command `circnav bench`."""

import os
from pathlib import Path

from circnav_mav.api import Guidance
from circnav_mav.cli.exits import Exit, Refused, refusing, say
from circnav_mav.extras.bench import bench
from circnav_mav.extras.bench.flight import POLICIES, law_and_estimator
from circnav_mav.extras.bench.situations import ORBIT, SITUATIONS
from circnav_mav.runtime.worker_pool import WorkerDiedError


def fly_bench(
    flights: int,
    laws: tuple[str, ...],
    situations: tuple[str, ...],
    seed: int,
    out: str | None,
    form: str,
) -> int:
    """Fly the requested situations with the requested laws, by default all, and print a line for
    each pair. Raises Refused."""
    for law in laws:
        try:
            if law not in POLICIES:
                Guidance(ORBIT, *law_and_estimator(law))  # imports user-defined code
        except ValueError as error:
            raise Refused(f"--law: {error}") from None
    for name in situations:
        if name not in SITUATIONS:
            raise Refused(f'--situation: "{name}" is not one of: {"; ".join(SITUATIONS)}')
    folder = Path(out) if out else None
    cells = [(situation, law) for situation in situations or SITUATIONS for law in laws or POLICIES]
    with refusing(out or "bench"):
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
            (folder / "table.csv").open("ab").close()  # fail now, not after hours of flight
        cores = os.cpu_count() or 1
        try:
            bench.run(cells, flights, seed, folder, report=say, cores=cores, form=form)
        except WorkerDiedError:
            raise Refused(
                "a worker process died (out of memory?): reduce --flights", Exit.INTERNAL
            ) from None
    return Exit.DONE
