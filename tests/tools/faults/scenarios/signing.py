"""F22: signed links, and senders without a key, with another key, or with recorded frames."""

from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.mav.signing import EPOCH, LATEST, SECOND, Refusal
from tests.flight.lockstep import UNIX
from tests.flight.signed import KEY, OTHER, voice
from tests.tools.fault_link import DOWN, UP, Impairment
from tests.tools.fault_link.intruders import periodic, vehicle
from tests.tools.fault_link.link import Intruder
from tests.tools.faults.cell import FRESH, Arrange, Scenario, Want, intruded, tampered
from tests.tools.faults.course import Course
from tests.tools.faults.tampering import repeated_later

BOTH = (KEY, KEY)
HOUR = 3600.0
NOT_BELIEVED = "every frame received is unsigned or wrongly signed"
HEARTBEAT = mavlink.MAVLink_heartbeat_message(2, 3, 0x81, 5, 4, 3)
"""Heartbeat of our vehicle, in a mode that would end the mission."""
TO_LOITER = mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1, 5, 0, 0, 0, 0, 0)

Check = Callable[[Course], str | None]


def stamp(unix: float) -> int:
    return round((unix - EPOCH) * SECOND)


def sending(
    engine: mavlink.MAVLink, message: mavlink.MAVLink_message, way: str, rate: float = 20.0
) -> Intruder:
    return periodic(rate, lambda n: [bytes(message.pack(engine))], direction=way)


def both_ways(key: bytes | None, timestamp: int = 0, **link: int) -> Arrange:
    """Return an arrangement with a sender that imitates the vehicle to circnav, and a ground
    station to the vehicle."""

    def arrange(course: Course, seed: int) -> None:
        course.link.intruders += [
            sending(voice(key, timestamp, **link), HEARTBEAT, DOWN),
            sending(voice(key, timestamp, 255, 190, **link), TO_LOITER, UP),
        ]

    return arrange


def clock(*, ours: float = 0.0, theirs: float | None = 0.0) -> Arrange:
    """Return an arrangement with errors of the wall clocks of circnav and of the vehicle, s. None:
    the vehicle has no clock."""

    def arrange(course: Course, seed: int) -> None:
        course.wall += ours
        before = course.vehicle_wall
        course.vehicle_wall = None if theirs is None else before + theirs  # type: ignore[operator]

    return arrange


def refused(*reasons: Refusal, by_vehicle: bool = True) -> Check:
    """Return a check: circnav must have rejected frames for exactly these reasons, and the vehicle
    must have rejected frames or not."""

    def check(course: Course) -> str | None:
        found = course.pilot.frames_refused()
        if set(found) != {reason.value for reason in reasons}:
            return f"refused: {dict(found)}"
        as_said = (course.vehicle.refused > 0) is by_vehicle
        return None if as_said else f"refused by the vehicle: {course.vehicle.refused}"

    return check


def signed(
    level: str, arrange: Arrange | None = None, check: Check | None = None, **more: Any
) -> Scenario:
    return Scenario(
        "F22",
        level,
        arrange=arrange,
        check=check,
        **{"keys": BOTH, "lasts": 30.0, "after": 20.0, **more},
    )


def fresh(level: str, want: Want, arrange: Arrange | None = None, **more: Any) -> Scenario:
    return signed(level, arrange, want=want, **FRESH, **more)


def unsigned_flown(course: Course) -> str | None:
    """Return a fault if a vehicle with a key flew unsigned setpoints."""
    return (
        f"{len(course.vehicle.setpoint_log)} unsigned setpoints flown"
        if course.vehicle.setpoint_log
        else None
    )


WRONG = Refusal.WRONG
UNSIGNED = Refusal.UNSIGNED
REPEATED = Refusal.REPEATED
BEHIND = Refusal.BEHIND
SIGNING = [
    signed("signed, no fault", check=refused(by_vehicle=False)),
    fresh("vehicle without a key", Want.REFUSE, keys=(KEY, None), reason=NOT_BELIEVED),
    fresh(
        "vehicle with another key", Want.REFUSE, keys=(KEY, OTHER), reason=NOT_BELIEVED, quick=True
    ),
    fresh("vehicle signs, we have no key", Want.SAFE, keys=(None, KEY), check=unsigned_flown),
    signed("unsigned frames in both names", both_ways(None), refused(UNSIGNED)),
    signed("forged frames, stamps of now", both_ways(OTHER, stamp(UNIX + 200)), refused(WRONG)),
    signed(
        "forged frames, stamps of the future", both_ways(OTHER, LATEST), refused(WRONG), quick=True
    ),
    fresh(
        "forged frames of the future from the start",
        Want.ENGAGE,
        both_ways(OTHER, LATEST),
        check=refused(WRONG),
    ),
    signed(
        "true frames of an hour ago", both_ways(KEY, stamp(UNIX - HOUR), link_id=7), refused(BEHIND)
    ),
    signed(
        "all replayed after 5 s",
        tampered(lambda seed: repeated_later(5.0)),
        refused(REPEATED),
        quick=True,
    ),
    signed(
        "second vehicle, our system",
        intruded(lambda seed: vehicle(1)),
        refused(UNSIGNED, by_vehicle=False),
    ),
    fresh("vehicle without a clock", Want.ENGAGE, clock(theirs=None)),
    fresh("vehicle's clock -2 h", Want.ENGAGE, clock(theirs=-2 * HOUR), quick=True),
    fresh("vehicle's clock +2 h", Want.ENGAGE, clock(theirs=2 * HOUR)),
    signed("our clock set 2 h back", clock(ours=-2 * HOUR), refused(by_vehicle=False)),
    signed("our clock set 2 h forth", clock(ours=2 * HOUR), refused(by_vehicle=False)),
    *(
        signed(f"signed, {name}", up=line, down=line)
        for name, line in (
            ("20 % lost", Impairment(loss=0.2)),
            ("50 % twice", Impairment(duplicate=0.5)),
            ("0.001 corrupt per byte", Impairment(corrupt=1e-3)),
            # a signed frame that arrives after a later one is rejected as repeated, so many frames
            # are lost
            ("200 ms jitter", Impairment(jitter=0.2)),
        )
    ),
]
