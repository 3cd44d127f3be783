"""F23: attacks over the link.

An unknown sender receives all traffic of the link and sends from a different address. In a row with
`address forged` the attacker also forges the trusted address, which only signing prevents. Each row
checks the setpoints and the alarms shown to the operator. docs/safety.md has the trust model.
"""

from collections.abc import Callable
from functools import partial
from math import hypot
from typing import Any

from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.mission.load import load_mission
from circnav_mav.pilot import Pilot
from tests.flight.lockstep import CONFIG, true_radius
from tests.frames import output, sender
from tests.tools.fault_link import DOWN, UP, Impairment
from tests.tools.fault_link.frames import frames, write
from tests.tools.fault_link.intruders import periodic, repeating
from tests.tools.fault_link.link import Passage
from tests.tools.faults.cell import FRESH, LAW, Arrange, Scenario, Want
from tests.tools.faults.course import PATIENT, SOURCE, Course
from tests.tools.faults.scenarios.signing import BOTH
from tests.tools.faults.tampering import acknowledgement, on

VEHICLE = (1, 1)
RADIO = (1, 192)
OURS = (1, 191)
OTHER_MODE = {"arducopter": 5, "arduplane": 12}
KIND = {"arducopter": 2, "arduplane": 1}
ESCAPE = b"\x1b]0;PreArm: \x1b[2J\x07\x9b31m"
"""Text with escape sequences that set the title of a terminal and clear its screen."""
LONG = 65_000
PATIENCE = 45.0
"""Duration of an attack that begins before the flight, s. Without the attack the flight would begin
much earlier."""
DRAWN = 0.03
MOST_DRAWN = 0.6
"""Forged ranges: rate at which their error grows (DRAWN, radii per second), and largest error
(MOST_DRAWN, radii)."""

Say = Callable[[Course, int], list[bytes]]
"""Callback(flight, number of earlier calls): returns the attacker's datagrams."""


def packed(
    n: int, *messages: mavlink.MAVLink_message, ids: tuple[int, int] = VEHICLE
) -> list[bytes]:
    return [write(message, *ids, n & 255) for message in messages]


def heartbeat_in(course: Course, mode: int) -> mavlink.MAVLink_message:
    """Return the vehicle's heartbeat in a mode."""
    return mavlink.MAVLink_heartbeat_message(KIND[course.profile], 3, 0x81, mode, 4, 3)


def guided_heartbeat(course: Course) -> mavlink.MAVLink_message:
    return heartbeat_in(course, course.pilot.session.adapter.guided_mode)


def boot_time(course: Course, ahead: float) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_system_time_message(0, round(1000 * (course.now + ahead)))


def ranges(share: float, ahead: float, ids: tuple[int, int] = RADIO) -> Say:
    """Return a sender of radio ranges that are a constant share of the radius and stamped `ahead` s
    in the future."""

    def say(course: Course, n: int) -> list[bytes]:
        stamp = round(1000 * (course.now + ahead))
        height = course.pilot.settings.file.orbit.height_above_target_m or 0.0
        cm = round(100 * hypot(share * course.radius, height))
        one = mavlink.MAVLink_distance_sensor_message(stamp, 1, 65000, cm, 3, 0, 24, 0)
        return packed(n, one, ids=ids)

    return say


def drawing(ahead: float, ids: tuple[int, int] = RADIO) -> Say:
    """Return a sender of radio ranges that start at the true range, so that the gate accepts them,
    and drift away from it."""
    began: list[float] = []

    def say(course: Course, n: int) -> list[bytes]:
        began[:] = began if n else [course.now]
        off = min(DRAWN * (course.now - began[0]), MOST_DRAWN)
        share = true_radius(course.vehicle.truth) / course.radius + off
        return ranges(share, ahead, ids)(course, n)

    return say


def heartbeat(course: Course, n: int) -> list[bytes]:
    """Return the vehicle's heartbeat in a mode that looks like a takeover by the operator."""
    return packed(n, heartbeat_in(course, OTHER_MODE[course.profile]))


def state(course: Course, n: int) -> list[bytes]:
    """Return messages under the vehicle's ids that report a reboot, a landing, an empty battery and
    sideways flight."""
    return packed(
        n,
        mavlink.MAVLink_system_time_message(0, 5),
        mavlink.MAVLink_attitude_message(n, 1.0, 1.0, n % 3, 0, 0, 3.0),
        mavlink.MAVLink_vfr_hud_message(99.0, 99.0, n % 360, 50, 9000.0, 50.0),
        mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0),
        mavlink.MAVLink_extended_sys_state_message(0, 1),
        mavlink.MAVLink_statustext_message(2, ESCAPE),
    )


