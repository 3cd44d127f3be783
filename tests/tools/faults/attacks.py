"""python -m tests.tools.faults.attacks [--profile P] [--seed N]: attacks over the link, one row
each.

F23: an unknown sender receives all traffic of the link and sends from a different address. In a row
with `address forged` the attacker also forges the trusted address, which only signing prevents.
Each row checks the setpoints and the alarms shown to the operator. docs/safety.md has the trust
model.
"""

import argparse
import sys
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
from tests.tools.fault_link.intruders import periodic
from tests.tools.fault_link.link import Passage
from tests.tools.faults.cell import FRESH, LAW, Scenario, Verdict, Want, fly
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

Say = Callable[[Course, float, int], list[bytes]]
"""Callback(flight, now, number of earlier calls): returns the attacker's datagrams."""


def ranges(share: float, ahead: float, ids: tuple[int, int] = RADIO) -> Say:
    """Return a sender of radio ranges that are a constant share of the radius and stamped `ahead` s
    in the future."""

    def say(course: Course, now: float, n: int) -> list[bytes]:
        stamp = round(1000 * (now + ahead))
        height = course.pilot.settings.file.orbit.height_above_target_m or 0.0
        cm = round(100 * hypot(share * course.radius, height))
        return [
            write(
                mavlink.MAVLink_distance_sensor_message(stamp, 1, 65000, cm, 3, 0, 24, 0),
                *ids,
                n & 255,
            )
        ]

    return say


def drawing(ahead: float, ids: tuple[int, int] = RADIO) -> Say:
    """Return a sender of radio ranges that start at the true range, so that the gate accepts them,
    and drift away from it."""
    began: list[float] = []

    def say(course: Course, now: float, n: int) -> list[bytes]:
        began[:] = began if n else [now]
        off = min(DRAWN * (now - began[0]), MOST_DRAWN)
        return ranges(true_radius(course.vehicle.truth) / course.radius + off, ahead, ids)(
            course, now, n
        )

    return say


def heartbeat(course: Course, now: float, n: int) -> list[bytes]:
    """Return the vehicle's heartbeat in a mode that looks like a takeover by the operator."""
    kind = KIND[course.profile]
    mode = OTHER_MODE[course.profile]
    return [write(mavlink.MAVLink_heartbeat_message(kind, 3, 0x81, mode, 4, 3), *VEHICLE, n & 255)]


def state(course: Course, now: float, n: int) -> list[bytes]:
    """Return messages under the vehicle's ids that report a reboot, a landing, an empty battery and
    sideways flight."""
    messages = (
        mavlink.MAVLink_system_time_message(0, 5),
        mavlink.MAVLink_attitude_message(n, 1.0, 1.0, n % 3, 0, 0, 3.0),
        mavlink.MAVLink_vfr_hud_message(99.0, 99.0, n % 360, 50, 9000.0, 50.0),
        mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0),
        mavlink.MAVLink_extended_sys_state_message(0, 1),
        mavlink.MAVLink_statustext_message(2, ESCAPE),
    )
    return [write(message, *VEHICLE, n & 255) for message in messages]


def answers(course: Course, now: float, n: int) -> list[bytes]:
    """Return forged answers to circnav's requests: denied commands, and TIMESYNC answers with wrong
    times."""
    asked = [*course.pilot.session.timesync._asked]
    messages = [
        write(mavlink.MAVLink_timesync_message(1 + n, stamp), *VEHICLE, n & 255) for stamp in asked
    ]
    return messages + [acknowledgement(number, 2, OURS) for number in (176, 511, 512)]


def in_our_name(course: Course, now: float, n: int) -> list[bytes]:
    return [write(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3), *OURS, n & 255)]


def whole_vehicle(course: Course, now: float, n: int) -> list[bytes]:
    """Return the messages of a complete vehicle with its radio."""
    mode = course.pilot.session.adapter.guided_mode
    messages = (
        mavlink.MAVLink_heartbeat_message(KIND[course.profile], 3, 0x81, mode, 4, 3),
        mavlink.MAVLink_extended_sys_state_message(0, 2),
        mavlink.MAVLink_vfr_hud_message(15.0, 5.0, 0, 50, 15.0, 0.0),
        mavlink.MAVLink_attitude_message(round(1000 * now) + 900_000, 0, 0, 1.0, 0, 0, 0),
    )
    return [
        *(write(message, *VEHICLE, n & 255) for message in messages),
        *ranges(1.3, 0.0)(course, now, n),
    ]


