"""Worker processes that can be terminated at once.

Each process has its own pipe and thread. If one process ends in the middle of a message, the other
processes continue. `ProcessPoolExecutor` has one pipe for all results and blocks forever on an
incomplete result. `multiprocessing.Pool` blocks forever on the job of a process that died. loky 3.7
replaces processes after their memory has grown by 300 MB.
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
"""Function that submits a job: a function that a new process can import, and its arguments."""


class WorkerDiedError(Exception):
    """A process ended during a job, for example because the system ran out of memory."""


@contextmanager
def workers(count: int) -> Iterator[Submit]:
    """Context with `count` worker processes. It yields a function that submits jobs. The end of the
    context terminates all processes.

    A job raises WorkerDiedError if its process died.
    """
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

    resource_tracker.ensure_running()  # started here because its start unblocks Ctrl-C
    pool = ThreadPoolExecutor(count, "worker", connect)
    try:
        yield lambda function, *arguments: pool.submit(work, function, *arguments)
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        _terminate(processes)
        pool.shutdown()
        _terminate(processes)  # processes started in the meantime


def _terminate(processes: list[BaseProcess]) -> None:
    for process in processes:
        process.terminate()
        process.join()


def _start_worker(processes: list[BaseProcess]) -> Connection:
    """Start a worker and return our end of its pipe."""
    # Ctrl-C is sent to all processes of the terminal. A worker must not receive it, not even while
    # it imports. So the signal is blocked in this thread, and the worker inherits the block. The
    # main thread still receives the signal.
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    spawn = multiprocessing.get_context("spawn")
    ours, theirs = spawn.Pipe()
    process = spawn.Process(target=_work, args=(theirs,), daemon=True)
    process.start()
    theirs.close()  # so that the pipe ends when the worker ends
    processes.append(process)
    return ours


def _work(pipe: Connection) -> None:
    """Run jobs in a worker process. The worker ignores Ctrl-C, which the parent handles, and ends
    with the parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, name="end with parent", daemon=True).start()
    with suppress(EOFError, ConnectionError):
        while True:
            function, arguments = pipe.recv()
            result = None
            failed = None
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