def answers(course: Course, n: int) -> list[bytes]:
    """Return forged answers to circnav's requests: denied commands, and TIMESYNC answers with wrong
    times."""
    asked = course.pilot.session.timesync._asked
    times = packed(n, *(mavlink.MAVLink_timesync_message(1 + n, stamp) for stamp in asked))
    return times + [acknowledgement(number, 2, OURS) for number in (176, 511, 512)]


def in_our_name(course: Course, n: int) -> list[bytes]:
    return packed(n, mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3), ids=OURS)


def whole_vehicle(course: Course, n: int) -> list[bytes]:
    """Return the messages of a complete vehicle with its radio."""
    return packed(
        n,
        guided_heartbeat(course),
        mavlink.MAVLink_extended_sys_state_message(0, 2),
        mavlink.MAVLink_vfr_hud_message(15.0, 5.0, 0, 50, 15.0, 0.0),
        mavlink.MAVLink_attitude_message(round(1000 * course.now) + 900_000, 0, 0, 1.0, 0, 0, 0),
    ) + ranges(1.3, 0.0)(course, n)


def twin_of_another_time(course: Course, n: int) -> list[bytes]:
    """Return messages with the vehicle's ids and mode, but another time since boot."""
    return packed(n, guided_heartbeat(course), boot_time(course, 900.0))


def version_1(course: Course, n: int) -> list[bytes]:
    """Return the vehicle's heartbeat in the guided mode, in MAVLink 1."""
    engine = mavlink.MAVLink(None, *VEHICLE)
    return [bytes(guided_heartbeat(course).pack(engine, force_mavlink1=True))]


def listening_twin(course: Course, n: int) -> list[bytes]:
    """Return the vehicle's heartbeat and its correct time since boot."""
    return packed(n, boot_time(course, 0.0)) + packed(0, guided_heartbeat(course))


def twin_with_radio(course: Course, n: int) -> list[bytes]:
    return listening_twin(course, n) + ranges(1.3, 0.1)(course, n)


def escapes(course: Course, n: int) -> list[bytes]:
    return packed(n, mavlink.MAVLink_statustext_message(2, ESCAPE))


def by(say: Say, rate: float, *, until: float | None = None) -> Arrange:
    """Return an arrangement that adds an attacker with a different address. until: time after which
    the attacker is silent, s."""

    def arrange(course: Course, seed: int) -> None:
        began = course.now

        def words(n: int) -> list[bytes]:
            over = until is not None and course.now - began > until
            return [] if over else say(course, n)

        course.intruders.append(periodic(rate, words))

    return arrange


def flood(datagram: bytes) -> Arrange:
    return by(lambda course, n: [datagram] * 4, 50.0)


def forged_address(say: Say, rate: float) -> Arrange:
    """Return an arrangement that adds an attacker who forges the trusted address."""

    def arrange(course: Course, seed: int) -> None:
        course.link.intruders.append(periodic(rate, partial(say, course)))

    return arrange


def while_mode_is_unknown(say: Say) -> Arrange:
    """Return an arrangement in which the vehicle's heartbeats are lost for 2.3 s while an attacker
    sends. The vehicle's other messages arrive. CURRENT_MODE is the vehicle's first report of its
    mode after that."""

    def arrange(course: Course, seed: int) -> None:
        since = course.now + 2.0

        def lose(frame: bytes, now: float) -> list[bytes]:
            lost = since <= now < since + 2.3 and sender(frame) == VEHICLE
            return [] if lost else [frame]

        course.link.tampers.append(on(0, lose))
        mode = course.pilot.session.adapter.guided_mode
        (frame,) = packed(0, mavlink.MAVLink_current_mode_message(0, mode, mode))
        course.link.intruders.append(
            periodic(20.0, lambda n: [frame] if since + 2.2 <= course.now < since + 2.25 else [])
        )
        by(say, 10.0)(course, seed)

    return arrange


def taken_for_it(course: Course, seed: int) -> None:
    """Add an attacker that is accepted as the vehicle, because the vehicle has no key: a limit
    documented in docs/safety.md. The display shows both senders."""
    course.forgeable = True
    by(twin_with_radio, 10.0)(course, seed)


