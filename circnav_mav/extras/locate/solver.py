"""Process of the locator's estimator. This module imports few modules, so that the process starts
quickly."""

import multiprocessing
import os
import signal
from concurrent.futures import ProcessPoolExecutor


def start_solver() -> ProcessPoolExecutor:
    """Return a pool of one process and start it."""
    pool = ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), _begin)
    pool.submit(os.getpid)
    return pool


def _begin() -> None:
    """Prepare the process: low priority, and Ctrl-C left to the flight's process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(os, "sched_setscheduler"):  # do not inherit the flight's real-time priority
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    # 5: niceness of the solver, so that the flight's process has priority; chosen.
    os.nice(5)
