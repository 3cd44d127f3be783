"""Execution of a campaign on processes or a scheduler, and its results after an early end."""

import concurrent.futures
import os
import re
import select
import signal
import socket
import subprocess
import sys
from contextlib import contextmanager
from unittest.mock import MagicMock

import pytest

from circnav_mav.extras.campaign.plan import load_campaign
from circnav_mav.extras.campaign.store import Store
from circnav_mav.runtime import jobs
from tests.process import PATIENCE, ROOT, running

SHORT = '"limits.duration_s" = [1.0]\n'


@contextmanager
def begun(write, tmp_path, processes):
    """Process of a long campaign, after its first rows."""
    path = write(SHORT, "runs = 20000")
    out = tmp_path / "out"
    process = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "circnav_mav",
            "campaign",
            path,
            "--out",
            out,
            "--processes",
            processes,
        ],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # the shell that runs the tests may ignore SIGINT, which a child process inherits
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    table = out / "runs.csv"
    while process.poll() is None and not (table.exists() and table.read_bytes().count(b"\n") > 1):
        select.select([], [], [], 0.05)
    with running(process):
        yield process


@pytest.mark.parametrize(
    ("send", "number", "processes"),
    [(os.kill, signal.SIGTERM, "1"), (os.killpg, signal.SIGINT, "2")],
)
def test_interrupted_campaign_can_be_resumed(write, tmp_path, send, number, processes):
    """Ctrl-C on a terminal sends SIGINT to all processes of the campaign."""
    with begun(write, tmp_path, processes) as campaign:
        send(campaign.pid, number)
        output, errors = campaign.communicate(timeout=PATIENCE)
    assert campaign.returncode == 130, errors
    assert f"continue with --out {tmp_path / 'out'} --resume" in output
    assert "Traceback" not in errors
    # opening for resuming raises an error if a row is incomplete
    Store(tmp_path / "out", load_campaign(tmp_path / "campaign.toml"), resume=True).close()


# --- a Dask scheduler


@pytest.fixture
def refusal():
    """Return a function that gives the reason why an address is no usable scheduler:
    refusal(address)."""

    def refusal(address):
        with pytest.raises(jobs.JobsError) as caught:
            list(jobs.fly(abs, [(1,)], 1, address))
        assert "\n" not in str(caught.value)
        return str(caught.value)

    return refusal


@pytest.fixture
def distributed():
    return pytest.importorskip("distributed", reason="needs the extra [cluster]")


@pytest.mark.parametrize(
    ("address", "listens", "error"),
    [
        ("foo", False, "write it as tcp://HOST:PORT"),
        ("tcp://127.0.0.1:99999", False, "write it as tcp://HOST:PORT"),
        ("ucx://127.0.0.1:8786", False, "write it as tcp://HOST:PORT"),
        ("tls://127.0.0.1:{}", True, "tls needs the certificates"),
        ("tcp://127.0.0.1:{}", False, "no answer: Connection refused"),
        ("tcp://127.0.0.1:{}", True, "no answer: timed out"),
    ],
)
def test_impossible_scheduler_address_is_refused(
    refusal, distributed, monkeypatch, address, listens, error
):
    monkeypatch.setattr(distributed, "Client", None)
    monkeypatch.setattr(jobs, "CONNECT_TIMEOUT", 0.2)
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        if listens:
            other.listen()
        assert error in refusal(address.format(other.getsockname()[1]))


def test_loss_of_scheduler_prints_command_to_resume(refusal, distributed, monkeypatch):
    died = concurrent.futures.Future()
    died.set_exception(distributed.client.FutureCancelledError("fly", "scheduler-connection-lost"))
    client = MagicMock()
    client.return_value.scheduler_info.return_value = {"workers": {"one": None}}
    client.return_value.get_executor.return_value.submit.return_value = died
    client.return_value.__exit__.return_value = False
    monkeypatch.setattr(distributed, "Client", client)
    monkeypatch.setattr(jobs, "_check_scheduler", lambda address: None)
    assert re.search(
        "scheduler-connection-lost.*--resume flies the missing runs", refusal("tcp://there:1")
    )


def test_error_without_dask_names_package_to_install(refusal, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert "pip install distributed" in refusal("tcp://127.0.0.1:9")
