"""F9, F14 to F20, F22: floods, errors of circnav's clock, stalls, reboots, takeovers, other senders
on the link, commands."""

import struct
from collections.abc import Callable, Iterable
from copy import deepcopy
from random import Random
from typing import Any

from circnav_sim.config import Event
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.pilot.mission_state import Phase
from tests.flight.ground_station import Operator
from tests.frames import sender
from tests.tools.fault_link import DOWN, UP, Impairment
from tests.tools.fault_link.frames import message_id, raw_frame
from tests.tools.fault_link.intruders import (
    GCS,
    ground_station,
    periodic,
    repeating,
    twin,
    unknown_senders,
    vehicle,
)
from tests.tools.fault_link.link import Intruder, Passage, Tamper
from tests.tools.faults.cell import FRESH, Arrange, Scenario, Want, intruded, tampered
from tests.tools.faults.course import Course
from tests.tools.faults.scenarios.line import PX4
from tests.tools.faults.scenarios.ranging import SLOW
from tests.tools.faults.tampering import acknowledgement, answered, dropping, late, repeated_later

SET_MODE = 176
ACK = 77
ARDUPILOT = ("arducopter", "arduplane", "ardurover")
THEIR_MODE = {"arducopter": (5,), "arduplane": (7,), "ardurover": (4,)}
OURS = (1, 191)


def tamper(one: Tamper) -> Arrange:
    return tampered(lambda seed: one)


def our_clock(shift: Callable[[float, float], float]) -> Arrange:
    """Change circnav's clock from now on."""

    def arrange(course: Course, seed: int) -> None:
        since = course.now
        course.clock = lambda now: shift(now, since)

    return arrange


def clock(level: str, shift: Callable[[float, float], float], **more: Any) -> Scenario:
    return Scenario("F14", f"our clock {level}", arrange=our_clock(shift), clocks=True, **more)


HOST = [
    Scenario(
        "F9",
        "400 strange frames/s",
        arrange=intruded(lambda seed: unknown_senders(200.0, seed)),
        quick=True,
        lasts=40,
    ),
    clock("+1 s", lambda now, since: now + 1.0, on=SLOW),
    clock("+10 s", lambda now, since: now + 10.0),
    clock("500 ppm fast", lambda now, since: now + 5e-4 * (now - since)),
    *(
        Scenario(
            "F20",
            f"stopped {s} s",
            arrange=lambda course, seed, s=s: course.stall(s),
            lasts=s + 1,
            after=50,
            want=Want.REGAIN,
            quick=s == 5,
        )
        for s in (1, 3, 5)
    ),
]


def reboot(gap: float) -> Scenario:
    def arrange(course: Course, seed: int) -> None:
        course.vehicle._run_event(Event(action="reboot", value=gap))

    def check(course: Course) -> str | None:
        start = course.steered_at[0] if course.steered_at else 0.0
        last = course.steered_at[-1] - start if course.steered_at else 0.0
        return f"still steering {last:.1f} s after the reboot" if last > gap + 4.0 else None

    return Scenario(
        "F15",
        f"gap {gap:g} s",
        arrange=arrange,
        want=Want.END,
        check=check,
        lasts=30,
        quick=gap == 2,
    )


def takeovers(times: int, quick: bool = False) -> Scenario:
    """The operator changes the mode at random times, each in a separate copy of the flight."""

    def arrange(course: Course, seed: int) -> None:
        chance = Random(seed)
        for _ in range(times):
            flown = deepcopy(course)
            flown.fly(flown.now + chance.uniform(0, 0.7))
            take_over(flown)
            flown.fly(flown.now + 2.5)
            course.broken += flown.broken
            if flown.pilot.mission.phase is not Phase.ENDED:
                course.broken.append(f"takeover not seen: {flown.pilot.mission.phase.value}")
        take_over(course)

    return Scenario(
        "F16",
        f"{times} random moments",
        arrange=arrange,
        want=Want.END,
        reason="pilot or failsafe",
        lasts=5,
        quick=quick,
    )


def take_over(course: Course) -> None:
    Operator(course.vehicle).set_mode(*THEIR_MODE.get(course.profile, (4, 3)))


def flapping(course: Course, seed: int) -> None:
    """The operator changes the mode every 2.5 s and returns the vehicle each time."""
    for _ in range(20):
        take_over(course)
        course.fly(course.now + 2.5)
        Operator(course.vehicle).set_mode(course.pilot.session.adapter.guided_mode)
        course.fly(course.now + 2.5)
        if course.pilot.mission.phase is Phase.YIELDED:
            course.broken.append(f"not given back after {course.now:.1f} s")
    take_over(course)


def disarm(course: Course, seed: int) -> None:
    Operator(course.vehicle).disarm()


OPERATOR = [
    *(reboot(gap) for gap in (2, 5, 10)),
    takeovers(10, quick=True),
    takeovers(1000),
    Scenario(
        "F16",
        "every 2.5 s, on_takeover = wait",
        arrange=flapping,
        want=Want.SAFE,
        lasts=105,
        profiles=ARDUPILOT,
        overrides=('engage.on_takeover="wait"',),
    ),
    Scenario(
        "F16",
        "disarmed",
        arrange=disarm,
        want=Want.END,
        reason="disarmed",
        lasts=5,
        on=dict.fromkeys(PX4, Want.SAFE),
    ),
]


def new_port(course: Course, seed: int) -> None:
    """The vehicle's bridge restarts: 2 s without frames, then another source address."""
    course.link.impair(up=Impairment(loss=1.0), down=Impairment(loss=1.0))
    course.fly(course.now + 2.0)
    course.source = "sim, another port"
    course.link.impair()


