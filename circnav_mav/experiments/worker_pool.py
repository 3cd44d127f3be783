"""Processes that work off jobs, and end at once when nobody wants the rest of them.

`ProcessPoolExecutor` finishes what its processes have begun before it lets go of them; here they are ended. loky (3.7)
would replace processes that have grown by 300 MB, as batches of flights may.
"""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import resource_tracker
from typing import Any

Submit = Callable[..., Future[Any]]
"""Takes a function that a fresh process can import, and its arguments."""


class WorkerDiedError(Exception):
    """A process ended in the middle of a job, as by a kernel that runs out of memory."""


@contextmanager
def workers(processes: int) -> Iterator[Submit]:
    """What submits jobs to so many processes. Left, it ends them in the middle of their work. Raises
    WorkerDiedError."""
    pool = ProcessPoolExecutor(processes, multiprocessing.get_context("spawn"), _settle)

    def submit(function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        with _without_ctrl_c():  # for a process may be started
            return pool.submit(function, *arguments)

    try:
        yield submit
    except BrokenProcessPool:
        raise WorkerDiedError from None
    finally:
        for process in list(pool._processes.values()):  # `terminate_workers` from Python 3.14 on
            process.terminate()
        pool.shutdown(cancel_futures=True)


@contextmanager
def _without_ctrl_c() -> Iterator[None]:
    """A process that is started meanwhile never hears a Ctrl-C, not even while it imports; ours comes afterwards."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # which would let Ctrl-C through again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _settle() -> None:
    """In a worker: a signal from the terminal is the parent's to answer, and the parent's end is ours, too."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, name="end with parent", daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
