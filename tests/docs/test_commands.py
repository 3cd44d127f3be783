"""Run the commands, transcripts and drivers of the documents as printed, in an empty folder."""

import importlib
import os
import random
import re
import shutil
import signal
import socket
import subprocess
import sys
import threading
import tty
from collections import Counter, deque
from collections.abc import Hashable
from contextlib import suppress
from types import SimpleNamespace

import pytest
from pymavlink import mavutil

from circnav_mav.cli.connect import start_clock
from circnav_mav.mission.load import load_mission
from circnav_mav.pilot import RANGING
from tests.command_line import circnav
from tests.process import COPTER, PATIENCE, ROOT

__all__ = ["circnav"]

ANSWER = b"+OK\r\n+ANCHOR_RCV=DAVID123,5,HELLO,40 cm,-72\r\n"
"""Response from REYAX's RYUW122 AT command guide."""


def blocks(page: str, language: str) -> list[str]:
    text = (ROOT / "docs" / f"{page}.md").read_text()
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


def block(page: str, language: str, coasting: str = "") -> str:
    return next(one for one in blocks(page, language) if coasting in one)


def sent_by_driver(program: str, port: int) -> list[tuple[float, bytes]]:
    """Run a driver on simulated time until its radio has measured 60 ranges, one every 0.1 s.
    Return the time (s) and the datagram of each range."""
    chance = random.Random(1)
    now = 0.0
    sent: list[tuple[float, bytes]] = []

    def read_range() -> float:
        nonlocal now
        if now > 0.0:
            sent.append((now, wire.recv(1000)))
        if len(sent) == 60:
            raise StopIteration
        now += 0.1
        return chance.choice((123.2, 123.4, 123.6))

    names = {"read_range": read_range, "time": SimpleNamespace(monotonic=lambda: now)}
    dialect = mavutil.current_dialect
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as wire:
        wire.bind(("127.0.0.1", port))
        wire.settimeout(PATIENCE)
        with pytest.raises(StopIteration):
            exec(program.replace("import time\n", "", 1), names)
    names["link"].close()
    mavutil.set_dialect(dialect)
    return sent


class Radio:
    """Ranging link that receives datagrams at simulated times."""

    def __init__(self, sent: list[tuple[float, bytes]]) -> None:
        self.troubles: Counter[str] = Counter()
        self._sent = deque(sent)

    def fileno(self) -> None:
        """Return None: no descriptor to wait for."""

    def receive(self, now: float) -> list[tuple[bytes, Hashable]]:
        due = []
        while self._sent and self._sent[0][0] <= now:
            due.append((self._sent.popleft()[1], "driver"))
        return due

    def send(self, data: bytes, to: Hashable) -> None:
        """Ignore the hello: the driver of the page only sends."""


def test_documented_driver_passes_preflight_with_documented_mission_lines(
    circnav, port, monkeypatch
):
    """Driver and preflight run in simulated time."""
    program = block("own-vehicle", "python").replace("14560", str(port))
    ranging = block("own-vehicle", "toml", "[ranging]").replace("14560", str(port))
    lines = re.findall(r"^(\w+) = (\S+)", ranging, re.MULTILINE)
    assert len(lines) == 5
    overrides = [word for key, value in lines for word in ("--set", f"ranging.{key}={value}")]
    sent = sent_by_driver(program, port)

    def start(mission, session, links):
        links.pop(RANGING)  # the opened port, which would make simulated time follow real time
        clock = start_clock(mission, session, links)
        links[RANGING] = Radio(sent)
        return clock

    # import by name, because the attribute `preflight` of the package is the command
    command = importlib.import_module("circnav_mav.cli.preflight")
    monkeypatch.setattr(command, "start_clock", start)
    printed = circnav("preflight", COPTER, *overrides, "--seconds", "3", "-v").done
    lines_after = printed.split("listening")[1]
    for subject in ("ranging", "rejected", "noise", "stamps"):
        assert re.search(rf"^PASS  {subject} ", lines_after, re.MULTILINE), printed
    assert re.search(r"newest 123\.[246]0 m", lines_after)


@pytest.fixture
def module():
    """Serial port of a simulated radio module that answers requests."""
    pytest.importorskip("serial")
    ours, theirs = os.openpty()
    tty.setraw(theirs)

    def answer() -> None:
        received = b""
        with suppress(OSError):  # raised when the test closes the line
            while data := os.read(ours, 1000):
                *questions, received = (received + data).split(b"\r\n")
                os.write(ours, ANSWER * questions.count(b"AT+ANCHOR_SEND=DAVID123,4,RNGE"))

    threading.Thread(target=answer, daemon=True).start()
    yield os.ttyname(theirs)
    os.close(theirs)


def test_installed_driver_of_radios_page_prints_documented_output(tmp_path, module):
    shutil.copy(ROOT / "docs" / "circnav_ryuw122.py", tmp_path)
    entry = re.search(
        r"\[project.entry-points.\"(.+)\"\]\n(.+)", block("radios", "toml", "entry-points")
    )
    # as pip generates it from pyproject.toml
    installed = tmp_path / "circnav_ryuw122-0.1.0.dist-info"
    installed.mkdir()
    (installed / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: circnav-ryuw122\nVersion: 0.1.0\n"
    )
    (installed / "entry_points.txt").write_text(f"[{entry[1]}]\n{entry[2].replace(chr(34), '')}\n")
    command, *lines = block("radios", "console", "ranging watch").split("$ ")[2].splitlines()
    words = command.replace("/dev/ttyUSB0", module).replace("--seconds 1", "--seconds 60").split()
    watch = subprocess.Popen(
        [sys.executable, "-m", "circnav_mav", *words[1:]],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{tmp_path}"},
    )
    line = next((line for line in watch.stdout if "scatter" in line), "")
    watch.send_signal(signal.SIGINT)
    _, problem = watch.communicate(timeout=PATIENCE)
    assert (watch.returncode, problem) == (0, "")
    (printed,) = lines
    assert plain(line) == plain(printed)


def plain(line: str) -> list[str]:
    """Return the words of a line, with the radio's times and rates masked."""
    return (re.sub(r"[\d.]+ (s|Hz)", "# \\1", line) if "beacon" in line else line).split()


def test_mission_of_radios_page_loads():
    lines = re.findall(r"^(\w+) = (\S+)", block("radios", "toml", "linktrack:"), re.MULTILINE)
    mission = load_mission(COPTER, [f"ranging.{key}={value}" for key, value in lines])
    assert mission.ranging_driver == "linktrack"
    settings = mission
    assert (settings.ranging.beacon_id, settings.ranging.sigma_m, settings.ranging_apart) == (
        3,
        0.1,
        True,
    )
    assert settings.unsigned_links == {"ranging"}
    without = [f"ranging.{key}={value}" for key, value in lines if key != "beacon_id"]
    assert load_mission(COPTER, without).ranging.beacon_id is None
