"""Processes that work off jobs, and end at once when nobody wants the rest of them.

`ProcessPoolExecutor` finishes what its processes have begun before it lets go of them, and has no public way to end
them before Python 3.14; `multiprocessing.Pool` waits for ever for the job of a process that died; loky (3.7, as its
source has it) replaces processes that have grown by 300 MB, as batches of flights may.
"""

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from typing import Any

Job = tuple[Callable[..., Any], tuple[Any, ...]]
"""A function that a fresh process can import, and its arguments."""


class WorkerDiedError(Exception):
    """A process ended in the middle of a job, as by a kernel that runs out of memory."""


def worked(jobs: deque[Job], processes: int) -> Generator[Any, None, None]:
    """The results of jobs as they come, in any order; jobs that are appended meanwhile are done, too. Closed or failed,
    it ends its processes in the middle of their work. Raises WorkerDiedError, and what a job raises."""
    crew: dict[Connection, multiprocessing.process.BaseProcess] = {}
    idle: list[Connection] = []
    try:
        while jobs or len(idle) < len(crew):
            while jobs and (idle or len(crew) < processes):
                worker = idle.pop() if idle else _hired(crew)
                worker.send(jobs.popleft())
            ready = wait([worker for worker in crew if worker not in idle])
            answers = [worker.recv() for worker in ready if isinstance(worker, Connection)]
            idle += [worker for worker in ready if isinstance(worker, Connection)]
            for result, error in answers:
                if error is not None:
                    raise error
                yield result
    except (EOFError, ConnectionError):
        raise WorkerDiedError from None
    finally:
        for worker, process in crew.items():
            process.terminate()
            process.join()
            worker.close()


def _hired(crew: dict[Connection, Any]) -> Connection:
    """One more worker, by our end of the pipe to it."""
    spawn = multiprocessing.get_context("spawn")
    ours, theirs = spawn.Pipe()
    process = spawn.Process(target=_work, args=(theirs,), daemon=True)
    resource_tracker.ensure_running()  # which would let Ctrl-C through again
    with _without_ctrl_c():
        process.start()
    theirs.close()  # so that the worker's end is the end of the pipe
    crew[ours] = process
    return ours


@contextmanager
def _without_ctrl_c() -> Iterator[None]:
    """A process that is started meanwhile never hears a Ctrl-C, not even while it imports; ours comes afterwards."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _work(pipe: Connection) -> None:
    """In a worker: a signal from the terminal is the parent's to answer, and the parent's end is ours, too."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, name="end with parent", daemon=True).start()
    with suppress(EOFError, ConnectionError):
        while True:
            pipe.send(_answer(*pipe.recv()))


def _answer(function: Callable[..., Any], arguments: tuple[Any, ...]) -> tuple[Any, Exception | None]:
    try:
        return function(*arguments), None
    except Exception as error:
        return None, error


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
