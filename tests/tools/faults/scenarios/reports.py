"""F29: the vehicle's reports about its motion are missing, not finite, or jump."""

from collections.abc import Callable
from math import nan, pi, remainder
from typing import Any

from tests.frames import read, rewritten
from tests.tools.faults.cell import Scenario, Want, tampered
from tests.tools.faults.tampering import Change, on

ATTITUDE = 30
VFR_HUD = 74
AUTO = ('guidance.law="auto"',)
"""The default law, which uses the heading, also if the matrix is flown by another law."""
ARDUPILOT = ("arducopter", "arduplane", "ardurover")
"""Vehicles that need ATTITUDE. PX4 also sends ATTITUDE_QUATERNION, which is sufficient."""
YAW: dict[str, Any] = {"overrides": AUTO, "reported": "HEADING JUMPED", "profiles": ARDUPILOT}
BLIND: dict[str, Any] = {
    "overrides": AUTO,
    "reported": "NO ATTITUDE",
    "profiles": ARDUPILOT,
    "want": Want.REGAIN,
}
BANKED = ("arduplane", "px4_plane")


def reports(level: str, number: int, make: Callable[[], Change], **more: Any) -> Scenario:
    """Return a scenario that changes one message of the vehicle during the fault."""
    arrange = tampered(lambda seed: on(number, make()))
    return Scenario("F29", level, arrange=arrange, **{"lasts": 40.0, "after": 30.0, **more})


def turned(angle: float) -> Callable[[], Change]:
    """Return a change by which the yaw jumps by this angle, rad, and back at the end of the
    fault."""

    def change(frame: bytes, now: float) -> list[bytes]:
        return [rewritten(frame, yaw=remainder(read(frame).yaw + angle, 2 * pi))]

    return lambda: change


def every_second() -> Change:
    """Pass one attitude per second and drop the others."""
    passed = [-1.0]

    def change(frame: bytes, now: float) -> list[bytes]:
        if now - passed[0] < 1.0 - 1e-6:
            return []
        passed[0] = now
        return [frame]

    return change


def fixed(**values: float) -> Callable[[], Change]:
    """Set fields to constant values in every frame."""
    return lambda: lambda frame, now: [rewritten(frame, **values)]


def missing() -> Change:
    return lambda frame, now: []


REPORTS = [
    reports("yaw reset by 180 deg", ATTITUDE, turned(pi), quick=True, **YAW),
    reports("yaw reset by 90 deg", ATTITUDE, turned(pi / 2), **YAW),
    reports("no ATTITUDE", ATTITUDE, missing, quick=True, **BLIND),
    reports(
        "ATTITUDE without numbers",
        ATTITUDE,
        fixed(yaw=nan, rollspeed=nan, pitchspeed=nan, yawspeed=nan),
        **BLIND,
    ),
    reports(
        "ATTITUDE at 1 Hz", ATTITUDE, every_second, **(BLIND | {"reported": "ATTITUDE RATE LOW"})
    ),
    reports(
        "airspeed without a number",
        VFR_HUD,
        fixed(airspeed=nan),
        profiles=BANKED,
        reported="NO AIRSPEED",
    ),
    reports(
        "airspeed 0", VFR_HUD, fixed(airspeed=0.0), profiles=("arduplane",), reported="NO AIRSPEED"
    ),
]
