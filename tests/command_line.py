"""The command line run inside the test, with exit code and output, and a recorded flight as
input."""

import importlib
import json
import os
import pty
import shutil
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import IO

import pytest

from circnav_mav.cli import main
from circnav_mav.runtime.runner import ENDING
from tests import small_mission
from tests.browser import CHROMIUM, Browser
from tests.flight.recorded import recorded_flight
from tests.process import PATIENCE, ROOT, UNDRAWN

FULL = "circnav: standard output cannot be written: No space left on device\n"


@dataclass
class Ran:
    """Exit code and output of a command."""

    code: int
    out: str
    err: str

    @property
    def done(self) -> str:
        """Output of a command without errors."""
        assert (self.code, self.err) == (0, ""), self.out
        return self.out

    @property
    def line(self) -> str:
        """The error message, which must be one line without a traceback."""
        lines = self.err.strip().splitlines()
        assert len(lines) == 1, self.err
        assert "Traceback" not in self.out + self.err
        return lines[0]

    @property
    def refused(self) -> str:
        """The error line of a command that ended with the exit code of a wrong use."""
        before, _, told = self.line.partition("circnav: ")
        assert (self.code, before) == (2, "")
        return told


@pytest.fixture
def circnav(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> Iterator[Callable[..., Ran]]:
    """Run `circnav ARGUMENTS` in an empty folder."""
    handlers = {number: signal.getsignal(number) for number in (*ENDING, signal.SIGHUP)}
    monkeypatch.chdir(tmp_path)

    def run(*arguments: object) -> Ran:
        monkeypatch.setattr(sys, "argv", ["circnav", *map(str, arguments)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as left:
            main()
        out, err = capsys.readouterr()
        return Ran(int(left.value.code or 0), out, err)

    yield run
    for number, handler in handlers.items():
        signal.signal(number, handler)


@pytest.fixture
def mission(tmp_path: Path) -> Path:
    """A mission file for a real vehicle that does not answer. The flight waits for 0.3 s."""
    path = tmp_path / "mission.toml"
    path.write_text(
        small_mission.TEXT.replace('127.0.0.1:14550"', '127.0.0.1:0"\nwait_s = 0.3'),
        encoding="utf-8",
    )
    return path


@pytest.fixture(scope="session")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run folder of 13 s of the quickstart without summary.json, as a killed process leaves it.
    Tests must not change it."""
    folder = tmp_path_factory.mktemp("flown")
    recorded_flight(folder, "quickstart", "limits.duration_s=13").fly(20).recorder.close()
    return folder


@pytest.fixture
def run(flown: Path, tmp_path: Path) -> Path:
    """A copy of the flown run folder."""
    return shutil.copytree(flown, tmp_path / "run")


@pytest.fixture
def with_manifest(run: Path) -> Callable[..., None]:
    """Return a function that changes values of the run's manifest.json:
    with_manifest(output_mode="shadow")."""
    path = run / "manifest.json"
    return lambda **changed: (
        path.write_text(json.dumps(json.loads(path.read_text()) | changed)) and None
    )


@pytest.fixture
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Write reports without flight.png, which takes most of their time to draw."""
    # import by name, because the attribute `report` of the package is the command
    module = importlib.import_module("circnav_mav.cli.report")
    monkeypatch.setattr(module, "plot_flight", lambda path, *what: path.write_bytes(b"a picture"))


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fly without pictures, because a separate process needs 1 s to draw them."""
    # import by name, because the attribute `fly` of the package is the command
    fly = importlib.import_module("circnav_mav.cli.fly")
    monkeypatch.setattr(fly, "Drawing", lambda folder: SimpleNamespace(draw=list))


@contextmanager
def terminal() -> Iterator[list[bytes]]:
    """Make standard error a terminal. The list holds the output to it, completely after the
    block."""
    ours, theirs = pty.openpty()
    shown: list[bytes] = []

    def receive() -> None:
        # the read fails when the other end is closed
        with suppress(OSError):
            while True:
                shown.append(os.read(ours, 1 << 16))

    # a terminal that is not read would block the command
    reader = threading.Thread(target=receive)
    reader.start()
    before = sys.stderr
    with os.fdopen(theirs, "w") as sys.stderr:
        try:
            yield shown
        finally:
            sys.stderr = before
    reader.join()
    os.close(ours)


@pytest.fixture
def busy_port() -> Iterator[int]:
    """A UDP port in use by another socket."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        yield other.getsockname()[1]


@pytest.fixture(scope="session")
def chromium(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """One browser for all tests, because a browser takes seconds to start."""
    if CHROMIUM is None:
        pytest.skip("no Chromium here")
    with closing(Browser(tmp_path_factory.mktemp("profile"))) as browser:
        yield browser


@pytest.fixture
def browser(chromium: Browser) -> Browser:
    """The browser, whose page had no errors before this test."""
    chromium.open("about:blank")
    chromium.complaints.clear()
    return chromium


def ended(
    place,
    command,
    stdout=subprocess.PIPE,
    stderr=subprocess.PIPE,
    *,
    limit="-f unlimited",
    **environment,
):
    """Run `circnav COMMAND` under a limit of `ulimit`. A limited file size (-f, kB) simulates a
    full disk. No bytecode is written, because the limit would truncate it too."""
    program = ["-c", UNDRAWN] if command.startswith("fly") else ["-m", "circnav_mav"]
    words = [sys.executable, "-B", *program, *command.split()]
    return subprocess.run(
        ["bash", "-c", f'ulimit {limit}; exec "$@"', "bash", *words],
        cwd=place,
        stdout=stdout,
        stderr=stderr,
        text=True,
        check=False,
        env={"PYTHONPATH": str(ROOT), "PATH": "/bin"} | environment,
        timeout=PATIENCE,
    )


@pytest.fixture
def full() -> Iterator[IO[str]]:
    """A file on a full disk."""
    if not Path("/dev/full").exists():
        pytest.skip("needs /dev/full")
    with Path("/dev/full").open("w") as file:
        yield file
