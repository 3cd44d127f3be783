"""Where the chunks of a campaign are flown: here, on all cores, or on the workers of a Dask scheduler."""

import logging
import multiprocessing
import os
import signal
from collections.abc import Generator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from circnav_mav.analysis.campaign.fly import Row, fly_chunk
from circnav_mav.analysis.campaign.plan import Campaign

Chunks = Sequence[Sequence[int]]
Rows = Generator[list[Row], None, None]
PATIENCE = 5.0
"""Time, s, that a scheduler is given to answer."""


class ExecutionError(Exception):
    """Nobody flies the campaign, or not to its end; one line with the remedy."""


def cores() -> int:
    """The processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def on_cores(campaign: Campaign, chunks: Chunks, processes: int) -> Rows:
    """The rows of the chunks as they finish, in any order. Raises ExecutionError."""
    if processes == 1 or len(chunks) == 1:
        yield from (fly_chunk(campaign, chunk) for chunk in chunks)
        return
    spawn = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(min(processes, len(chunks)), mp_context=spawn, initializer=_leave_signals_to_parent)
    finished = False
    try:
        for future in as_completed([pool.submit(fly_chunk, campaign, chunk) for chunk in chunks]):
            yield future.result()
        finished = True
    except BrokenProcessPool:
        raise ExecutionError("a worker process died (out of memory?): --resume flies what is missing") from None
    finally:
        if not finished:
            for child in multiprocessing.active_children():
                child.terminate()
        pool.shutdown(wait=finished, cancel_futures=True)


def on_scheduler(campaign: Campaign, chunks: Chunks, address: str) -> Rows:
    """The same on the workers of a Dask scheduler. Raises ExecutionError."""
    try:
        import distributed
    except ImportError:
        raise ExecutionError("--scheduler needs Dask: pip install 'circnav-mav[cluster]'") from None
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    try:
        client: Any = distributed.Client(address, timeout=PATIENCE, set_as_default=False)  # type: ignore[no-untyped-call]
    except (OSError, ValueError, TimeoutError) as error:
        said = str(error).splitlines()[0] if str(error) else "no answer"
        raise ExecutionError(f"--scheduler {address}: nobody answers: {said}") from None
    with client:
        if not client.scheduler_info()["workers"]:
            raise ExecutionError(f"--scheduler {address}: has no workers: start some with: dask worker {address}")
        yield from _gathered(distributed, client, campaign, chunks, address)


def _gathered(distributed: Any, client: Any, campaign: Campaign, chunks: Chunks, address: str) -> Rows:
    try:
        shared = client.scatter(campaign, broadcast=True, hash=False)
        futures = [client.submit(fly_chunk, shared, list(chunk), pure=False) for chunk in chunks]
        for _, rows in distributed.as_completed(futures, loop=client.loop, with_results=True):
            yield rows
    except GeneratorExit:
        raise
    except Exception as error:
        said = " ".join(str(error).split())[:200]
        raise ExecutionError(
            f"--scheduler {address}: {type(error).__name__}: {said}; --resume flies what is missing"
        ) from None


def _leave_signals_to_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
