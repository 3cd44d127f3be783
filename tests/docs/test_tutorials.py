"""The tutorials: every command in a block of theirs runs in an empty folder, and each leaves what it speaks of."""

import re
import subprocess
import sys

import pytest

from tests.process import PATIENCE, ROOT

LEAVES = {
    "pilot": ("beacon.toml", "runs/*-beacon/report.html"),
    "researcher": ("bench/table.csv", "run/ticks.csv", "again/ticks.csv"),
    "integrator": ("mine.toml", "run/flight.mcap", "run/flight.tlog"),
}


@pytest.mark.parametrize("reader", LEAVES)
def test_the_commands_of_a_tutorial_run_as_printed(reader, tmp_path):
    page = (ROOT / "docs" / f"tutorial-{reader}.md").read_text()
    commands = "".join(re.findall(r"^```sh\n(.*?)^```", page, re.MULTILINE | re.DOTALL))
    script = re.sub(r"^circnav ", f"{sys.executable} -m circnav_mav ", commands, flags=re.MULTILINE)
    ran = subprocess.run(
        ["sh", "-e", "-c", script], cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE,
        env={"PYTHONPATH": str(ROOT), "PATH": "/usr/bin:/bin"}, check=False,
    )  # fmt: skip
    assert ran.returncode == 0, ran.stdout + ran.stderr
    for name in LEAVES[reader]:
        assert list(tmp_path.glob(name)), name