def twin_of_another_time(course: Course, now: float, n: int) -> list[bytes]:
    """Return messages with the vehicle's ids and mode, but another time since boot."""
    mode = course.pilot.session.adapter.guided_mode
    messages = (
        mavlink.MAVLink_heartbeat_message(KIND[course.profile], 3, 0x81, mode, 4, 3),
        mavlink.MAVLink_system_time_message(0, round(1000 * (now + 900.0))),
    )
    return [write(message, *VEHICLE, n & 255) for message in messages]


def guided(course: Course, now: float, n: int, *, version_1: bool = False) -> list[bytes]:
    """Return the vehicle's heartbeat in the guided mode."""
    mode = course.pilot.session.adapter.guided_mode
    beat = mavlink.MAVLink_heartbeat_message(KIND[course.profile], 3, 0x81, mode, 4, 3)
    return [bytes(beat.pack(mavlink.MAVLink(None, *VEHICLE), force_mavlink1=version_1))]


def listening_twin(course: Course, now: float, n: int) -> list[bytes]:
    """Return the vehicle's heartbeat and its correct time since boot."""
    time = mavlink.MAVLink_system_time_message(0, round(1000 * now))
    return [write(time, *VEHICLE, n & 255), *guided(course, now, n)]


def flood(datagram: bytes) -> Say:
    return lambda course, now, n: [datagram] * 4


def by(say: Say, rate: float, *, until: float | None = None) -> Callable[[Course, int], None]:
    """Return an arrangement that adds an attacker with a different address. until: time after which
    the attacker is silent, s."""

    def arrange(course: Course, seed: int) -> None:
        began = course.now
        spoken = iter(range(10**9))

        def words(n: int) -> list[bytes]:
            over = until is not None and course.now - began > until
            return [] if over else say(course, course.now, next(spoken))

        course.strangers.append(periodic(rate, words))

    return arrange


def while_mode_is_unknown(say: Say) -> Callable[[Course, int], None]:
    """Return an arrangement in which the vehicle's heartbeats are lost for 2.3 s while an attacker
    sends. The vehicle's other messages arrive. CURRENT_MODE is the vehicle's first report of its
    mode after that."""

    def arrange(course: Course, seed: int) -> None:
        since = course.now + 2.0
        course.link.tampers.append(
            on(
                0,
                lambda frame, now: (
                    [] if since <= now < since + 2.3 and sender(frame) == VEHICLE else [frame]
                ),
            )
        )
        report = mavlink.MAVLink_current_mode_message(
            0, *[course.pilot.session.adapter.guided_mode] * 2
        )
        frame = bytes(report.pack(mavlink.MAVLink(None, *VEHICLE)))
        course.link.intruders.append(
            periodic(20.0, lambda n: [frame] if since + 2.2 <= course.now < since + 2.25 else [])
        )
        by(say, 10.0)(course, seed)

    return arrange


def forged_address(say: Say, rate: float) -> Callable[[Course, int], None]:
    """Return an arrangement that adds an attacker who forges the trusted address."""

    def arrange(course: Course, seed: int) -> None:
        course.link.intruders.append(periodic(rate, lambda n: say(course, course.now, n)))

    return arrange


def attack(
    name: str, arrange: Callable[[Course, int], None], reported: str, **more: Any
) -> Scenario:
    options = {"lasts": 25.0, "after": 5.0, "profiles": ("arducopter", "arduplane"), **more}
    return Scenario("F23", name, arrange=arrange, reported=reported, **options)


def waits(course: Course, until: float = PATIENCE) -> str | None:
    """Return a fault if circnav sent setpoints before the attack ended."""
    early = [time for time in course.steered_at if time < until]
    return f"{len(early)} setpoints while it was not sure who the vehicle is" if early else None


