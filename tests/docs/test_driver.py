"""The driver of docs/own-vehicle.md for a ranging radio of one's own, run as it is printed, heard by `preflight`."""

import re
import socket
import subprocess
import sys
from pathlib import Path

from tests.process import COPTER, PATIENCE, UNHURRIED, circnav

PAGE = (Path(__file__).parents[2] / "docs" / "own-vehicle.md").read_text()
RADIO = "import random\n\ndef read_range():\n    time.sleep(0.1)\n    return random.choice((123.2, 123.4, 123.6))\n"


def block(language: str) -> str:
    found = re.search(rf"^```{language}\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    assert found is not None
    return found[1]


def test_the_printed_driver_is_heard_under_the_printed_mission_lines(tmp_path, port):
    driver = tmp_path / "driver.py"
    driver.write_text(block("python").replace("link = ", f"{RADIO}\nlink = ", 1).replace("14560", str(port)))
    lines = re.findall(r"^(\w+) = (\S+)", block("toml").replace("14560", str(port)), re.MULTILINE)
    assert len(lines) == 5
    overrides = [word for key, value in lines for word in ("--set", f"ranging.{key}={value}")]
    radio = subprocess.Popen([sys.executable, str(driver)])
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as wire:  # until it speaks
            wire.bind(("127.0.0.1", port))
            wire.settimeout(PATIENCE)
            wire.recv(1000)
        survey = circnav("preflight", COPTER, *overrides, "--set", "link.sim_speed=1.0", "--seconds", "3", *UNHURRIED)
        printed, problem = survey.communicate(timeout=PATIENCE)
    finally:
        radio.terminate()
        radio.wait(PATIENCE)
    assert survey.returncode == 0, printed + problem
    judged = printed.split("listening")[1]
    for subject in ("ranging", "rejected", "noise", "stamps"):
        assert re.search(rf"^PASS  {subject} ", judged, re.MULTILINE), printed
    assert re.search(r"newest 123\.[246]0 m", judged)
