"""`auto` through MAVLink in the situations of the benchmark, each on the plane or the copter of the emulator.

Wind and moving targets in shares of the speed; the copter's autopilot holds its speed over the ground, so wind does
not reach the guidance there.
"""

import pytest

from circnav_mav.pilot import Ending
from tests.flight.lockstep import Flight, clockwise_turns, flight, rms_error

SPEED = {"arduplane": 22.0, "arducopter": 5.0}
DURATION, JUDGED = 110.0, 50.0


def wind(share: float) -> str:
    return f"sim.wind.speed_mps={share * SPEED['arduplane']}"


def moving(mission: str, share: float = 0.2) -> str:
    return f"sim.target.velocity_north_mps={share * SPEED[mission]}"


def radio(preset: str, sigma: float) -> tuple[str, ...]:
    return (f'sim.ranging.preset="{preset}"', f"ranging.sigma_m={sigma}")


SILENT = 'sim.events=[{at_s=75.0, action="mute_ranging"}, {at_s=85.0, action="unmute_ranging"}]'
SPARSE = ("sim.ranging.rate_hz=5.0", "ranging.rate_hz=5.0", "sim.ranging.dropout_fraction=0.5")
THIN_AIR = ("sim.start.altitude_m=3416.0", "sim.target.altitude_m=3356.0", "sim.vehicle.airspeed_scale=1.223")
SITUATIONS: dict[str, tuple[tuple[str, ...], float]] = {  # overrides, largest RMS radius error in m
    "plane, wind .53 V": ((wind(0.53), "orbit.radius_m=200.0"), 0.6),
    "plane, 4000 m above the sea": ((wind(0.2), *THIN_AIR), 0.35),
    "plane, target .2 V, wind .2 V": ((moving("arduplane"), wind(0.2)), 0.3),
    "plane, gusts": ((wind(0.33), "sim.wind.gust_rms_mps=1.5", "sim.wind.gust_time_s=10.0"), 3.0),
    "plane, lora": ((wind(0.2), *radio("lora", 2.2)), 3.0),
    "plane, outage": ((wind(0.2), SILENT), 1.0),
    "plane, compass bias": ((wind(0.2), "sim.sensors.heading_bias_deg=10.0"), 0.3),
    "copter, 50 % loss at 5 Hz": (SPARSE, 1.0),
    "copter, heading drift": (("sim.sensors.heading_drift_deg_s=0.1",), 0.4),
}


@pytest.mark.parametrize("name", SITUATIONS)
def test_auto_holds_the_circle_in_the_sense_asked_for(name: str) -> None:
    overrides, most = SITUATIONS[name]
    flown = flown_by_auto("arduplane" if name.startswith("plane") else "arducopter", overrides)
    end = [truth for truth in flown.truths if truth.time > flown.now - JUDGED]
    assert flown.outcome.ending is Ending.COMPLETED
    assert rms_error(end, flown.pilot.settings.orbit.radius) < most
    assert clockwise_turns(end) > 0.7
    assert "drift" in {tick.law for tick in flown.ticks[-40:]}


def flown_by_auto(mission: str, overrides: tuple[str, ...]) -> Flight:
    return flight(mission, *overrides, f"limits.duration_s={DURATION}", law="auto").fly(DURATION + 60)
