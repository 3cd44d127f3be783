"""The command line run inside the test, with its exit code and what it printed."""

import signal
import socket
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from circnav_mav.cli import main
from tests import small_mission

TEXT = small_mission.TEXT.replace('127.0.0.1:14550"', '127.0.0.1:0"\nwait_s = 0.3')


@dataclass
class Ran:
    """How a command ended."""

    code: int
    out: str
    err: str

    @property
    def line(self) -> str:
        """What a person was told: one line, and no traceback."""
        lines = self.err.strip().splitlines()
        assert len(lines) == 1, self.err
        assert "Traceback" not in self.out + self.err
        return lines[0]


@pytest.fixture
def circnav(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> Iterator[Callable[..., Ran]]:
    """Run `circnav ARGUMENTS` in an empty folder."""
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
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
def text() -> str:
    return TEXT


@pytest.fixture
def mission(tmp_path: Path) -> Path:
    """A mission file that a real vehicle would have to answer; it waits for 0.3 s."""
    path = tmp_path / "mission.toml"
    path.write_text(TEXT, encoding="utf-8")
    return path


@pytest.fixture
def config() -> Path:
    """The folder of the mission files that ship."""
    return Path(__file__).parents[2] / "config"


@pytest.fixture
def busy_port() -> Iterator[int]:
    """A UDP port that somebody else has."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        yield other.getsockname()[1]


@pytest.fixture
def closed_port() -> Iterator[int]:
    """A TCP port where nobody listens, and nobody can meanwhile."""
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        yield unused.getsockname()[1]
