"""The transcripts of docs/first-minute.md: their commands run again in an empty folder, and print what stands there."""

import re
import subprocess
import sys
from pathlib import Path

from tests.process import PATIENCE, ROOT

PAGE = (ROOT / "docs" / "first-minute.md").read_text()


def test_the_transcripts_are_what_the_commands_print(tmp_path: Path) -> None:
    flown = 0
    for shown in re.findall(r"^\$ .+?(?=^\$ |^```)", PAGE, re.MULTILINE | re.DOTALL):
        line, *expected = shown.splitlines()
        command = re.sub(r" +\(\d+ s\)$", "", line.removeprefix("$ "))
        if command.startswith(("python3 -m venv", "pip install")):
            continue
        again = re.sub(r"^circnav ", f"{sys.executable} -m circnav_mav ", command)
        ran = subprocess.run(
            again, shell=True, cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE,
            env={"PYTHONPATH": str(ROOT), "PATH": "/usr/bin:/bin"}, check=False,
        )  # fmt: skip
        assert (ran.returncode, ran.stderr) == (0, ""), command
        printed = ran.stdout.splitlines()
        for one in expected:
            if one != "  ..." and "run folder" not in one:
                assert one in printed, command
        flown += "fly" in command
    assert flown == 2
