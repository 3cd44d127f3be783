"""Execution of a campaign's chunks on the cores of this computer or on the workers of a Dask scheduler."""

import logging
import os
import socket
from collections import deque
from collections.abc import Callable, Collection, Generator, Sequence
from concurrent.futures import Future
from queue import SimpleQueue
from typing import Any

from circnav_mav.extras.batch.worker_pool import Submit, WorkerDiedError, workers
from circnav_mav.extras.campaign.fly import Row, fly_part
from circnav_mav.extras.campaign.plan import Campaign, CampaignError

Chunks = Sequence[Sequence[int]]
Done = Collection[int]
Rows = Generator[list[Row], None, None]
Part = tuple[list[Row], list[int]]
SERVER_FIRST = ("", "tcp")
"""Schemes of addresses at which a Dask scheduler sends the first byte. At the others it waits for the client."""
SCHEMES = (*SERVER_FIRST, "tls", "ws", "wss")
CONNECT_TIMEOUT = 5.0
"""Time, s, within which a scheduler must accept the connection and answer."""

AHEAD = 1000
"""Largest number of jobs that are submitted and not finished: more than a cluster has workers, and few enough for the
memory."""


def cores() -> int:
    """Return the number of processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def on_cores(campaign: Campaign, chunks: Chunks, processes: int, done: Done = frozenset()) -> Rows:
    """Yield the rows of the chunks as they finish, in any order, without runs that are done. Raises CampaignError."""

    def here(function: Callable[..., Part], *arguments: Any) -> Future[Part]:
        flown: Future[Part] = Future()
        flown.set_result(function(*arguments))
        return flown

    if processes == 1:
        yield from _gathered(here, campaign, chunks, done, ahead=1)
        return
    try:
        with workers(processes) as submit:
            yield from _gathered(submit, campaign, chunks, done)
    except WorkerDiedError:
        raise CampaignError("a worker process died (out of memory?): --resume flies the missing runs") from None


def _gathered(submit: Submit, campaign: Campaign, chunks: Chunks, done: Done, ahead: int = AHEAD) -> Rows:
    """Yield the missing rows, flown by the workers behind `submit`. A run that must fly alone is a separate job."""
    ready: SimpleQueue[Future[Part]] = SimpleQueue()
    missing = ((chunk, set(chunk).difference(done)) for chunk in chunks)
    jobs = deque[tuple[Sequence[int], set[int]]]((chunk, wanted) for chunk, wanted in missing if wanted)
    under_way = 0
    while jobs or under_way:
        while jobs and under_way < ahead:
            submit(fly_part, campaign, *jobs.popleft()).add_done_callback(ready.put)
            under_way += 1
        rows, alone = ready.get().result()
        under_way -= 1
        jobs.extend(([number], {number}) for number in alone)
        yield rows


def on_scheduler(campaign: Campaign, chunks: Chunks, address: str, done: Done = frozenset()) -> Rows:
    """Yield the rows as `on_cores` does, flown by the workers of a Dask scheduler. Raises CampaignError."""
    try:
        import distributed
    except ImportError:
        raise CampaignError("--scheduler needs Dask: pip install distributed") from None
    _check_scheduler(address)
    safe = distributed.Security().get_connection_args("client").get("ssl_context")  # type: ignore[no-untyped-call]
    if address.startswith(("tls:", "wss:")) and safe is None:
        scheme = address.partition(":")[0]
        raise CampaignError(f"--scheduler {address}: {scheme} needs the certificates named in Dask's configuration")
    for name in ("distributed", "distributed.client"):  # Dask sets the level of the second one separately
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        client: Any = distributed.Client(address, timeout=CONNECT_TIMEOUT, set_as_default=False)  # type: ignore[no-untyped-call]
    except Exception as error:  # Dask raises many types: there is no scheduler, or it requires certificates
        reason = str(error).splitlines()[0] if str(error) else "no answer"
        raise CampaignError(f"--scheduler {address}: no Dask scheduler answers: {reason}") from None
    with client:
        if not client.scheduler_info()["workers"]:
            raise CampaignError(f"--scheduler {address}: has no workers: start some with: dask worker {address}")
        try:
            yield from _gathered(client.get_executor(pure=False).submit, campaign, chunks, done)
        except Exception as error:
            reason = " ".join(str(error).split())[:200]
            raise CampaignError(
                f"--scheduler {address}: {type(error).__name__}: {reason}; --resume flies the missing runs"
            ) from None


def _check_scheduler(address: str) -> None:
    """Check that a scheduler answers at an address. Raises CampaignError.

    Dask itself would retry for a long time, and its threads would print errors afterwards.
    """
    scheme, _, place = address.rpartition("://")
    host, _, port = place.rpartition(":")
    if scheme not in SCHEMES or not host or not port.isdecimal() or int(port) > 65535:
        raise CampaignError(f"--scheduler {address}: write it as tcp://HOST:PORT (or tls://, ws://, wss://)")
    try:
        with socket.create_connection((host.strip("[]"), int(port)), CONNECT_TIMEOUT) as there:
            answered = scheme not in SERVER_FIRST or there.recv(1)
    except (OSError, UnicodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise CampaignError(f"--scheduler {address}: no answer: {reason}") from None
    if not answered:
        raise CampaignError(f"--scheduler {address}: the program at this address is not a Dask scheduler")