def replayed_after_a_restart(course: Course, seed: int) -> None:
    """Record vehicle and radio for 20 s, restart circnav and silence both. Then an attacker repeats
    the recorded frames."""
    record: list[bytes] = []

    def tape(way: str, data: bytes, now: float) -> list[Passage]:
        if way == DOWN:
            record.append(data)
        return [(way, data)]

    course.link.tampers.append(tape)
    course.fly(course.now + 20.0)
    course.link.tampers[:] = [lambda way, data, now: [(way, data)] if way == UP else []]
    course.restart()
    since = course.now

    def say(course: Course, n: int) -> list[bytes]:
        taken = course.pilot.tracker.accepted
        vehicle = course.pilot.session.identity.home
        if (taken or vehicle) and not course.broken:
            course.broken.append(
                f"{course.now - since:.1f} s after the restart: {taken} ranges taken, vehicle"
                f" {vehicle}"
            )
        return record[20 * n : 20 * n + 20]

    by(say, 20.0)(course, seed)


def second_circnav(*overrides: str) -> Arrange:
    """Return an arrangement with another circnav on the same vehicle. A hub forwards the vehicle's
    frames to both programs, which do not receive each other."""

    def arrange(course: Course, seed: int) -> None:
        mission = load_mission(
            CONFIG / f"{course.profile}.toml", (*PATIENT, f'guidance.law="{LAW}"', *overrides)
        )
        second = Pilot(mission)
        start = course.now

        def overhear(way: str, data: bytes, now: float) -> list[Passage]:
            if way == DOWN:
                second.receive(data, now - start, SOURCE)
            return [(way, data)]

        def steer(now: float) -> list[Passage]:
            sent = frames(output(second, now - start))
            second.take_frames()
            second.take_records()
            return [(UP, frame) for frame in sent]

        course.link.tampers.append(overhear)
        course.link.intruders.append(steer)

    return arrange


def to_loiter(course: Course, seed: int) -> None:
    """Add an attacker that changes the vehicle's mode: any sender can do so if the vehicle has no
    key."""
    mode = mavlink.MAVLink_command_long_message(
        1, 1, 176, 0, 1, OTHER_MODE[course.profile], 0, 0, 0, 0, 0
    )
    course.link.intruders.append(repeating((255, 190), 1.0, lambda n: [mode], direction=UP))


def waits(course: Course, until: float = PATIENCE) -> str | None:
    """Return a fault if circnav sent setpoints before the attack ended."""
    early = [time for time in course.steered_at if time < until]
    return f"{len(early)} setpoints while it was not sure who the vehicle is" if early else None


def no_raw_text(course: Course) -> str | None:
    """Return a fault unless all texts of the vehicle are safe to print on a terminal."""
    texts = course.pilot.session.vehicle.texts
    return None if texts and all(map(str.isprintable, texts)) else f"texts: {list(texts)!r}"


def attack(name: str, arrange: Arrange, reported: str, **more: Any) -> Scenario:
    options = {"lasts": 25.0, "after": 5.0, "profiles": ("arducopter", "arduplane"), **more}
    return Scenario("F23", name, arrange=arrange, reported=reported, **options)


