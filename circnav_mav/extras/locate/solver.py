"""The process in which the survey's estimate is made. It imports little, so that it is ready soon."""

import multiprocessing
import os
import signal
from concurrent.futures import ProcessPoolExecutor

NICE = 5
"""Niceness of the solver's process, so that the flight's goes first; chosen."""


def start_solver() -> ProcessPoolExecutor:
    """A pool of one, on its way up."""
    pool = ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), _begin)
    pool.submit(os.getpid)
    return pool


def _begin() -> None:
    """Quiet, and ready. The operator's Ctrl-C is for the flight."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(os, "sched_setscheduler"):  # real-time priority, where the flight has it, is for the flight alone
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    os.nice(NICE)
