"""The controller: detection that a copter flies at the commanded speed, the integral of the radius
error, changes of the circle, and the setpoint guard."""

import pytest

from circnav_mav.guidance.circle_change import CircleLimits, CircleRequest
from circnav_mav.guidance.types import OwnMotion, RangeEstimate, TurnCommand, TurnRate
from circnav_mav.mav.autopilots.interface import VehicleFacts
from circnav_mav.mav.autopilots.table import AUTOPILOTS, adapters
from circnav_mav.mav.identity import LinkSettings, Sender
from circnav_mav.mav.session import Session
from circnav_mav.mav.setpoint_guard import UnsafeSetpointError
from circnav_mav.mission.load import parse_mission
from circnav_mav.pilot.controller import Controller
from circnav_mav.pilot.mission_state import Phase
from tests.rig import rig_mission
from tests.small_mission import TEXT

COMMANDED = TurnRate(-0.2)
STEP = 0.05
SPEED_UP = 2.5
UNRESPONSIVE_BELOW = 1.0
GAP = 1.0
"""Times, s. SPEED_UP: turning as commanded until the vehicle is at speed. UNRESPONSIVE_BELOW:
without a commanded turn until it is unresponsive. GAP: between two reports, after which the vehicle
may have stopped."""


KEPT = CircleLimits(speed=15.0, keeps_speed=True)
CHANGES = CircleLimits(speed=15.0)
COPTER = ("ardupilot", "copter")
PLANE = ("ardupilot", "plane")
STICK = ("px4", "plane")
BANK = 0.4
"""Largest bank of the mission, rad. At 15 m/s a plane with this bank turns at 0.276 rad/s."""


class Vehicle:
    """A controller that has commanded a vehicle to turn, and the heading that the vehicle
    reports."""

    def __init__(self, *overrides):
        settings = parse_mission(TEXT, "small.toml", overrides)
        session = Session(LinkSettings(), adapters(*settings.vehicle_key, settings.facts))
        session.identity.peer = Sender(1, 1, "here")
        self.controller = Controller(settings)
        self.now = 0.0
        self.heading = 0.0
        command = TurnCommand(COMMANDED, COMMANDED, saturated=False)
        _, sent = self.controller.setpoint(command, session, 0.0)
        self.controller.commanded(sent, 0.0)

    def turns(self, seconds, rate):
        """Report the heading while it turns at a rate (rad/s). Return, for each report, True if the
        vehicle was at speed."""
        seen = []
        for _ in range(round(seconds / STEP)):
            self.now = self.now + STEP
            self.heading = self.heading + rate * STEP
            own = OwnMotion(self.now, self.heading, rate, 15.0)
            self.controller.vehicle.on_motion(own, own)
            seen.append(self.controller.vehicle.at_speed)
        return seen

    def demanded(self, time, r):
        """Return the turn rate (rad/s) that the law demands on a path around the target at a range
        (m)."""
        return self.controller.command(
            Phase.ENGAGED, RangeEstimate(time, r, 0.0, 0.1, 0.1), None, time
        ).demanded


@pytest.mark.parametrize(
    ("before", "silence", "earliest", "latest"),
    [
        ([], 0.0, SPEED_UP - STEP, SPEED_UP + 2 * STEP),
        # after a turn that the vehicle did not follow
        ([(10.0, COMMANDED), (UNRESPONSIVE_BELOW + 3.0, 0.0)], 0.0, SPEED_UP, 9.0),
        ([(10.0, COMMANDED)], GAP + 0.1, SPEED_UP - 2 * STEP, SPEED_UP + 2 * STEP),
    ],
    ids=[
        "initially",
        "after unfollowed turns",
        "after a gap in reports",
    ],
)
def test_copter_counts_as_at_speed_after_followed_turns(before, silence, earliest, latest):
    vehicle = Vehicle()
    assert all(vehicle.turns(seconds, rate)[-1] is (rate != 0.0) for seconds, rate in before)
    vehicle.now += silence
    seen = vehicle.turns(10.0, COMMANDED)
    assert not seen[0]
    assert earliest <= seen.index(True) * STEP <= latest
    assert all(seen[seen.index(True) :])


def test_copter_regains_at_speed_state_after_short_unfollowed_turn():
    """A copter that does not turn for 1.8 s loses the state "at speed" for less than
    UNRESPONSIVE_BELOW, because it does not stop in this time. 1.3 s without turn have no effect."""
    vehicle = Vehicle()
    vehicle.turns(30.0, COMMANDED)
    assert all([*vehicle.turns(1.3, 0.0), *vehicle.turns(10.0, COMMANDED)])
    seen = [*vehicle.turns(1.8, 0.0), *vehicle.turns(3.0, COMMANDED)]
    assert 0.1 < seen.count(False) * STEP < UNRESPONSIVE_BELOW
    assert seen[-1]


