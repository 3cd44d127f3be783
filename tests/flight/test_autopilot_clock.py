"""A vehicle that runs faster than real time, flown by its own clock, and the alarm if its clock is
not used."""

import pytest

from circnav_mav.runtime import clock as clock_module
from circnav_mav.runtime.clock import AutopilotClock
from circnav_mav.runtime.listeners import Listeners
from circnav_mav.runtime.status import StatusSource
from tests.flight.lockstep import flight, message_ids
from tests.frames import output
from tests.tools.fault_link.frames import message_id

SPEED = 3
# message ids of DISTANCE_SENSOR and SET_POSITION_TARGET_LOCAL_NED
RANGE = 132
SETPOINT = 84


def test_fast_simulator_is_flown_by_autopilot_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """The test advances the computer's clock by 5 ms per step. tests/cli/test_commands.py does the
    same over sockets."""
    real = [0.0]
    monkeypatch.setattr(clock_module, "steady", lambda: real[0])
    flown = flight("arducopter", "limits.duration_s=12")
    pilot = flown.pilot
    vehicle = flown.vehicle
    clock = AutopilotClock(lambda: pilot.session.vehicle.boot.newest)
    ranges = list[float]()
    setpoints = list[float]()
    while not pilot.done and real[0] < 20.0:
        real[0] += 0.005
        vehicle.advance(SPEED * real[0])
        for frame in vehicle.outgoing("main"):
            pilot.receive(frame, now := clock.now(), "sim")
            ranges += [now] * (message_id(frame) == RANGE)
        out = output(pilot, now := clock.now())
        vehicle.receive(out)
        setpoints += [now] * (SETPOINT in message_ids(out))
    began = pilot.mission.engaged_at
    assert began is not None
    assert pilot.mission.outcome is not None and pilot.mission.outcome.reason == "flown to its end"
    assert real[0] == pytest.approx((began + 12.0) / SPEED, abs=1.0)
    on_the_circle = [
        [time for time in times if began + 1.0 <= time < began + 11.0]
        for times in (ranges, setpoints)
    ]
    # the radio sends at 10 Hz in the time of the simulator
    assert len(on_the_circle[0]) == pytest.approx(100, abs=2)
    assert len(on_the_circle[1]) == pytest.approx(200, rel=0.2)  # each range triggers one more tick


@pytest.mark.parametrize(("speed", "noticed"), [(1.0, None), (1.05, None), (0.5, 0.5), (8.0, 8.0)])
def test_unexpected_vehicle_clock_speed_raises_an_alarm(
    speed: float, noticed: float | None
) -> None:
    flown = flight("arducopter")
    pilot = flown.pilot
    vehicle = flown.vehicle
    ticks = []
    for step in range(1, 1501):
        now = 0.01 * step
        vehicle.advance(now * speed)
        for frame in vehicle.outgoing("main"):
            pilot.receive(frame, now, "sim")
        vehicle.receive(output(pilot, now))
        ticks += pilot.take_records()
    assert pilot.session.vehicle.clock_speed.noticed == (
        noticed if noticed is None else pytest.approx(noticed, rel=0.02)
    )
    alarms = [
        one
        for one in StatusSource(pilot, Listeners()).status(ticks[-1], 15.0).alarms
        if one.startswith("CLOCK")
    ]
    words = (
        f"CLOCK: autopilot time runs {speed:g} times as fast as ours: for a simulator set"
        " link.clock"
    )
    assert [alarm.startswith(words) for alarm in alarms] == ([] if noticed is None else [True])
