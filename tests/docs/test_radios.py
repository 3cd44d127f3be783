"""The driver of docs/radios.md, installed and watched as the page says, with a module that answers as Reyax's guide."""

import os
import re
import subprocess
import sys
import threading
import tty
from contextlib import suppress
from pathlib import Path

import pytest

from circnav_mav.mission.load import load_mission
from tests.process import COPTER, PATIENCE, ROOT

pytest.importorskip("serial")
PAGE = (Path(__file__).parents[2] / "docs" / "radios.md").read_text()
ANSWER = b"+OK\r\n+ANCHOR_RCV=DAVID123,5,HELLO,40 cm,-72\r\n"
"""Of REYAX's RYUW122 AT command guide."""


def block(language: str, holding: str) -> str:
    blocks = re.findall(rf"^```{language}\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    return next(one for one in blocks if holding in one)


@pytest.fixture
def module():
    """A module on a serial line, which answers what it is asked."""
    ours, theirs = os.openpty()
    tty.setraw(theirs)

    def answer() -> None:
        heard = b""
        with suppress(OSError):  # once the test has closed the line
            while data := os.read(ours, 1000):
                *questions, heard = (heard + data).split(b"\r\n")
                os.write(ours, ANSWER * questions.count(b"AT+ANCHOR_SEND=DAVID123,4,RNGE"))

    threading.Thread(target=answer, daemon=True).start()
    yield os.ttyname(theirs)
    os.close(theirs)


def test_the_driver_of_the_page_is_found_and_reads_as_printed(tmp_path, module):
    driver = block("python", "Ryuw122")
    assert len(driver.splitlines()) <= 60
    (tmp_path / "circnav_ryuw122.py").write_text(driver)
    entry = re.search(r"\[project.entry-points.\"(.+)\"\]\n(.+)", block("toml", "entry-points"))
    installed = tmp_path / "circnav_ryuw122-0.1.0.dist-info"  # what pip makes of pyproject.toml
    installed.mkdir()
    (installed / "METADATA").write_text("Metadata-Version: 2.1\nName: circnav-ryuw122\nVersion: 0.1.0\n")
    (installed / "entry_points.txt").write_text(f"[{entry[1]}]\n{entry[2].replace(chr(34), '')}\n")
    command, *lines = block("console", "ranging watch").split("$ ")[2].splitlines()
    ran = subprocess.run(
        [sys.executable, "-m", "circnav_mav", *command.replace("/dev/ttyUSB0", module).split()[1:]],
        cwd=ROOT, env={**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{tmp_path}"}, timeout=PATIENCE,
        capture_output=True, text=True,
    )  # fmt: skip
    assert (ran.returncode, ran.stderr) == (0, "")
    told = ran.stdout.splitlines()
    assert len(told) == len(lines)
    for line, printed in zip(told, lines, strict=True):
        assert "0.40 m" in line
        assert re.sub(r"[\d.]+ (s|Hz)", "# \\1", line).split() == re.sub(r"[\d.]+ (s|Hz)", "# \\1", printed).split()


def test_the_mission_of_the_page_is_one():
    lines = re.findall(r"^(\w+) = (\S+)", block("toml", "linktrack:"), re.MULTILINE)
    mission = load_mission(COPTER, [f"ranging.{key}={value}" for key, value in lines])
    assert mission.ranging_driver == "linktrack"
    settings = mission.pilot_settings()
    assert (settings.ranging.beacon_id, settings.ranging.sigma, settings.ranging_apart) == (3, 0.1, True)
    assert settings.unsigned_links == {"ranging"}
    without = [f"ranging.{key}={value}" for key, value in lines if key != "beacon_id"]
    assert load_mission(COPTER, without).pilot_settings().ranging.beacon_id is None
