"""Execution of many independent jobs: in this process, on the cores of this computer, or on the
workers of a Dask scheduler. The results are the same."""

import logging
import os
import socket
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future
from itertools import islice, starmap
from queue import SimpleQueue
from typing import Any, TypeVar

from circnav_mav.runtime.worker_pool import Submit, WorkerDiedError, workers

T = TypeVar("T")
SERVER_FIRST = ("", "tcp")
"""Schemes of addresses at which a Dask scheduler sends the first byte. With other schemes, the
scheduler waits for the client."""
SCHEMES = (*SERVER_FIRST, "tls", "ws", "wss")
CONNECT_TIMEOUT = 5.0
"""Time, s, within which a scheduler must accept the connection and answer."""

AHEAD = 1000
"""Largest number of jobs that are submitted and not finished: more than a cluster has workers, and
few enough for the memory of this process."""


class JobsError(Exception):
    """Jobs that cannot be executed; the message is one line with the remedy."""


def cores() -> int:
    """Return the number of processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def fly(
    function: Callable[..., T],
    jobs: Iterable[tuple[Any, ...]],
    processes: int,
    scheduler: str | None,
) -> Generator[T, None, None]:
    """Yield the results of function(*job) as they finish, in any order.

    processes: number of worker processes; 1: this process.
    scheduler: address of a Dask scheduler, whose workers replace the processes; or None.

    Raises JobsError.
    """
    if scheduler is not None:
        yield from _on_scheduler(function, jobs, scheduler)
    elif processes == 1:
        yield from starmap(function, jobs)
    else:
        try:
            with workers(processes) as submit:
                yield from _gathered(submit, function, jobs)
        except WorkerDiedError:
            raise JobsError(
                "a worker process died (out of memory?): --resume flies the missing runs"
            ) from None


def _gathered(
    submit: Submit, function: Callable[..., T], jobs: Iterable[tuple[Any, ...]]
) -> Generator[T, None, None]:
    """Yield the results of the workers behind `submit`, with at most AHEAD jobs under way."""
    ready: SimpleQueue[Future[T]] = SimpleQueue()
    left = iter(jobs)
    under_way = 0
    for job in islice(left, AHEAD):
        submit(function, *job).add_done_callback(ready.put)
        under_way += 1
    while under_way:
        yield ready.get().result()
        under_way -= 1
        for job in islice(left, 1):
            submit(function, *job).add_done_callback(ready.put)
            under_way += 1


def _on_scheduler(
    function: Callable[..., T], jobs: Iterable[tuple[Any, ...]], address: str
) -> Generator[T, None, None]:
    """Yield the results of the workers of a Dask scheduler. Raises JobsError."""
    try:
        import distributed
    except ImportError:
        raise JobsError("--scheduler needs Dask: pip install distributed") from None
    _check_scheduler(address)
    safe = distributed.Security().get_connection_args("client").get("ssl_context")  # type: ignore[no-untyped-call]
    if address.startswith(("tls:", "wss:")) and safe is None:
        scheme = address.partition(":")[0]
        raise JobsError(
            f"--scheduler {address}: {scheme} needs the certificates named in Dask's configuration"
        )
    # Dask sets the log level of `distributed.client` separately.
    for name in (
        "distributed",
        "distributed.client",
    ):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        client: Any = distributed.Client(address, timeout=CONNECT_TIMEOUT, set_as_default=False)  # type: ignore[no-untyped-call]
    except (
        Exception
    ) as error:  # Dask raises many types: there is no scheduler, or it requires certificates
        reason = str(error).splitlines()[0] if str(error) else "no answer"
        raise JobsError(f"--scheduler {address}: no Dask scheduler answers: {reason}") from None
    with client:
        if not client.scheduler_info()["workers"]:
            raise JobsError(
                f"--scheduler {address}: has no workers: start some with: dask worker {address}"
            )
        try:
            yield from _gathered(client.get_executor(pure=False).submit, function, jobs)
        except Exception as error:
            reason = " ".join(str(error).split())[:200]
            raise JobsError(
                f"--scheduler {address}: {type(error).__name__}: {reason}; --resume flies the"
                " missing runs"
            ) from None


def _check_scheduler(address: str) -> None:
    """Check that a scheduler answers at an address. Raises JobsError.

    Dask itself would retry for a long time, and its threads would print errors afterwards.
    """
    scheme, _, place = address.rpartition("://")
    host, _, port = place.rpartition(":")
    if scheme not in SCHEMES or not host or not port.isdecimal() or int(port) > 65535:
        raise JobsError(
            f"--scheduler {address}: write it as tcp://HOST:PORT (or tls://, ws://, wss://)"
        )
    try:
        with socket.create_connection((host.strip("[]"), int(port)), CONNECT_TIMEOUT) as there:
            answered = scheme not in SERVER_FIRST or there.recv(1)
    except (OSError, UnicodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise JobsError(f"--scheduler {address}: no answer: {reason}") from None
    if not answered:
        raise JobsError(
            f"--scheduler {address}: the program at this address is not a Dask scheduler"
        )
