"""A vehicle that stays in its mode but does not fly the commanded turns: reported within 5 s. After
`limits.not_following_s` the exit action follows."""

import copy

import pytest
from circnav_sim.config import Event

from circnav_mav.pilot import Ending
from tests.flight.lockstep import Flight, flight, tangent

ALARM = b"vehicle does not follow turn commands"
AWAY = "sim.start.heading_deg=320"
FAR = "bounds.max_range_m=5000.0"


def alarmed_at(flown: Flight) -> float:
    """Return the time of the STATUSTEXT, s."""
    return next((time for time, data in flown.sent if ALARM in data), float("inf"))


def engaged_at(flown: Flight) -> float:
    engaged = flown.pilot.mission.engaged_at
    assert engaged is not None
    return engaged


NEVER = [
    ("arducopter", "straight"), ("arducopter_nogps", "straight"), ("ardurover", "reversed"),
    ("arduplane", "reversed"), ("arduplane", "weak"), ("px4_plane", "weak"),
    ("arducopter", "hovering"), ("px4_copter", "hovering"),
]  # fmt: skip
"""Pairs of mission and steering fault. Every vehicle has a fault, and every fault occurs on two
vehicles."""


@pytest.mark.parametrize(("mission", "steering"), NEVER)
def test_guidance_ends_when_vehicle_never_follows_turn_commands(
    mission: str, steering: str
) -> None:
    """The vehicle starts on a heading away from the target, so that the law commands a turn."""
    fault = f'sim.vehicle.steering="{steering}"'
    flown = flight(mission, fault, FAR, AWAY, "limits.not_following_s=4.0", law="auto").fly(60)
    assert alarmed_at(flown) - engaged_at(flown) < 5.0
    assert flown.outcome.ending is Ending.ABORTED
    assert flown.outcome.reason == (
        "vehicle did not follow turn commands, and did not turn along its circle for 4 s: check"
        " steering and compass"
    )
    assert flown.now - engaged_at(flown) < 12.0
    exits = flown.pilot.session.adapter.exits
    wanted = flown.pilot.settings.file.exit.action or "loiter"
    assert flown.vehicle.truth.mode == exits[wanted]


@pytest.mark.parametrize(
    ("mission", "faults"),
    [
        ("arducopter", ["straight", "frozen", "reversed", "weak", "turning"]),
        ("arduplane", ["straight", "weak"]),
    ],
)
def test_vehicle_that_stops_following_raises_alarm(mission: str, faults: list[str]) -> None:
    """A vehicle that continues with the turn rate of the circle stays on it for some seconds, so
    the alarm comes later. A plane with this fault looks like a plane at its bank limit, so
    "turning" is tested only on the copter."""
    radius = flight(mission).pilot.settings.orbit.radius
    circling = flight(mission, FAR, *tangent(1.2 * radius), law="auto").fly(25)
    for steering in faults:
        flown = copy.deepcopy(circling)
        flown.vehicle._run_event(Event(action=f"steering_{steering}"))
        flown.fly(60)
        most = {"frozen": 25.0, "turning": 12.0}.get(steering, 5.0)
        assert 25.0 < alarmed_at(flown) < 25.0 + most, steering
        stays = abs(flown.ticks[-1].r - radius) < 0.1 * radius
        assert stays or "did not follow" in flown.outcome.reason, steering


def test_flight_continues_when_vehicle_follows_again() -> None:
    events = (
        'sim.events=[{at_s=25.0, action="steering_straight"}, {at_s=33.0, action="steering_good"}]'
    )
    flown = flight("arducopter", events, FAR, "limits.duration_s=58.0", law="auto").fly(100)
    assert alarmed_at(flown) < 30.0
    assert any(b"vehicle follows turn commands again" in data for _, data in flown.sent)
    assert flown.outcome.ending is Ending.COMPLETED
    assert abs(flown.ticks[-1].r - 30.0) < 3.0


def test_uplink_outage_is_not_reported_as_unfollowed_commands() -> None:
    """The copter stops at its setpoint timeout and then follows no command. Unanswered TIMESYNC
    requests show the outage."""
    flown = flight("arducopter", FAR, "limits.duration_s=48.0", law="auto").fly(15)
    receive = flown.vehicle.receive
    flown.vehicle.receive = lambda *args, **kwargs: None  # type: ignore[method-assign]
    flown.fly(35)
    flown.vehicle.receive = receive  # type: ignore[method-assign]
    flown.fly(120)
    assert flown.outcome.ending is Ending.COMPLETED


def test_rover_with_weak_steering_continues_on_circle() -> None:
    """The rover turns at 40 % of the command, too little for a verdict, and keeps its circle."""
    weak = 'sim.events=[{at_s=2.0,action="steering_weak",value=0.4}]'
    flown = flight("ardurover", weak, "limits.duration_s=60.0", law="auto").fly(90)
    assert flown.outcome.ending is Ending.COMPLETED
    assert abs(flown.ticks[-1].r - 20.0) < 2.0
