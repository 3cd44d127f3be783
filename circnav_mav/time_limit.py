"""Time limit of user-defined laws and estimators, which run in the loop of a flight."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from circnav_mav.guidance.estimators.interface import Estimator
from circnav_mav.guidance.own_code import StuckCodeError, call

LIMIT = 0.3
"""Longest duration of a step with user-defined code, s. After 0.5 s a step sends nothing more, so
that the safe setpoint would be late, too."""
SIMULATED_LIMIT = 10.0
"""Largest processor time of a step with user-defined code in simulated time, s. Chosen: longer than
the compilation of a law, because no vehicle waits."""


@contextmanager
def time_limit(*, simulated: bool = False) -> Iterator[None]:
    """Raise StuckCodeError if the body takes longer than the limit because user-defined code does
    not return.

    simulated: True in simulated time. The limit is then processor time: the load of the computer
        must not decide the outcome of a flight.

    Compiled code, such as numpy's, is interrupted only when it returns to Python.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # signals interrupt the main thread only
        return

    limit = SIMULATED_LIMIT if simulated else LIMIT
    timer, number = (
        (signal.ITIMER_PROF, signal.SIGPROF) if simulated else (signal.ITIMER_REAL, signal.SIGALRM)
    )
    words = f"{limit:g} s of processor time" if simulated else f"{limit:g} s"
    interrupted: list[str] = []

    def on_alarm(_: int, frame: FrameType | None) -> None:
        if name := _running(frame):
            # Repeat the interruption if the code catches every exception. Such code can only be
            # ended with the process: let SIGINT and SIGTERM end it.
            if interrupted:
                for ending in (signal.SIGINT, signal.SIGTERM):
                    signal.signal(ending, signal.SIG_DFL)
            interrupted.append(name)
            signal.setitimer(timer, limit)
            raise StuckCodeError(f"{name} did not return within {words}")

    before = signal.signal(number, on_alarm)
    signal.setitimer(timer, limit)
    try:
        yield
    finally:
        signal.setitimer(timer, 0)
        signal.signal(number, before)


def _running(frame: FrameType | None) -> str:
    """Return the name of the user-defined code that runs in a frame, or empty. A step that lasts
    for another reason, such as a stopped process, is not interrupted."""
    while frame is not None:
        if frame.f_code is call.__code__:
            return f"law {frame.f_locals['name']}"
        of = frame.f_locals.get("self")
        if isinstance(of, Estimator) and not type(of).__module__.startswith("circnav_mav."):
            return f"estimator {type(of).__module__}:{type(of).__qualname__}"
        frame = frame.f_back
    return ""
