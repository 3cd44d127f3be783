"""docs/beacon.py against the emulator with its own radio switched off: the range of a simulator that has none."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def start(*command: str) -> subprocess.Popen[str]:
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.Popen([sys.executable, *command], stdout=subprocess.PIPE, text=True, cwd=ROOT, env=env)


@pytest.mark.parametrize("profile", ["arducopter", "px4_copter"])
def test_a_simulator_without_a_radio_gets_one(profile: str, tmp_path: Path) -> None:
    mission = tmp_path / "mission.toml"
    text = (ROOT / "config" / f"{profile}.toml").read_text()
    mission.write_text(text.replace("rate_hz = 10.0\nnoise_m", "rate_hz = 0.0\nnoise_m"))
    at = f"127.0.0.1:{31000 + os.getpid() % 4000}"
    vehicle = start("-m", "circnav_mav", "emulate", str(mission), "--endpoint", f"udpin:{at}", "--speed", "3")
    processes = [vehicle]
    try:
        assert vehicle.stdout is not None
        vehicle.stdout.readline()
        processes.append(start("docs/beacon.py", f"udpout:{at}", "--north", "30", "--east", "40", "--seed", "1"))
        overrides = ("--set", 'link.clock="autopilot"', "--seconds", "5")
        survey = start("-m", "circnav_mav", "preflight", str(mission), "--endpoint", f"udpout:{at}", *overrides)
        printed, _ = survey.communicate(timeout=60)
    finally:
        for process in processes:
            process.terminate()
            process.communicate(timeout=10)
    lines = {line.split()[1]: line for line in printed.split("listening")[1].splitlines()[1:] if line[:4] != "conf"}
    assert lines["ranging"].startswith("PASS"), printed
    assert lines["noise"].startswith("PASS"), printed
    assert lines["stamps"].startswith("PASS"), printed
    assert float(lines["distance"].split()[2]) == pytest.approx((50**2 + 15**2) ** 0.5, abs=4.0)  # drift, noise
    assert survey.returncode == 0, printed
