"""Where the chunks of a campaign are flown: here, on all cores, or on the workers of a Dask scheduler."""

import logging
import os
import socket
from collections import deque
from collections.abc import Collection, Generator, Sequence
from concurrent.futures import Future
from queue import SimpleQueue
from typing import Any

from circnav_mav.experiments.campaign.fly import Row, fly_part
from circnav_mav.experiments.campaign.plan import Campaign
from circnav_mav.experiments.worker_pool import Submit, WorkerDiedError, workers

Runs = Sequence[int]
Chunks = Sequence[Runs]
Done = Collection[int]
Rows = Generator[list[Row], None, None]
Part = tuple[list[Row], list[int]]
GREET = ("", "tcp")
"""Schemes of addresses by which the scheduler speaks first."""
SCHEMES = (*GREET, "tls", "ws", "wss")
MOST_PORT = 65535
PATIENCE = 5.0
"""Time, s, that a scheduler is given to answer."""

AHEAD = 1000
"""Jobs that are handed out at once: more than any cluster has workers, and few enough to be remembered."""


class ExecutionError(Exception):
    """Nobody flies the campaign, or not to its end; one line with the remedy."""


def cores() -> int:
    """The processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def on_cores(campaign: Campaign, chunks: Chunks, processes: int, done: Done = frozenset()) -> Rows:
    """The rows of the chunks but of the runs that are done, as they finish, in any order. Raises ExecutionError."""
    parts = _parts(chunks, done)
    if processes == 1:
        yield from _in_turn(campaign, parts)
        return
    try:
        with workers(processes) as submit:
            yield from _gathered(submit, campaign, parts)
    except WorkerDiedError:
        raise ExecutionError("a worker process died (out of memory?): --resume flies what is missing") from None


def _in_turn(campaign: Campaign, parts: Sequence[tuple[Runs, Runs]]) -> Rows:
    """The same one after the other, in this process."""
    waiting = deque(parts)
    while waiting:
        rows, alone = fly_wanted(campaign, *waiting.popleft())
        waiting.extendleft(([number], [number]) for number in reversed(alone))
        yield rows


def _gathered(submit: Submit, campaign: Campaign, parts: Sequence[tuple[Runs, Runs]]) -> Rows:
    """The rows of the parts, flown by whoever takes what is submitted; what must be flown alone is a job each."""
    ready: SimpleQueue[Future[Part]] = SimpleQueue()
    jobs = deque((fly_wanted, campaign, *part) for part in parts)
    under_way = 0
    while jobs or under_way:
        while jobs and under_way < AHEAD:
            submit(*jobs.popleft()).add_done_callback(ready.put)
            under_way += 1
        rows, alone = ready.get().result()
        under_way -= 1
        jobs.extend((fly_wanted, campaign, [number], [number]) for number in alone)
        yield rows


def _parts(chunks: Chunks, done: Done) -> list[tuple[Runs, Runs]]:
    """The chunks in which something is missing, each with what is."""
    missing = ((chunk, [run for run in chunk if run not in done]) for chunk in chunks)
    return [(chunk, chunk if len(wanted) == len(chunk) else wanted) for chunk, wanted in missing if wanted]


def fly_wanted(campaign: Campaign, chunk: Runs, wanted: Runs) -> Part:
    """What `fly_part` gives of the wanted runs of a chunk. The whole batch is flown: how numpy sums up depends on how
    many fly together, and a row must not depend on where a campaign was interrupted."""
    rows, alone = fly_part(campaign, chunk)
    left = set(wanted)
    return [row for row in rows if row["run"] in left], [number for number in alone if number in left]


def on_scheduler(campaign: Campaign, chunks: Chunks, address: str, done: Done = frozenset()) -> Rows:
    """The same on the workers of a Dask scheduler. Raises ExecutionError."""
    try:
        import distributed
    except ImportError:
        raise ExecutionError("--scheduler needs Dask: pip install distributed") from None
    _knock(address)
    safe = distributed.Security().get_connection_args("client").get("ssl_context")  # type: ignore[no-untyped-call]
    if address.startswith(("tls:", "wss:")) and safe is None:
        scheme = address.partition(":")[0]
        raise ExecutionError(f"--scheduler {address}: {scheme} needs the certificates named in Dask's configuration")
    for name in ("distributed", "distributed.client"):  # Dask gives the second a level of its own
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        client: Any = distributed.Client(address, timeout=PATIENCE, set_as_default=False)  # type: ignore[no-untyped-call]
    except Exception as error:  # Dask raises many: no scheduler is there, or it wants certificates
        said = str(error).splitlines()[0] if str(error) else "no answer"
        raise ExecutionError(f"--scheduler {address}: no Dask scheduler answers: {said}") from None
    with client:
        if not client.scheduler_info()["workers"]:
            raise ExecutionError(f"--scheduler {address}: has no workers: start some with: dask worker {address}")
        try:
            yield from _gathered(client.get_executor(pure=False).submit, campaign, _parts(chunks, done))
        except Exception as error:
            said = " ".join(str(error).split())[:200]
            raise ExecutionError(
                f"--scheduler {address}: {type(error).__name__}: {said}; --resume flies what is missing"
            ) from None


def _knock(address: str) -> None:
    """Whether anybody listens there, and greets as a scheduler does; Dask itself would try for long, and leave threads
    that complain. Raises ExecutionError."""
    scheme, _, place = address.rpartition("://")
    host, _, port = place.rpartition(":")
    if scheme not in SCHEMES or not host or not port.isdecimal() or int(port) > MOST_PORT:
        raise ExecutionError(f"--scheduler {address}: write it as tcp://HOST:PORT, or with tls, ws or wss in front")
    try:
        with socket.create_connection((host.strip("[]"), int(port)), PATIENCE) as there:
            greeted = scheme not in GREET or there.recv(1)
    except (OSError, UnicodeError) as error:
        raise ExecutionError(
            f"--scheduler {address}: nobody answers: {getattr(error, 'strerror', None) or error}"
        ) from None
    if not greeted:
        raise ExecutionError(f"--scheduler {address}: whoever answers there is no Dask scheduler")
