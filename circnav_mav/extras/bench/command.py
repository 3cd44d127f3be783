"""The command `circnav bench`."""

import signal
from pathlib import Path

from circnav_mav.cli.exits import Exit, Refused, refusing, say
from circnav_mav.extras.bench import bench
from circnav_mav.extras.bench.flight import POLICIES, check_policy
from circnav_mav.extras.bench.situations import SITUATIONS, Situation
from circnav_mav.runtime.jobs import JobsError, cores


def fly_bench(
    flights: int,
    laws: tuple[str, ...],
    situations: tuple[str, ...],
    seed: int,
    out: str | None,
    *,
    resume: bool,
    scheduler: str | None,
    processes: int | None,
    form: str,
) -> int:
    """Fly the requested situations with the requested laws, by default all, and print a line for
    each pair. Raises Refused."""
    cells = _cells(laws, situations)
    if resume and out is None:
        raise Refused("--resume: name the folder of the benchmark to continue: --out DIR")
    folder = Path(out) if out else None
    # Let SIGTERM act as Ctrl-C: the results are kept and written.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with refusing(out or "bench", bench.BenchError, JobsError):
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
            (folder / "table.csv").open("ab").close()  # fail now, not after hours of flight
        rows = bench.run(
            cells,
            flights,
            seed,
            folder,
            report=say,
            processes=processes or cores(),
            scheduler=scheduler,
            resume=resume,
            form=form,
        )
    wanted = len(cells) * flights
    if len(rows) == wanted:
        return Exit.DONE
    remedy = f"continue with --out {out} --resume" if out else "only --out DIR keeps them"
    say(f"  stopped after {len(rows)} of {wanted} flights; {remedy}")
    return Exit.INTERRUPTED


def _cells(laws: tuple[str, ...], situations: tuple[str, ...]) -> list[tuple[Situation, str]]:
    """Return the requested situations, each with the requested laws. Raises Refused."""
    for law in laws:
        try:
            check_policy(law)
        except ValueError as error:
            raise Refused(f"--law: {error}") from None
    for name in situations:
        if name not in SITUATIONS:
            raise Refused(f'--situation: "{name}" is not one of: {"; ".join(SITUATIONS)}')
    return [
        (SITUATIONS[name], law)
        for name in dict.fromkeys(situations or SITUATIONS)
        for law in dict.fromkeys(laws or POLICIES)
    ]