def test_fleet_offset_does_not_change_circle_of_operator():
    controller = Vehicle().controller
    base = controller.circle
    assert controller.change_circle(CircleRequest(offset=5.0, pace=1.0, by="fleet"), 1.0) == ""
    assert (controller.circle, controller.orbit.radius) == (base, base.radius + 5.0)
    # The operator may change the circle while the fleet's offset is active, and the offset is kept.
    assert (
        controller.change_circle(CircleRequest(radius=base.radius + 30.0, by="operator"), 1.01)
        == ""
    )
    assert (controller.circle.radius, controller.orbit.radius) == (
        base.radius + 30.0,
        base.radius + 35.0,
    )
    assert controller.change_circle(CircleRequest(offset=0.0, by="fleet"), 1.2) == ""
    assert controller.orbit.radius == controller.circle.radius
    assert "spacing offset" in controller.change_circle(
        CircleRequest(offset=0.31 * controller.circle.radius), 2.0
    )


@pytest.mark.parametrize(("key", "sent"), [(PLANE, [16.5]), (COPTER, []), (STICK, [])])
def test_airspeed_is_commanded_if_setpoints_contain_no_speed(key, sent, monkeypatch):
    mission = rig_mission()
    monkeypatch.setitem(mission.__dict__, "facts", VehicleFacts(15.0, max_bank=BANK, drag=0.25))
    controller = Controller(mission)
    session = Session(
        LinkSettings(), (AUTOPILOTS[key](VehicleFacts(15.0, max_bank=BANK, drag=0.25)),)
    )
    session.identity.peer = Sender(1, 1, "here")
    command = TurnCommand(TurnRate(0.1), TurnRate(0.1), saturated=False)
    for now, pace in enumerate((1.0, 0.95, 1.1), 1):
        assert controller.change_circle(CircleRequest(pace=pace, by="fleet"), float(now)) == ""
        controller.setpoint(command, session, float(now))
    messages = session.commands.poll((1, 1), 4.0)
    assert [message.param2 for message in messages] == pytest.approx(sent)
    controller.disengage()
    controller.setpoint(command, session, 5.0)
    # the mode change has restored the airspeed, so no command is sent
    assert len(session.commands.poll((1, 1), 6.0)) == len(sent)


# --- limits of the mission in the setpoint guard, which blocks faults of law, loop and adapter


def setpoint_passes(key, limits, monkeypatch, *, rate=0.0, speed=15.0, adapters_bank=BANK):
    """Return True if the setpoint guard passes a setpoint with this turn rate (rad/s) and speed
    (m/s), from an adapter with this largest bank (rad)."""
    mission = rig_mission()
    monkeypatch.setitem(mission.__dict__, "facts", VehicleFacts(15.0, max_bank=BANK, drag=0.25))
    monkeypatch.setitem(mission.__dict__, "circle_limits", limits)
    controller = Controller(mission)
    monkeypatch.setattr(Controller, "speed", lambda controller, session: speed)
    session = Session(
        LinkSettings(), (AUTOPILOTS[key](VehicleFacts(15.0, max_bank=adapters_bank, drag=0.25)),)
    )
    session.identity.peer = Sender(1, 1, "here")
    command = TurnCommand(TurnRate(rate), TurnRate(rate), saturated=False)
    try:
        return controller.setpoint(command, session, 0.0) is not None
    except UnsafeSetpointError:
        return False


@pytest.mark.parametrize(
    ("key", "limits", "inside", "outside"),
    [
        (COPTER, KEPT, {"rate": 0.35}, {"rate": 0.3501}),
        (COPTER, KEPT, {"rate": -0.35}, {"rate": -0.3501}),
        (COPTER, KEPT, {"speed": 15.0}, {"speed": 15.01}),
        # in flight, at most 1.2 times the speed of the mission may be requested
        (COPTER, CHANGES, {"speed": 18.0}, {"speed": 18.01}),
        (COPTER, CHANGES, {"speed": 0.0}, {"speed": -0.01}),
        (PLANE, KEPT, {"rate": 0.35}, {"rate": 0.35, "adapters_bank": 0.42}),
        (PLANE, KEPT, {"rate": -0.35}, {"rate": -0.35, "adapters_bank": 0.42}),
        (STICK, KEPT, {"rate": 0.35}, {"rate": 0.35, "adapters_bank": 0.42}),
        (STICK, KEPT, {"rate": -0.35}, {"rate": -0.35, "adapters_bank": 0.42}),
    ],
)
def test_setpoint_guard_blocks_excess_turn_speed_and_bank(
    key, limits, inside, outside, monkeypatch
):
    assert setpoint_passes(key, limits, monkeypatch, **inside)
    assert not setpoint_passes(key, limits, monkeypatch, **outside)
