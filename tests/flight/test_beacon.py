"""docs/beacon.py against the emulator without its own radio: the program supplies the ranges."""

import runpy
import sys
from collections import deque
from typing import Any

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.mav.check_result import Grade
from circnav_mav.preflight.checks import judge
from tests.pilot.test_preflight import Bench
from tests.process import ROOT


class PreflightDoneError(Exception):
    """Raised when the preflight has finished, to end docs/beacon.py."""


class Wire:
    """Link of docs/beacon.py to the emulated vehicle, with the interface of `mavutil`. Receiving
    advances vehicle and preflight in lockstep."""

    def __init__(self, bench: Bench) -> None:
        self.mav = mavlink.MAVLink(self, 1, 192)
        self._parser = mavlink.MAVLink(None)
        self._bench = bench
        self._heard = deque[Any]()

    def write(self, data: bytes) -> None:
        """Deliver a frame of the program to the vehicle."""
        self._bench.vehicle.receive(bytes(data), "radio")

    def recv_match(self, type: list[str], **_: object) -> Any:
        while not self._heard:
            if self._bench.listener.done:
                raise PreflightDoneError
            self._bench.step()
            frames = b"".join(self._bench.vehicle.outgoing("radio"))
            self._heard += [
                one for one in self._parser.parse_buffer(frames) or () if one.get_type() in type
            ]
        return self._heard.popleft()


@pytest.mark.parametrize("profile", ["arducopter", "px4_copter"])
def test_beacon_program_supplies_ranges_to_simulator(
    profile: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = Bench(profile, "sim.ranging.rate_hz=0.0", seconds=10.0)
    monkeypatch.setattr(mavutil, "mavlink_connection", lambda *_args, **_named: Wire(bench))
    monkeypatch.setattr(
        sys, "argv", ["beacon.py", "udpout:here", "--north", "30", "--east", "40", "--seed", "1"]
    )
    with pytest.raises(PreflightDoneError):
        runpy.run_path(str(ROOT / "docs" / "beacon.py"))["main"]()
    lines = {line.subject: line for line in judge(bench.mission, bench.listener)}
    assert {subject: lines[subject].grade for subject in ("ranging", "noise", "stamps")} == {
        "ranging": Grade.PASS, "noise": Grade.PASS, "stamps": Grade.PASS,
    }  # fmt: skip
    # tolerance for drift and noise, m
    assert float(lines["distance"].text.split()[0]) == pytest.approx(
        (50**2 + 15**2) ** 0.5, abs=4.0
    )
