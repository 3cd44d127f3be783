"""Real ground stations beside circnav on the emulator: they change the radius of the circle and
take over the vehicle."""

import contextlib
import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.process import (
    PATIENCE,
    ROOT,
    UNDRAWN,
    python,
    read_until,
    reserved_port,
    running,
    until,
)

MAVPROXY = "MAVProxy==1.8.75"


class Stage:
    """An emulator on a separate port, and circnav as a process that flies its vehicle."""

    def __init__(self, mission: str, folder: Path, open_things: contextlib.ExitStack) -> None:
        self.port = open_things.enter_context(reserved_port())
        self._open_things = open_things
        self._mission = str(ROOT / "config" / f"{mission}.toml")
        self._folder = folder
        here = f"udpin:127.0.0.1:{self.port}"
        vehicle = self.start("-m", "circnav_mav", "emulate", self._mission, "--endpoint", here)
        read_until(vehicle, "udpin")

    def start(self, *arguments: str, **environment: str) -> subprocess.Popen[str]:
        """Start a Python process that ends with the test."""
        process = python(*arguments, stdin=subprocess.PIPE, stderr=subprocess.STDOUT, **environment)
        return self._open_things.enter_context(running(process))

    def fly(self) -> subprocess.Popen[str]:
        """Start circnav, which draws no pictures, and return its process once it is engaged."""
        process = self.start(
            *("-c", UNDRAWN, "fly", self._mission),
            *("--endpoint", f"udpout:127.0.0.1:{self.port}", "--out", str(self._folder)),
            *("--duration", "600"),
            *("--set", "link.unsigned_parameters=true", "--set", 'guidance.law="smooth"'),
        )
        read_until(process, "engaged")
        return process

    def verdict(self, process: subprocess.Popen[str]) -> tuple[int, str]:
        """Return exit code and reason of circnav."""
        process.communicate(timeout=PATIENCE)
        return process.returncode, json.loads((self._folder / "summary.json").read_text())["reason"]


@pytest.fixture
def stage(tmp_path: Path) -> Iterator[Callable[[str], Stage]]:
    with contextlib.ExitStack() as open_things:
        yield lambda mission: Stage(mission, tmp_path / "run", open_things)


@pytest.fixture(scope="session")
def mavproxy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Install MAVProxy from PyPI in a separate folder, without its gigabyte of graphics
    dependencies."""
    folder = tmp_path_factory.mktemp("mavproxy")
    options = ("--quiet", "--no-deps", "--no-compile", "--target", str(folder))
    install = [sys.executable, "-m", "pip", "install", *options, MAVPROXY]
    if subprocess.run(install, capture_output=True, check=False).returncode != 0:
        pytest.skip("MAVProxy cannot be installed here")
    return folder


def type_in(process: subprocess.Popen[str], line: str) -> None:
    """Type a line into the terminal of a process."""
    assert process.stdin is not None
    process.stdin.write(f"{line}\n")
    process.stdin.flush()


def test_mavproxy_changes_radius_and_takes_over(stage, mavproxy, tmp_path):
    on = stage("arducopter")
    ours = on.fly()
    station = on.start(
        *("-m", "MAVProxy.mavproxy", f"--state-basedir={tmp_path}"),
        f"--master=udpout:127.0.0.1:{on.port}",
        "--default-modules=mode,param,link,misc,wp,cmdlong",
        PYTHONPATH=str(mavproxy),
        PYTHONUNBUFFERED="1",
    )
    # MAVProxy has read vehicle, mode, armed state and parameters
    printed = read_until(station, "Received")
    assert "Detected vehicle 1:1" in printed
    assert "ARMED" in printed
    assert "GUIDED> Mode GUIDED" in printed
    # MAVProxy lists circnav's parameters, and circnav flies the radius set there
    type_in(station, "vehicle 1:191")
    type_in(station, "param fetch")
    read_until(station, "Received 7 parameters")
    type_in(station, "param set CN_RADIUS 40")
    read_until(station, "circnav: next circle, 40 m clockwise")
    # the vehicle answers a command and a request of its mission plan
    type_in(station, "long DO_SET_HOME 1")
    read_until(station, "DO_SET_HOME: UNSUPPORTED")
    type_in(station, "wp list")
    read_until(station, "0 waypoints")
    type_in(station, "vehicle 1:1")
    type_in(station, "status VFR_HUD")
    type_in(station, "mode BRAKE")
    read_until(station, "Mode BRAKE")
    code, reason = on.verdict(ours)
    assert code == 4 and reason.startswith("pilot or failsafe switched to BRAKE after ")


def test_mavsdk_changes_radius_and_takes_over(stage: Callable[[str], Stage]) -> None:
    mavsdk = pytest.importorskip("mavsdk")
    from mavsdk.plugins.action import Action
    from mavsdk.plugins.param import Param, ParamError, ProtocolVersion
    from mavsdk.plugins.telemetry import FlightMode, Telemetry

    on = stage("px4_copter")
    ours = on.fly()
    client = mavsdk.Mavsdk(
        mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION)
    )
    try:
        assert (
            client.add_any_connection(f"udpout://127.0.0.1:{on.port}")
            == mavsdk.ConnectionResult.SUCCESS
        )
        system = client.first_autopilot(PATIENCE)
        assert system is not None
        telemetry = Telemetry(system)
        until(lambda: telemetry.armed() and telemetry.flight_mode() == FlightMode.OFFBOARD)
        until(lambda: telemetry.position().relative_altitude_m > 10)
        editor = Param(system)
        with contextlib.suppress(ParamError):  # the selection succeeds although UNKNOWN is reported
            editor.select_component(191, ProtocolVersion.V1)
        assert editor.get_param_float("CN_RADIUS") == 50.0
        editor.set_param_float("CN_RADIUS", 60.0)
        assert editor.get_param_float("CN_RADIUS") == 60.0
        Action(system).hold()
        code, reason = on.verdict(ours)
        assert code == 4 and reason.startswith("pilot or failsafe switched to AUTO.LOITER after ")
    finally:
        client.destroy()
