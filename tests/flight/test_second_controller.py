"""Another program steers the same vehicle over a link of its own. circnav detects it by the
vehicle's reports and answers."""

import pytest

from circnav_mav.mav.frames import euler_from_quaternion, quaternion_from_euler
from circnav_mav.pilot.mission_state import Phase
from tests.flight.lockstep import SETPOINT_IDS, flight, tangent
from tests.frames import output, read
from tests.tools.fault_link.frames import frames, message_id, write

OTHER = (1, 193)
BEGINS = 10.0
"""Time at which the other program starts to send, s. At this time every vehicle is turning, because
it started on its circle."""


def begun(mission):
    """Return a flight on the circle, ready to start."""
    radius = flight(mission).pilot.settings.orbit.radius
    return flight(mission, *tangent(radius), "limits.duration_s=1000.0")


def turning_the_other_way(frame: bytes) -> bytes:
    """Return our setpoint with the opposite turn, as a program that circles in the other direction
    would send it."""
    message = read(frame)
    if message.get_msgId() == 84:
        message.yaw_rate = -message.yaw_rate
        message.afy = -message.afy
    elif message.get_msgId() == 82:
        roll, pitch, yaw = euler_from_quaternion(message.q)
        message.q = quaternion_from_euler(-roll, pitch, yaw)
    else:
        message.y = -message.y
    return write(message, *OTHER)


def flown_with_another(mission, until=BEGINS + 6.0):
    """Return (flight, {evidence: time at which it was first reported, s})."""
    flown = begun(mission)
    evidence = {}
    seen = [0]

    def other(flown):
        sent = [frame for _, data in flown.sent[seen[0] :] for frame in frames(data)]
        seen[0] = len(flown.sent)
        for frame in sent if flown.now >= BEGINS else ():
            if message_id(frame) in SETPOINT_IDS:
                flown.vehicle.receive(turning_the_other_way(frame))
        if words := flown.pilot.second_controller.evidence(flown.now):
            evidence.setdefault(words.partition(",")[0], flown.now)

    flown.fly(until, other)
    turns = [abs(tick.turn_rate) for tick in flown.ticks if BEGINS - 2.0 < tick.time < BEGINS]
    steady = abs(flown.pilot.settings.orbit.steady_turn_rate)
    assert sum(turns) / len(turns) > 0.5 * steady
    assert flown.pilot.mission.phase in (Phase.ENGAGED, Phase.COASTING)
    return flown, evidence


@pytest.mark.parametrize("mission", ["arducopter", "arduplane", "px4_copter"])
def test_setpoints_of_another_program_raise_an_alarm(mission):
    flown, evidence = flown_with_another(mission)
    assert evidence
    assert BEGINS < min(evidence.values()) < BEGINS + 5.0
    assert next(iter(evidence)).startswith("the vehicle flies ")
    texts = [
        read(frame) for _, data in flown.sent for frame in frames(data) if message_id(frame) == 253
    ]
    assert "circnav: another program also steers" in [text.text for text in texts]


@pytest.mark.parametrize("mission", ["ardurover", "px4_plane"])
def test_second_controller_is_undetected_without_setpoint_report(mission):
    """A vehicle that does not report its setpoint does not show a second controller: a limit
    documented in docs/safety.md."""
    assert flown_with_another(mission, until=BEGINS + 4.0)[1] == {}


@pytest.mark.parametrize("mission", ["arducopter", "px4_copter"])
def test_second_circnav_does_not_steer_while_first_steers(mission):
    """Two circnav programs have the same ids. A router forwards the frames of each program to the
    other program."""
    first = begun(mission)
    second = begun(mission)
    received: list[bytes] = []
    first.hears = lambda frame, now: received.append(frame) or True
    sent: list[bytes] = []

    def second_program(flown):
        forwarded = [data for _, data in flown.sent[seen[0] :]]
        seen[0] = len(flown.sent)
        now = flown.now - BEGINS
        if now > 0.0 and not second.pilot.done:
            for data in received + forwarded:
                second.pilot.receive(data, now, "sim")
            data = output(second.pilot, now)
            flown.vehicle.receive(data)
            flown.others = [(data, "sim")] if data else []
            sent.append(data)
        else:
            flown.others = []
        received.clear()

    seen = [0]
    first.fly(BEGINS + 15.0, second_program)
    assert second.pilot.done
    assert "another companion sends with our ids" in second.outcome.reason
    assert not any(message_id(frame) in SETPOINT_IDS for data in sent for frame in frames(data))
    assert first.pilot.mission.outcome is None
    assert first.pilot.mission.phase is Phase.ENGAGED