HELD_BACK: dict[str, Any] = {**FRESH, "lasts": PATIENCE, "want": Want.SAFE, "check": waits}
"""Options of an attack that begins before the flight: the vehicle must not be engaged during the
attack."""
SIX_SECONDS = Impairment(outages=((0.0, 6.0),))
"""The vehicle is received 6 s after the start of the attack."""


AFTER_SILENCE: dict[str, Any] = {
    "down": Impairment(outages=((0.0, 20.0),)),
    "want": Want.SAFE,
    "lasts": 25.0,
    "after": 35.0,
}
"""Options of an attack during and after an outage of the vehicle of 20 s."""


def taken_for_it(course: Course, seed: int) -> None:
    """Add an attacker that is accepted as the vehicle, because the vehicle has no key: a limit
    documented in docs/safety.md. The display shows both senders."""
    course.forgeable = True
    by(
        lambda course, now, n: listening_twin(course, now, n) + ranges(1.3, 0.1)(course, now, n),
        10.0,
    )(course, seed)


IS_REJECTED = (
    "the vehicle has a second sender: 1/1 at sim is rejected, 1/1 at 10.9.9.9:6666 is used"
)


def replayed_after_a_restart(course: Course, seed: int) -> None:
    """Record vehicle and radio for 20 s, restart circnav and silence both. Then an attacker repeats
    the recorded frames."""
    record: list[bytes] = []
    course.link.tampers.append(
        lambda way, data, now: (record.append(data) if way == DOWN else None, [(way, data)])[1]
    )
    course.fly(course.now + 20.0)
    course.link.tampers[:] = [lambda way, data, now: [(way, data)] if way == UP else []]
    course.restart()
    since = course.now

    def say(course: Course, now: float, n: int) -> list[bytes]:
        taken = course.pilot.tracker.accepted
        vehicle = course.pilot.session.identity.home
        if (taken or vehicle) and not course.broken:
            course.broken.append(
                f"{now - since:.1f} s after the restart: {taken} ranges taken, vehicle {vehicle}"
            )
        return record[20 * n : 20 * n + 20]

    by(say, 20.0)(course, seed)


def second_circnav(*overrides: str) -> Callable[[Course, int], None]:
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
            second.take_frames(), second.take_records()
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
    course.link.intruders.append(
        periodic(1.0, lambda n: [write(mode, 255, 190, n & 255)], direction=UP)
    )


def no_raw_text(course: Course) -> str | None:
    """Return a fault unless all texts of the vehicle are safe to print on a terminal."""
    messages = course.pilot.session.vehicle.texts
    return (
        None if messages and all(map(str.isprintable, messages)) else f"texts: {list(messages)!r}"
    )


def escapes(course: Course, now: float, n: int) -> list[bytes]:
    return [write(mavlink.MAVLink_statustext_message(2, ESCAPE), *VEHICLE, n & 255)]


