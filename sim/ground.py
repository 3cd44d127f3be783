"""The ground: touchdown, crash, and the landed state of copters.

A landed vehicle stands level, as in ArduPilot's simulator (SIM_Aircraft.cpp,
GROUND_BEHAVIOR_NO_MOVEMENT). A crashed vehicle stays where it is.
"""

import math

from .agenda import NEVER
from .body import Body

CLOSE_M = 1.0  # height below which the landed state is checked
CHECK_US = 50_000  # time between two checks near the ground
TIPPING_SPEED = 1.0  # ground speed at which a copter tips over at a touchdown, m/s
BREAKING_SINK = 3.0  # sink rate that breaks a vehicle, m/s
HALF_SPAN = 1.0  # half of the wing span of a plane, m
CLEARANCE = 0.1  # height of the wing tips of a plane on its wheels, m


def standing(body: Body) -> Body:
    """Return the body at rest on the ground, level."""
    return Body(
        body.north,
        body.east,
        0.0,
        body.heading,
        trimmed_wind=body.trimmed_wind,
        error=body.error,
    )


def copter_touches(before: Body, after: Body) -> tuple[Body, bool]:
    """Return the body after a possible contact with the ground, and True for a crash."""
    if after.down < 0:
        return after, False
    sink = max(before.velocity_down, after.velocity_down)
    hard = sink > BREAKING_SINK or after.ground_speed > TIPPING_SPEED
    return standing(after), hard and before.down < 0


def plane_touches(before: Body, after: Body) -> tuple[Body, bool]:
    """Return the body after a possible contact, and True if a wing tip or a hard landing broke the
    plane."""
    tip = HALF_SPAN * abs(math.sin(after.roll))
    if after.down < -tip:
        return after, False
    sink = max(before.velocity_down, after.velocity_down)
    crashed = tip > CLEARANCE or sink > BREAKING_SINK
    return (standing(after) if crashed else after), crashed


def rover_touches(before: Body, after: Body) -> tuple[Body, bool]:
    return after, False


class LandedState:
    """Landed state of a copter, as its land detector reports it.

    lift_off_us: time from the command to climb to lift-off (motors spool up).
    settle_us: time from the touchdown to "landed".
    """

    def __init__(self, landed: bool, lift_off_us: int, settle_us: int) -> None:
        self.landed = landed
        self._delays = {"lift off": lift_off_us, "settle": settle_us}
        self._pending: tuple[str, int] | None = None  # next change and its time
        self._check_at = 0

    def next_check(self, body: Body) -> int:
        return self._check_at if body.down > -CLOSE_M else NEVER

    def update(self, climbs: bool, sinks: bool, disarm_us: int | None, now: int) -> bool:
        """Advance the state. Return True when the autopilot disarms.

        climbs: True if a climb is commanded.
        sinks: True if the copter touches the ground while a descent is commanded.
        disarm_us: time from "landed" to disarming, None: no disarming.
        """
        self._check_at = now + CHECK_US
        change = None
        delay = 0
        if self.landed and climbs:
            change = "lift off"
            delay = self._delays["lift off"]
        elif self.landed and disarm_us is not None:
            change = "disarm"
            delay = disarm_us
        elif not self.landed and sinks:
            change = "settle"
            delay = self._delays["settle"]
        if change is None:
            self._pending = None
        elif self._pending is None or self._pending[0] != change:
            self._pending = change, now + delay
        elif now >= self._pending[1]:
            self._pending = None
            self.landed = change != "lift off"
            return change == "disarm"
        return False
