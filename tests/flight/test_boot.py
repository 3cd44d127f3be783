"""`circnav fly` at boot, before the serial device of the autopilot exists."""

import os
import pty
import signal
import tty
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import all as mavlink

from tests.process import COPTER, PATIENCE, circnav, read_until

HEARTBEAT = mavlink.MAVLink_heartbeat_message(
    mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, 81, 0, 4, 3
)


def test_fly_opens_serial_device_that_appears_after_start(tmp_path: Path) -> None:
    pytest.importorskip("serial")
    device = tmp_path / "tty"
    endpoint = f"serial:{device}:57600"
    process = circnav(
        "fly", COPTER, "--endpoint", endpoint, "--out", str(tmp_path / "run"), drawn=False
    )
    read_until(process, "no such device: waiting for the device")
    master, slave = pty.openpty()
    tty.setraw(slave)
    device.symlink_to(os.ttyname(slave))
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    os.write(master, HEARTBEAT.pack(sender))
    answer = os.read(master, 1000)
    assert [frame.get_srcComponent() for frame in mavlink.MAVLink(None).parse_buffer(answer)]
    process.send_signal(signal.SIGTERM)
    printed, _ = process.communicate(timeout=PATIENCE)
    assert process.returncode == 130
    assert "no such device" not in printed, "no warning at the end about a device that has appeared"
