"""The law `auto` over MAVLink, on the emulated plane and copter, in the situations of the
benchmark. Also over a slow link, with a radio that reports too small a sigma, and with less bank
than the mission assumes.

Wind and target speeds are shares of the vehicle's speed. The copter's autopilot holds its speed
over ground, so the wind does not reach the guidance there.
"""

import pytest

from circnav_mav.pilot import Ending
from tests.flight.lockstep import clockwise_turns, flight, last_third, rms_error, tangent, unrest
from tests.tools.fault_link.pipe import Impairment, Pipe

SPEED = {"arduplane": 22.0, "arducopter": 5.0}
BRIEF = ("plane, gusts", "copter, 50 % loss at 5 Hz, heading drift")
"""Situations in which the radius settles early."""


def wind(share: float) -> str:
    return f"sim.wind.speed_mps={share * SPEED['arduplane']}"


def moving(mission: str, share: float = 0.2) -> str:
    return f"sim.target.velocity_north_mps={share * SPEED[mission]}"


def radio(preset: str, sigma: float) -> tuple[str, ...]:
    return (f'sim.ranging.preset="{preset}"', f"ranging.sigma_m={sigma}")


SPARSE = ("sim.ranging.rate_hz=5.0", "ranging.rate_hz=5.0", "sim.ranging.dropout_fraction=0.5")
THIN_AIR = (
    "sim.start.altitude_m=3416.0",
    "sim.target.altitude_m=3356.0",
    "sim.vehicle.airspeed_scale=1.223",
)
SITUATIONS: dict[str, tuple[tuple[str, ...], float]] = {  # overrides, largest RMS radius error in m
    "plane, wind 0.53 V": ((wind(0.53), "orbit.radius_m=200.0"), 0.6),
    "plane, 4000 m above the sea": ((wind(0.2), *THIN_AIR), 0.43),
    "plane, target 0.2 V, wind 0.2 V": ((moving("arduplane"), wind(0.2)), 0.39),
    "plane, gusts": ((wind(0.33), "sim.wind.gust_rms_mps=1.5", "sim.wind.gust_time_s=10.0"), 3.0),
    "plane, lora": ((wind(0.2), *radio("lora", 2.2)), 3.0),
    "copter, 50 % loss at 5 Hz, heading drift": (
        (*SPARSE, "sim.sensors.heading_drift_deg_s=0.1"),
        1.0,
    ),
}
MISSIONS = {"plane": "arduplane", "copter": "arducopter"}  # first word of a situation -> mission

EFFECTIVENESS = 0.747
AIRSPEED_SCALE = 1.065 / 1.033
"""Emulated plane. EFFECTIVENESS: actual over coordinated turn rate. AIRSPEED_SCALE: true airspeed
over the true airspeed that circnav computes from the standard atmosphere."""
NIGHTLY = ("plane, wind 0.53 V", "plane, 4000 m above the sea", "plane, lora")


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.nightly] if name in NIGHTLY else [])
        for name in SITUATIONS
    ],
)
def test_auto_law_keeps_circle_in_weather(name: str) -> None:
    overrides, most = SITUATIONS[name]
    mission = MISSIONS[name.partition(",")[0]]
    lasts, judged = (60.0, 25.0) if name in BRIEF else (100.0, 50.0)
    flown = flight(mission, *overrides, f"limits.duration_s={lasts}", law="auto").fly(lasts + 60)
    end = [truth for truth in flown.truths if truth.time > flown.now - judged]
    assert flown.outcome.ending is Ending.COMPLETED
    assert rms_error(end, flown.pilot.settings.orbit.radius) < most
    assert clockwise_turns(end) > 0.7 * judged / 45.0
    assert "drift" in {tick.law for tick in flown.ticks[-40:]}


def test_turning_wind_does_not_change_estimated_airspeed_scale() -> None:
    """The wind changes from 3 m/s from the north to 9 m/s from the east at once. Before that, the
    plane has learned its airspeed scale. Its accelerations show the new wind first. The law must
    not fly by them for long: they also show the side-slip."""
    flown = flight(
        "arduplane",
        "sim.wind.from_deg=0",
        "sim.wind.speed_mps=3.0",
        'sim.events=[{at_s=70,action="wind",value=9},{at_s=70,action="wind_from",value=90}]',
        *tangent(180.0),
        law="auto",
    ).fly(125.0)
    after = [tick for tick in flown.ticks if tick.time > 70.0 and tick.airspeed_scale is not None]
    for tick in after:
        assert tick.airspeed_scale == pytest.approx(AIRSPEED_SCALE, abs=0.015)
    end = [tick for tick in after if tick.time > 115.0]
    for tick in end:
        assert (tick.drift_x, tick.drift_y) == pytest.approx((-9.0, 0.0), abs=0.6)
    assert rms_error([truth for truth in flown.truths if truth.time > 95.0], 150.0) < 1.0


def test_circle_is_kept_when_mission_underestimates_range_noise() -> None:
    flown = flight("quickstart", "ranging.sigma_m=0.02", law="auto").fly(55.0)
    assert rms_error(last_third(flown), 100.0) < 0.5
    assert clockwise_turns(last_third(flown)) > 0.3
    assert b"expected 0.02 m" in b"".join(data for _, data in flown.sent)
    taken = flown.pilot.tracker.accepted
    assert taken > 0.9 * (taken + flown.pilot.tracker.ranging.rejected.total())


def test_auto_law_does_not_oscillate_on_slow_link() -> None:
    """The link delays frames by 0.05 to 0.15 s each way, as a busy companion computer or a fast
    telemetry radio does. The circle itself requires a turn of 10 deg/s. F4 of the fault matrix
    flies the plane."""
    flown = flight("arducopter", law="auto")
    flown.down, flown.up = (
        Pipe(Impairment(delay=0.05, jitter=0.1, in_order=True), seed) for seed in (1, 2)
    )
    flown.fly(60.0)
    assert unrest(flown) < 1.5
    assert rms_error(last_third(flown), 30.0) < 0.5
    assert clockwise_turns(last_third(flown)) > 0.4


def test_lap_is_planned_with_learned_bank_limit():
    """The plane banks at most 35 deg (ROLL_LIMIT_DEG), and the mission assumes 45 deg. Downwind in
    5 m/s of wind the circle requires more than 35 deg. Without a planned lap the radius RMS is 2.6
    m. The turn gain must be learned from the measured bank, because the commanded bank gives a too
    low gain."""
    flown = flight(
        "arduplane",
        "sim.vehicle.max_bank_deg=35.0",
        "sim.wind.from_deg=270",
        "sim.wind.speed_mps=5.0",
        *tangent(180.0),
        law="auto",
    ).fly(90.0)
    asked = max(
        abs(tick.turn_rate)
        for tick in flown.ticks
        if tick.time > 15.0 and tick.turn_rate is not None
    )
    assert asked > 0.34
    assert flown.ticks[-1].turn_gain == pytest.approx(EFFECTIVENESS / AIRSPEED_SCALE, abs=0.02)
    lap = [truth for truth in flown.truths if truth.time > 45.0]
    assert rms_error(lap, 150.0) < 1.6
    assert sum(b"vehicle banks 35 deg at most" in data for _, data in flown.sent) == 1