VEHICLES = "the vehicle has a second"
RADIOS = "the ranging radio has a second"
OUR = "circnav has a second"
BEAT = write(mavlink.MAVLink_heartbeat_message(2, 3, 129, 4, 4, 3), 9, 1)
STRANGE = bytes((0xFD, 255, 0, 0, 1, 9, 9, 0x31, 0xD4, 0)) + b"\xfd\x20\x00" * 85 + b"\x12\x34"
ATTACKS = [
    *(
        attack(
            f"ranges of the radio, {1000 * ahead:.0f} ms ahead",
            by(drawing(ahead), 20.0),
            RADIOS,
            quick=ahead == 0.04,
        )
        for ahead in (0.04, 0.4)
    ),
    attack("ranges of another radio", by(drawing(0.1, (1, 193)), 20.0), RADIOS),
    attack("mode of the vehicle", by(heartbeat, 4.0), VEHICLES),
    attack("reboot, battery, attitude of the vehicle", by(state, 10.0), VEHICLES, quick=True),
    attack("answers of the vehicle", by(answers, 20.0), VEHICLES, quick=True),
    attack("frames in our name", by(in_our_name, 10.0), OUR, quick=True),
    *(
        attack(
            f"{name} while its mode is not reported for 2.3 s",
            while_mode_is_unknown(say),
            VEHICLES,
            quick=say is listening_twin,
        )
        for name, say in (
            ("MAVLink 1 in the vehicle's name", partial(guided, version_1=True)),
            ("the vehicle's name and its time since boot", listening_twin),
        )
    ),
    attack(
        "frames in the vehicle's name after a silence",
        by(twin_of_another_time, 4.0),
        VEHICLES,
        quick=True,
        **{**AFTER_SILENCE, "want": Want.REGAIN},
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
        quick=True,
        down=SIX_SECONDS,
        **HELD_BACK,
    ),
    attack(
        "ranges before the radio's first, until 20 s",
        by(ranges(1.3, 0.1), 10.0, until=20.0),
        RADIOS,
        **{**HELD_BACK, "want": Want.ENGAGE, "check": lambda course: waits(course, until=20.0)},
    ),
    attack("refusals of the mode, from the start", by(answers, 20.0), VEHICLES, **HELD_BACK),
    *(
        attack(
            f"flood of {name}, {len(data) * 200 / 1e6:.1f} MB/s",
            by(flood(data), 50.0),
            "FLOOD",
            quick=name == "false starts",
        )
        for name, data in (
            ("0xFD", b"\xfd" * LONG),
            ("false starts", b"\xfd\x00\x00" * (LONG // 3)),
            ("heartbeats of a stranger", BEAT * 300),
            ("unknown ids", STRANGE * 30),
        )
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
        attack(
            f"{name}, address forged, link signed",
            forged_address(say, 10.0),
            "unsigned frames",
            keys=BOTH,
        )
        for name, say in (
            ("ranges of the radio", drawing(0.1)),
            ("mode of the vehicle", heartbeat),
            ("reboot, battery, attitude of the vehicle", state),
            ("frames in our name", in_our_name),
        )
    ),
    *(
        attack(f"{name}, link signed", by(say, 10.0), "unsigned frames", keys=BOTH)
        for name, say in (
            ("ranges of the radio, 400 ms ahead", drawing(0.4)),
            ("mode of the vehicle", heartbeat),
            ("frames in our name", in_our_name),
        )
    ),
    attack(
        "the vehicle and its radio, six seconds early, link signed",
        by(whole_vehicle, 10.0),
        "unsigned frames",
        **{**HELD_BACK, "want": Want.ENGAGE, "check": None},
        quick=True,
        down=SIX_SECONDS,
        keys=BOTH,
    ),
    attack(
        "name, time since boot and ranges of the vehicle after a silence, link signed",
        by(
            lambda course, now, n: (
                listening_twin(course, now, n) + ranges(1.3, 0.1)(course, now, n)
            ),
            10.0,
        ),
        "unsigned frames",
        **{**AFTER_SILENCE, "want": Want.REGAIN},
        keys=BOTH,
    ),
    attack(
        "flood of heartbeats of a stranger, link signed",
        by(flood(BEAT * 300), 50.0),
        "FLOOD",
        keys=BOTH,
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
        **{**HELD_BACK, "want": Want.ENGAGE, "check": None},
    ),
]
HEAD = "| attack | setpoints | shown to the operator | result |\n|---|---|---|---|"


def row(verdict: Verdict) -> str:
    """Return the line of the table for an attack."""
    scenario = verdict.scenario
    if verdict.outcome:
        did = f"end: {verdict.outcome}"
    elif not verdict.engaged:
        did = "none: not engaged"
    elif scenario.fresh:
        did = "none before it was over, then engaged"
    else:
        did = f"hold the circle, RMS {100 * verdict.rms:.1f} %"
    shown = (
        next((line for line in verdict.reported if scenario.reported in line), "-")
        if scenario.reported
        else "-"
    )
    result = "safe, reported" if verdict.passed else f"**FAIL** {'; '.join(verdict.faults)}"
    return f"| {scenario.level} | {did} | {shown} | {result} |"


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m tests.tools.faults.attacks", description="Flies the attack table."
    )
    parser.add_argument("--profile", choices=("arducopter", "arduplane"), default="arducopter")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(arguments)
    print(HEAD)
    failed = 0
    for scenario in ATTACKS:
        verdict = fly(scenario, options.profile, options.seed)
        print(row(verdict), flush=True)
        failed += not verdict.passed
    print(f"{len(ATTACKS)} attacks, {failed} failed, {options.profile}, seed {options.seed}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
