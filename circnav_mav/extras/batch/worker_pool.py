"""Processes that work off jobs, and end at once when nobody wants the rest of them.

Each has a pipe and a thread of its own, so that one that is ended in the middle of a word harms nobody.
`ProcessPoolExecutor` has one pipe for all answers, and waits for ever for the rest of an answer whose process was
ended; `multiprocessing.Pool` waits for ever for the job of a process that died; loky (3.7, as its source has it)
replaces processes that have grown by 300 MB, as batches of flights may.
"""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any

Submit = Callable[..., Future[Any]]
"""Takes a function that a fresh process can import, and its arguments."""


class WorkerDiedError(Exception):
    """A process ended in the middle of a job, as by a kernel that runs out of memory."""


@contextmanager
def workers(count: int) -> Iterator[Submit]:
    """What submits jobs to so many processes. A job whose process died raises WorkerDiedError. Left, it ends them all
    in the middle of their work."""
    processes: list[BaseProcess] = []
    mine = threading.local()

    def connect() -> None:
        mine.pipe = _start_worker(processes)

    def work(function: Callable[..., Any], *arguments: Any) -> Any:
        try:
            mine.pipe.send((function, arguments))
            result, error = mine.pipe.recv()
        except (EOFError, ConnectionError):
            raise WorkerDiedError from None
        if error is not None:
            raise error
        return result

    resource_tracker.ensure_running()  # which would let Ctrl-C through again where a process is started
    pool = ThreadPoolExecutor(count, "worker", connect)
    try:
        yield lambda function, *arguments: pool.submit(work, function, *arguments)
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        _terminate(processes)
        pool.shutdown()
        _terminate(processes)  # who was started meanwhile


def _terminate(processes: list[BaseProcess]) -> None:
    for process in processes:
        process.terminate()
        process.join()


def _start_worker(processes: list[BaseProcess]) -> Connection:
    """One more worker, by our end of the pipe to it. It never hears a Ctrl-C, not even while it imports: that is kept
    from this thread, and so from what it starts; the main thread hears it."""
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    spawn = multiprocessing.get_context("spawn")
    ours, theirs = spawn.Pipe()
    process = spawn.Process(target=_work, args=(theirs,), daemon=True)
    process.start()
    theirs.close()  # so that the worker's end is the end of the pipe
    processes.append(process)
    return ours


def _work(pipe: Connection) -> None:
    """In a worker: a signal from the terminal is the parent's to answer, and the parent's end is ours, too."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, name="end with parent", daemon=True).start()
    with suppress(EOFError, ConnectionError):
        while True:
            function, arguments = pipe.recv()
            result, failed = None, None
            try:
                result = function(*arguments)
            except Exception as error:
                failed = error
            pipe.send((result, failed))


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
