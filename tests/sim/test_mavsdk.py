"""MAVSDK as an independent client: it detects a vehicle, reads its mode and telemetry, and flies it
where supported.

ArduPilot sends no streams without a request, so the rates are requested first. MAVSDK's offboard
mode is supported only with PX4.
"""

import contextlib
import math
import time
from collections.abc import Callable
from typing import Any

import pytest

mavsdk = pytest.importorskip("mavsdk")
from mavsdk.plugins.action import Action  # noqa: E402
from mavsdk.plugins.offboard import Offboard, VelocityBodyYawspeed  # noqa: E402
from mavsdk.plugins.telemetry import FlightMode, Telemetry  # noqa: E402

from tests.process import PATIENCE, python, reserved_port, running, until  # noqa: E402

PX4 = 1
ARDUPILOT = 2


@pytest.fixture
def connect(tmp_path):
    """Start an emulator of a profile in its own process and return it as a MAVSDK system."""
    open_things = contextlib.ExitStack()

    def start(profile: str) -> Any:
        port = open_things.enter_context(reserved_port())
        client = mavsdk.Mavsdk(
            mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION)
        )
        open_things.callback(client.destroy)
        assert (
            client.add_any_connection(f"udpin://127.0.0.1:{port}")
            == mavsdk.ConnectionResult.SUCCESS
        )
        vehicle = tmp_path / "vehicle.toml"
        # On a busy machine the emulated vehicle may receive no setpoint for some time.
        vehicle.write_text(f'[vehicle]\nprofile = "{profile}"\nsetpoint_timeout_s = 60.0\n')
        arguments = (str(vehicle), "--endpoint", f"udpout:127.0.0.1:{port}", "--speed", "2")
        open_things.enter_context(running(python("-m", "sim", *arguments)))
        system = client.first_autopilot(PATIENCE)
        assert system is not None
        return system

    with open_things:
        yield start


def test_mavsdk_flies_px4_in_offboard(connect: Callable[[str], Any]):
    system = connect("px4_copter")
    assert (system.get_system_id(), int(system.autopilot_type())) == (1, PX4)
    telemetry = Telemetry(system)
    action = Action(system)
    offboard = Offboard(system)
    until(
        lambda: (
            telemetry.armed() and telemetry.in_air() and telemetry.flight_mode() == FlightMode.HOLD
        )
    )
    until(lambda: bool(telemetry.health().is_armable and telemetry.health().is_global_position_ok))
    assert telemetry.position().relative_altitude_m == pytest.approx(50.0, abs=1.0)
    assert telemetry.battery().remaining_percent == pytest.approx(100.0)

    offboard.set_velocity_body(VelocityBodyYawspeed(4.0, 0.0, 0.0, 30.0))
    offboard.start()
    until(lambda: telemetry.flight_mode() == FlightMode.OFFBOARD)
    before = telemetry.attitude_euler()
    # duration in the vehicle's time
    until(lambda: telemetry.attitude_euler().timestamp_us - before.timestamp_us > 2_000_000)
    after = telemetry.attitude_euler()
    turned = math.remainder(math.radians(after.yaw_deg - before.yaw_deg), math.tau)
    # a yaw rate of 30 deg/s is clockwise
    assert 0.5 < turned / ((after.timestamp_us - before.timestamp_us) * 1e-6) < 0.55
    velocity = telemetry.velocity_ned()
    assert 1.0 < math.hypot(velocity.north_m_s, velocity.east_m_s) < 4.5

    action.hold()  # the operator changes the mode
    until(lambda: telemetry.flight_mode() == FlightMode.HOLD)


def test_mavsdk_reads_and_moves_ardupilot(connect: Callable[[str], Any]):
    system = connect("arducopter")
    assert int(system.autopilot_type()) == ARDUPILOT
    telemetry = Telemetry(system)
    action = Action(system)
    # ArduPilot's LOITER is HOLD in MAVSDK
    until(lambda: telemetry.armed() and telemetry.flight_mode() == FlightMode.HOLD)
    time.sleep(0.3)
    assert math.isnan(telemetry.attitude_euler().yaw_deg)
    telemetry.set_rate_attitude_euler(10.0)
    telemetry.set_rate_position(5.0)
    until(lambda: telemetry.attitude_euler().yaw_deg == pytest.approx(0.0, abs=0.1))
    until(lambda: telemetry.position().relative_altitude_m == pytest.approx(50.0, abs=0.1))
    here = telemetry.position()
    action.set_current_speed(8.0)
    # 1e-4 deg of latitude is 11 m
    action.goto_location(
        here.latitude_deg + 1e-4, here.longitude_deg, here.absolute_altitude_m, 0.0
    )
    # ArduPilot's GUIDED is OFFBOARD in MAVSDK
    until(lambda: telemetry.flight_mode() == FlightMode.OFFBOARD)
    until(
        lambda: (
            telemetry.position().latitude_deg == pytest.approx(here.latitude_deg + 1e-4, abs=1e-5)
        )
    )
    action.return_to_launch()
    until(lambda: telemetry.flight_mode() == FlightMode.RETURN_TO_LAUNCH)
