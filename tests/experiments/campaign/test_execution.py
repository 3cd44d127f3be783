"""Who flies a campaign, and what is left when they end before it does."""

import concurrent.futures
import contextlib
import select
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from circnav_mav.experiments.campaign import execute, fly
from circnav_mav.experiments.campaign.execute import ExecutionError, on_cores, on_scheduler
from circnav_mav.experiments.campaign.file import load_campaign
from circnav_mav.experiments.campaign.fly import chunks, fly_chunk, fly_part
from tests.process import PATIENCE

ENVIRONMENT = {"PYTHONPATH": str(Path(__file__).parents[3]), "PATH": "/bin"}
SHORT = '"limits.duration_s" = [5.0]\n'
MIXED = SHORT + '"guidance.radius_trim_per_s" = [0.05, 0.0]\n'


@pytest.fixture
def begun(write, tmp_path):
    """A long campaign on two processes that has its first rows."""
    path, out = write('"limits.duration_s" = [20.0]\n', "runs = 200000"), tmp_path / "out"
    process = subprocess.Popen(
        [sys.executable, "-m", "circnav_mav", "campaign", path, "--out", out, "--processes", "2"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True, env=ENVIRONMENT,
    )  # fmt: skip
    table = out / "runs.csv"
    while process.poll() is None and not (table.exists() and table.read_bytes().count(b"\n") > 1):
        select.select([], [], [], 0.05)
    yield process
    process.kill()
    process.communicate()


def children(process):
    tasks = Path(f"/proc/{process.pid}/task").glob("*/children")  # each thread has its own
    return [int(child) for task in tasks for child in task.read_text().split()]


def all_end(processes, patience=PATIENCE):
    end = time.monotonic() + patience
    while time.monotonic() < end:
        if not any(Path(f"/proc/{pid}").exists() and "Z" not in status(pid) for pid in processes):
            return True
        select.select([], [], [], 0.05)
    return False


def status(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return "Z"


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="needs /proc")
def test_the_workers_of_a_campaign_that_was_killed_end_with_it(begun):
    workers = children(begun)
    assert len(workers) >= 2
    begun.kill()
    assert all_end(workers)


def test_a_sigterm_keeps_what_was_flown_as_ctrl_c_does(begun):
    workers = children(begun)
    begun.terminate()
    said, complaint = begun.communicate(timeout=PATIENCE)
    assert begun.returncode == 130, complaint
    assert "--resume" in said
    assert "Traceback" not in complaint
    assert all_end(workers)


@pytest.mark.parametrize("processes", [1, 2])
def test_rows_of_a_mixed_grid_come_one_by_one_and_are_those_of_the_whole(write, processes):
    """Each flight that no batch flies is a piece of work of its own, whatever run 0 is."""
    campaign = load_campaign(write(MIXED, "runs = 8"))
    pieces = list(on_cores(campaign, [range(8)] if processes == 1 else chunks(campaign), processes))
    assert sorted(row["run"] for rows in pieces for row in rows) == list(range(8))
    assert max(sum(row["engine"] == "lockstep" for row in rows) for rows in pieces) == 1
    assert sorted((row for rows in pieces for row in rows), key=lambda row: row["run"]) == fly_chunk(campaign, range(8))


def test_a_batch_is_made_of_what_a_batch_flies_whatever_run_0_needs(write):
    campaign = load_campaign(write(MIXED, "runs = 40"))
    assert [len(chunk) for chunk in chunks(campaign)] == [10] * 4
    rows, left = fly_part(campaign, range(4))
    assert ([row["run"] for row in rows], left) == ([1, 3], [0, 2])


def test_a_grid_of_lockstep_alone_is_cut_into_single_flights(write):
    assert {len(chunk) for chunk in chunks(load_campaign(write(SHORT, 'runs = 9\nengine = "lockstep"')))} == {1}


def test_a_chunk_that_was_torn_is_flown_as_the_batch_that_it_was_and_gives_the_rows_that_are_missing(
    write, monkeypatch
):
    """Of 8 runs 5 are there, one of them of those that fly alone."""
    together, alone = [], []
    fly_batch, lockstep = fly.fly_batch, fly.fly_lockstep
    monkeypatch.setattr(fly, "fly_batch", lambda runs: together.append([run.number for run in runs]) or fly_batch(runs))
    monkeypatch.setattr(fly, "fly_lockstep", lambda run: alone.append(run.number) or lockstep(run))
    campaign = load_campaign(write(MIXED, "runs = 8"))
    pieces = list(on_cores(campaign, [range(8)], 1, done={0, 1, 3, 4, 7}))
    assert sorted(row["run"] for rows in pieces for row in rows) == [2, 5, 6]
    assert together == [[1, 3, 5, 7]]
    assert alone == [2, 6]


def test_what_a_single_chunk_leaves_to_be_flown_alone_is_flown_by_other_processes(write, monkeypatch):
    monkeypatch.setattr(fly, "fly_lockstep", None)  # in this process, not in the others
    rows = [row for rows in on_cores(load_campaign(write(MIXED, "runs = 6")), [range(6)], 2) for row in rows]
    assert [row["engine"] for row in sorted(rows, key=lambda row: row["run"])] == ["lockstep", "batch"] * 3
    assert not any(row.get("error") for row in rows)


# --- a Dask scheduler ---


@pytest.mark.parametrize(
    "address",
    ["foo", "", "tcp://127.0.0.1:notaport", "/tmp/file", "tcp://127.0.0.1:99999", "tcp://:1", "ucx://127.0.0.1:8786"],
)
def test_an_address_that_is_none_is_refused_at_once(write, address):
    pytest.importorskip("distributed", reason="needs the extra [cluster]")
    with pytest.raises(ExecutionError, match="write it as tcp://HOST:PORT"):
        list(on_scheduler(load_campaign(write(SHORT)), [[0]], address))


@pytest.mark.parametrize("scheme", ["tls", "wss"])
def test_an_encrypted_address_without_certificates_is_refused(write, scheme):
    pytest.importorskip("distributed", reason="needs the extra [cluster]")
    with socket.create_server(("127.0.0.1", 0)) as other:
        address = f"{scheme}://127.0.0.1:{other.getsockname()[1]}"
        with pytest.raises(ExecutionError, match=f"{scheme} needs the certificates"):
            list(on_scheduler(load_campaign(write(SHORT)), [[0]], address))


@pytest.mark.parametrize("scheme", ["tcp", "tls", "ws", "wss"])
def test_an_address_where_nobody_listens_is_refused_before_dask_is_asked(write, monkeypatch, scheme):
    distributed = pytest.importorskip("distributed", reason="needs the extra [cluster]")
    monkeypatch.setattr(distributed, "Client", None)
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        address = f"{scheme}://127.0.0.1:{unused.getsockname()[1]}"
        with pytest.raises(ExecutionError, match="nobody answers: Connection refused"):
            list(on_scheduler(load_campaign(write(SHORT)), [[0]], address))


def test_somebody_who_listens_and_is_no_scheduler_is_told_apart(write, monkeypatch):
    distributed = pytest.importorskip("distributed", reason="needs the extra [cluster]")
    monkeypatch.setattr(distributed, "Client", None)
    monkeypatch.setattr(execute, "PATIENCE", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as other:
        address = f"tcp://127.0.0.1:{other.getsockname()[1]}"
        with pytest.raises(ExecutionError, match="nobody answers: timed out"):
            list(on_scheduler(load_campaign(write(SHORT)), [[0]], address))


def test_a_scheduler_that_dies_in_between_is_one_line_that_says_how_to_go_on(write, monkeypatch):
    distributed = pytest.importorskip("distributed", reason="needs the extra [cluster]")
    died = distributed.client.FutureCancelledError("fly", "scheduler-connection-lost")

    class Dead(concurrent.futures.Executor):
        """What a client's executor does when the scheduler is gone."""

        def submit(self, *arguments, **options):
            future = concurrent.futures.Future()
            future.set_exception(died)
            return future

    class Client(contextlib.nullcontext):
        def __init__(self, *arguments, **options):
            super().__init__()

        def scheduler_info(self):
            return {"workers": {"one": None}}

        def get_executor(self, **options):
            return Dead()

    monkeypatch.setattr(distributed, "Client", Client)
    monkeypatch.setattr(execute, "_knock", lambda address: None)
    with pytest.raises(ExecutionError, match=r"scheduler-connection-lost.*--resume flies what is missing") as told:
        list(on_scheduler(load_campaign(write(SHORT)), [[0]], "tcp://there:1"))
    assert "\n" not in str(told.value)