FROM_START: dict[str, Any] = {**FRESH, "lasts": PATIENCE, "want": Want.ENGAGE}
HELD_BACK: dict[str, Any] = {**FROM_START, "want": Want.SAFE, "check": waits}
"""Options of an attack that begins before the flight. HELD_BACK: the vehicle must not be engaged
during the attack."""
EARLY: dict[str, Any] = {"quick": True, "down": Impairment(outages=((0.0, 6.0),))}
"""The vehicle is received 6 s after the start of the attack."""
AFTER_SILENCE: dict[str, Any] = {
    "down": Impairment(outages=((0.0, 20.0),)),
    "want": Want.SAFE,
    "lasts": 25.0,
    "after": 35.0,
}
"""Options of an attack during and after an outage of the vehicle of 20 s."""
REGAINED: dict[str, Any] = {**AFTER_SILENCE, "want": Want.REGAIN}
SIGNED: dict[str, Any] = {"reported": "unsigned frames", "keys": BOTH}
VEHICLES = "the vehicle has a second"
RADIOS = "the ranging radio has a second"
IS_REJECTED = (
    "the vehicle has a second sender: 1/1 at sim is rejected, 1/1 at 10.9.9.9:6666 is used"
)
BEAT = write(mavlink.MAVLink_heartbeat_message(2, 3, 129, 4, 4, 3), 9, 1)
STRANGE = bytes((0xFD, 255, 0, 0, 1, 9, 9, 0x31, 0xD4, 0)) + b"\xfd\x20\x00" * 85 + b"\x12\x34"
FLOODS = {
    "0xFD": b"\xfd" * LONG,
    "false starts": b"\xfd\x00\x00" * (LONG // 3),
    "heartbeats of another sender": BEAT * 300,
    "unknown ids": STRANGE * 30,
}
STATE = "reboot, battery, attitude of the vehicle"
UNSURE = "while its mode is not reported for 2.3 s"
ATTACKS = [
    attack("ranges of the radio, 40 ms ahead", by(drawing(0.04), 20.0), RADIOS, quick=True),
    attack("ranges of the radio, 400 ms ahead", by(drawing(0.4), 20.0), RADIOS),
    attack("ranges of another radio", by(drawing(0.1, (1, 193)), 20.0), RADIOS),
    attack("mode of the vehicle", by(heartbeat, 4.0), VEHICLES),
    attack(STATE, by(state, 10.0), VEHICLES, quick=True),
    attack("answers of the vehicle", by(answers, 20.0), VEHICLES, quick=True),
    attack("frames in our name", by(in_our_name, 10.0), "circnav has a second", quick=True),
    attack(f"MAVLink 1 in the vehicle's name {UNSURE}", while_mode_is_unknown(version_1), VEHICLES),
    attack(
        f"the vehicle's name and its time since boot {UNSURE}",
        while_mode_is_unknown(listening_twin),
        VEHICLES,
        quick=True,
    ),
    attack(
        "frames in the vehicle's name after a silence",
        by(twin_of_another_time, 4.0),
        VEHICLES,
        quick=True,
        **REGAINED,
    ),
    attack(
        "name, time since boot and ranges of the vehicle after a silence",
        taken_for_it,
        IS_REJECTED,
        **AFTER_SILENCE,
    ),
    attack(
        "the vehicle and its radio, six seconds early",
        by(whole_vehicle, 10.0),
        VEHICLES,
        **EARLY,
        **HELD_BACK,
    ),
    attack(
        "ranges before the radio's first, until 20 s",
        by(ranges(1.3, 0.1), 10.0, until=20.0),
        RADIOS,
        check=partial(waits, until=20.0),
        **FROM_START,
    ),
    attack("refusals of the mode, from the start", by(answers, 20.0), VEHICLES, **HELD_BACK),
    *(
        attack(
            f"flood of {name}, {len(data) * 200 / 1e6:.1f} MB/s",
            flood(data),
            "FLOOD",
            quick=name == "false starts",
        )
        for name, data in FLOODS.items()
    ),
    attack(
        "a second circnav with our ids",
        second_circnav(),
        "SECOND CONTROLLER: the vehicle answers",
        want=Want.SAFE,
    ),
    attack(
        "a second circnav with another id on another circle",
        second_circnav("link.component_id=193", "orbit.radius_m=90.0"),
        "SECOND CONTROLLER: the vehicle flies",
        want=Want.SAFE,
    ),
    attack(
        "ESC in the vehicle's own texts", forged_address(escapes, 5.0), "PreArm", check=no_raw_text
    ),
    attack(
        "ranges 400 ms ahead, address forged",
        forged_address(drawing(0.4), 20.0),
        "SENSOR CLOCK",
        want=Want.SAFE,
    ),
    *(
        attack(f"{name}, address forged, link signed", forged_address(say, 10.0), **SIGNED)
        for name, say in (
            ("ranges of the radio", drawing(0.1)),
            ("mode of the vehicle", heartbeat),
            (STATE, state),
            ("frames in our name", in_our_name),
        )
    ),
    *(
        attack(f"{name}, link signed", by(say, 10.0), **SIGNED)
        for name, say in (
            ("ranges of the radio, 400 ms ahead", drawing(0.4)),
            ("mode of the vehicle", heartbeat),
            ("frames in our name", in_our_name),
        )
    ),
    attack(
        "the vehicle and its radio, six seconds early, link signed",
        by(whole_vehicle, 10.0),
        **SIGNED,
        **EARLY,
        **FROM_START,
    ),
    attack(
        "name, time since boot and ranges of the vehicle after a silence, link signed",
        by(twin_with_radio, 10.0),
        **SIGNED,
        **REGAINED,
    ),
    attack(
        "flood of heartbeats of another sender, link signed", flood(BEAT * 300), "FLOOD", keys=BOTH
    ),
    attack(
        "a command to the autopilot",
        to_loiter,
        "",
        quick=True,
        want=Want.END,
        reason="pilot or failsafe",
    ),
    attack(
        "all frames of before a restart of ours, link signed",
        replayed_after_a_restart,
        "clock_behind frames refused",
        quick=True,
        keys=BOTH,
        **FROM_START,
    ),
]