def flaps(course: Course, seed: int) -> None:
    """The link has 100 cycles of 0.5 s with and 0.5 s without transmission."""
    cuts = tuple((course.now + n, course.now + n + 0.5) for n in range(100))
    course.link.impair(up=Impairment(outages=cuts), down=Impairment(outages=cuts))


LINKS = [
    Scenario(
        "F17", "new source port after 2 s", arrange=new_port, want=Want.REGAIN, lasts=10, quick=True
    ),
    Scenario("F17", "100 flaps of 0.5 s", arrange=flaps, want=Want.REGAIN, lasts=100),
]


def echoing(way: str, data: bytes, now: float) -> Iterable[Passage]:
    """circnav receives every frame that it sends."""
    return [(UP, data), (DOWN, data)] if way == UP else [(DOWN, data)]


def forged_acks(seed: int) -> Intruder:
    """Acknowledgements of circnav's commands: one from a ground station, and one addressed to
    another component."""

    acks = [acknowledgement(SET_MODE, 2, OURS, by=GCS), acknowledgement(511, 2, (1, 77))]
    return periodic(20.0, lambda n: acks)


def joined(
    level: str, make: Callable[[int], Intruder], want: Want = Want.HOLD, **more: Any
) -> Scenario:
    """Return a scenario with another sender on the link."""
    return Scenario("F18", level, arrange=intruded(make), want=want, **more)


def left_at_the_vehicles_ids(seed: int) -> Intruder:
    """A gimbal with the ids 1/1 behind the vehicle's router sends heartbeats: no autopilot, mode 0,
    not armed."""
    heartbeat = mavlink.MAVLink_heartbeat_message(26, 8, 0, 0, 4, 3)
    return repeating((1, 1), 1.0, lambda n: [heartbeat])


TWIN: dict[str, Any] = {"want": Want.END, "reason": "another companion", "lasts": 20}
IDENTITY = [
    joined("GCS flood 200/s", lambda seed: ground_station(200.0), lasts=40),
    joined("second vehicle, system 2", lambda seed: vehicle(2), quick=True),
    joined("component with the vehicle's ids", left_at_the_vehicles_ids, quick=True),
    joined(
        "second vehicle, our system",
        lambda seed: vehicle(1, mode=5),
        Want.END,
        profiles=ARDUPILOT[:2],
    ),
    joined("twin of ours", lambda seed: twin(*OURS, rate=10.0), **TWIN, quick=True),
    joined("twin of ours, heartbeats only", lambda seed: twin(*OURS), **TWIN),
    Scenario("F18", "own echo", arrange=tamper(echoing)),
    joined("forged acknowledgements from the start", forged_acks, Want.ENGAGE, **FRESH),
]


def no_answer_not_following(way: str, data: bytes, now: float) -> Iterable[Passage]:
    """The vehicle neither answers nor obeys commands."""
    return () if way == UP and message_id(data) == 76 else [(way, data)]


def commands(
    level: str, arrange: Arrange, want: Want, reason: str = "", quick: bool = False
) -> Scenario:
    return Scenario("F19", level, arrange=arrange, want=want, reason=reason, quick=quick, **FRESH)


def foreign_acks(seed: int) -> Intruder:
    return periodic(5.0, lambda n: [acknowledgement(SET_MODE, 4, (1, 77))])


COMMANDS = [
    commands("no acknowledgement", tamper(dropping(ACK)), Want.ENGAGE),
    commands("acknowledged 2 s late", tamper(late(ACK, 2.0)), Want.ENGAGE),
    commands("foreign acknowledgements", intruded(foreign_acks), Want.ENGAGE),
    commands("in progress for ever", tamper(answered(SET_MODE, 5)), Want.REFUSE, "mode"),
    commands("denied", tamper(answered(SET_MODE, 2)), Want.REFUSE, "denied", quick=True),
    commands("unsupported", tamper(answered(SET_MODE, 3)), Want.REFUSE, "unsupported"),
    commands(
        "temporarily rejected", tamper(answered(SET_MODE, 1)), Want.REFUSE, "temporarily rejected"
    ),
    commands("accepted, not obeyed", tamper(answered(SET_MODE, 0)), Want.REFUSE, "stays in"),
    commands("ignores commands", tamper(no_answer_not_following), Want.REFUSE, "no answer"),
]


def longer(way: str, data: bytes, now: float) -> Iterable[Passage]:
    """Append unknown extension fields to the frames."""
    if way == UP or message_id(data) < 0 or data[1] > 240:
        return [(way, data)]
    payload = data[10 : 10 + data[1]] + struct.pack("<HBf", 7, 9, 1.5)
    return [(way, raw_frame(message_id(data), _padded(data, payload), *sender(data), data[4]))]


def _padded(frame: bytes, payload: bytes) -> bytes:
    """Restore truncated zeros before fields are appended."""
    size = mavlink.mavlink_map[message_id(frame)].unpacker.size
    known = frame[10 : 10 + frame[1]]
    return (known + bytes(max(0, size - len(known))) + payload[len(known) :])[:255]


def is_range_for_us(way: str, data: bytes) -> bool:
    return way == DOWN and message_id(data) == 132


VERSION_1 = ("sim.vehicle.mavlink_version=1",)
OTHERS = [
    Scenario(
        "F22",
        "MAVLink 1 only",
        want=Want.REFUSE,
        reason="MAVLink 1 only",
        overrides=VERSION_1,
        **FRESH,
    ),
    Scenario("F22", "extension fields of the future", arrange=tamper(longer)),
    Scenario(
        "F22",
        "ranges replayed after 5 s",
        arrange=tamper(repeated_later(5.0, is_range_for_us)),
        quick=True,
    ),
]
PEERS = [*HOST, *OPERATOR, *LINKS, *IDENTITY, *COMMANDS, *OTHERS]
