"""Where the chunks of a campaign are flown: here, on all cores, or on the workers of a Dask scheduler."""

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
GREET = ("", "tcp")
"""Schemes of addresses by which the scheduler speaks first."""
SCHEMES = (*GREET, "tls", "ws", "wss")
PATIENCE = 5.0
"""Time, s, that a scheduler is given to answer."""

AHEAD = 1000
"""Jobs that are handed out at once: more than any cluster has workers, and few enough to be remembered."""


def cores() -> int:
    """The processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def on_cores(campaign: Campaign, chunks: Chunks, processes: int, done: Done = frozenset()) -> Rows:
    """The rows of the chunks but of the runs that are done, as they finish, in any order. Raises CampaignError."""

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
        raise CampaignError("a worker process died (out of memory?): --resume flies what is missing") from None


def _gathered(submit: Submit, campaign: Campaign, chunks: Chunks, done: Done, ahead: int = AHEAD) -> Rows:
    """The rows that are missing, flown by whoever takes what is submitted; what must be flown alone is a job each."""
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
    """The same on the workers of a Dask scheduler. Raises CampaignError."""
    try:
        import distributed
    except ImportError:
        raise CampaignError("--scheduler needs Dask: pip install distributed") from None
    _check_listens(address)
    safe = distributed.Security().get_connection_args("client").get("ssl_context")  # type: ignore[no-untyped-call]
    if address.startswith(("tls:", "wss:")) and safe is None:
        scheme = address.partition(":")[0]
        raise CampaignError(f"--scheduler {address}: {scheme} needs the certificates named in Dask's configuration")
    for name in ("distributed", "distributed.client"):  # Dask gives the second a level of its own
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        client: Any = distributed.Client(address, timeout=PATIENCE, set_as_default=False)  # type: ignore[no-untyped-call]
    except Exception as error:  # Dask raises many: no scheduler is there, or it wants certificates
        said = str(error).splitlines()[0] if str(error) else "no answer"
        raise CampaignError(f"--scheduler {address}: no Dask scheduler answers: {said}") from None
    with client:
        if not client.scheduler_info()["workers"]:
            raise CampaignError(f"--scheduler {address}: has no workers: start some with: dask worker {address}")
        try:
            yield from _gathered(client.get_executor(pure=False).submit, campaign, chunks, done)
        except Exception as error:
            said = " ".join(str(error).split())[:200]
            raise CampaignError(
                f"--scheduler {address}: {type(error).__name__}: {said}; --resume flies what is missing"
            ) from None


def _check_listens(address: str) -> None:
    """Whether anybody listens there, and greets as a scheduler does; Dask itself would try for long, and leave threads
    that complain. Raises CampaignError."""
    scheme, _, place = address.rpartition("://")
    host, _, port = place.rpartition(":")
    if scheme not in SCHEMES or not host or not port.isdecimal() or int(port) > 65535:
        raise CampaignError(f"--scheduler {address}: write it as tcp://HOST:PORT, or with tls, ws or wss in front")
    try:
        with socket.create_connection((host.strip("[]"), int(port)), PATIENCE) as there:
            greeted = scheme not in GREET or there.recv(1)
    except (OSError, UnicodeError) as error:
        said = getattr(error, "strerror", None) or error
        raise CampaignError(f"--scheduler {address}: nobody answers: {said}") from None
    if not greeted:
        raise CampaignError(f"--scheduler {address}: whoever answers there is no Dask scheduler")
