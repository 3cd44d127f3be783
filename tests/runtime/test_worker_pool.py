"""Jobs on several worker processes: all are completed, or all are stopped at once."""

import math
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from circnav_mav.runtime.worker_pool import WorkerDiedError, workers
from tests.process import PATIENCE, ROOT, python

FOREVER = 600.0
JOBS = """
import math, os, signal, sys, threading
from circnav_mav.runtime.worker_pool import workers

def interrupt():
    os.killpg(0, signal.SIGINT)  # as a terminal does, to all processes

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)
    with workers(1) as submit:
        interrupted = False
        try:
            job = submit(math.sqrt, 4.0)
            threading.Timer(float(sys.argv[1]), interrupt).start()
            threading.Event().wait(60)
        except KeyboardInterrupt:
            interrupted = True
        sys.exit(7 if interrupted and job.result() == 2.0 else 1)
"""
HOLDS = """
import math, time
from circnav_mav.runtime.worker_pool import workers

if __name__ == "__main__":
    with workers(2) as submit:
        for job in [submit(math.sqrt, 4.0) for _ in range(8)]:
            job.result()
        for _ in range(2):
            submit(time.sleep, 600)
        time.sleep(0.2)
        print("at work", flush=True)
        time.sleep(600)
"""


def test_worker_pool_stops_abandoned_job():
    with workers(2) as submit:
        first, *_ = [submit(math.sqrt, 4.0), *(submit(time.sleep, FOREVER) for _ in range(5))]
        assert first.result() == 2.0
        began = time.monotonic()
    assert time.monotonic() - began < PATIENCE


def test_worker_pool_raises_exception_of_job():
    with workers(2) as submit, pytest.raises(ValueError, match="math domain"):
        submit(math.sqrt, -1.0).result()


def test_workers_ignore_ctrl_c(tmp_path):
    """Workers ignore SIGINT from their start on, also during imports. Otherwise each of them would
    print a traceback."""
    script = tmp_path / "jobs.py"
    script.write_text(JOBS)
    for seconds in (0.0, 0.05, 0.1, 0.3):
        process = subprocess.Popen(
            [sys.executable, script, str(seconds)],
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            env=os.environ | {"PYTHONPATH": str(ROOT)},
        )
        assert (process.communicate(timeout=PATIENCE)[1], process.returncode) == ("", 7), seconds


def is_running(process):
    try:
        return (process / "stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="needs /proc")
def test_workers_end_when_parent_process_is_killed(tmp_path):
    """The workers are executing jobs that would take ten minutes."""
    script = tmp_path / "holds.py"
    script.write_text(HOLDS)
    parent = python(script)
    assert parent.stdout.readline() == "at work\n"
    # every thread of the parent has its own list of children
    tasks = Path(f"/proc/{parent.pid}/task").glob("*/children")
    children = [Path(f"/proc/{child}") for task in tasks for child in task.read_text().split()]
    assert len(children) >= 2
    parent.kill()
    parent.communicate(timeout=PATIENCE)
    end = time.monotonic() + PATIENCE
    while running := [child for child in children if is_running(child)]:
        assert time.monotonic() < end, running
        time.sleep(0.05)


def test_killed_worker_does_not_block_worker_pool():
    with pytest.raises(WorkerDiedError), workers(2) as submit:
        submit(time.sleep, FOREVER)
        submit(os._exit, 9).result()
