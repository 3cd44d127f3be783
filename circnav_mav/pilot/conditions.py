"""Conditions of a flight that the operator must be informed of: one table for display, page,
STATUSTEXT and verdict.

`Conditions` evaluates the table after each step. It sends texts to ground stations once when a
condition begins and once when it ends. `alarms` holds the current texts. Extras report their own
conditions by `Onlooker.alarms`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import atan, degrees, inf
from typing import TYPE_CHECKING

from pymavlink.dialects.v20.all import MAV_SEVERITY_NOTICE as NOTICE
from pymavlink.dialects.v20.all import MAV_SEVERITY_WARNING as WARNING

from circnav_mav.mav.frames import GRAVITY
from circnav_mav.mav.identity import OUR_NAME, RADIO_NAME, VEHICLE_NAME
from circnav_mav.pilot.authority import SILENT, unwatched
from circnav_mav.pilot.mission_state import NO_FAILURE, Phase

if TYPE_CHECKING:
    from circnav_mav.pilot.pilot import Pilot

MOST_REJECTED = 0.5
"""Share of rejected ranges above which an alarm is raised."""
FEW_SETPOINTS = 0.5
"""Share of the setpoint rate `limits.tick_hz` below which a steered vehicle receives too few
setpoints."""
UPLINK_SILENT = 2.0
"""Time, s, without an answer of a steered vehicle to TIMESYNC, after which an alarm is raised.
Requests are sent once a second and repeated if lost."""
LOST = {
    "attitude": (
        "NO ATTITUDE from the vehicle: steered by ranges alone, no check that it follows turn"
        " commands"
    ),
    "airspeed": "NO AIRSPEED from the vehicle: vehicle.speed_mps is used instead",
    "altitude": "NO ALTITUDE from the vehicle: no climb is commanded",
    "climb": "NO CLIMB RATE from the vehicle: the commanded pitch is not corrected for it",
}
"""Alarms for telemetry that a steered vehicle no longer sends."""
NO_PLACE = "the autopilot holds no place now"
NOISE = "range noise {found[1]:.2g} m, expected {found[0]:.2g} m"


@dataclass(frozen=True)
class Condition:
    """A row of the table. Texts are format strings of `found`, the evidence of the condition, and
    `p`, the pilot.

    name: stable key, also in summary.json. find: function from pilot and time to `found`, which is
    falsy while the condition is not active. short: STATUSTEXT at the beginning, at most 41
    characters, empty for none. long: text of the alarm on display, page and verdict, empty if the
    condition is no alarm. over: STATUSTEXT at the end. repeats: True to send `short` at each change
    of `found`. once: True to send `short` once per flight. steering: True if the condition exists
    only while the vehicle is steered. The end of steering then ends the condition without a text.
    """

    name: str
    find: Callable[["Pilot", float], object] = lambda p, now: None
    short: str = ""
    long: str = ""
    over: str = ""
    severity: int = WARNING
    repeats: bool = False
    once: bool = False
    steering: bool = False

    def alarm(self, found: object) -> dict[str, str]:
        """Return {name: text} of a condition that is detected outside of the pilot."""
        return {self.name: self.long.format(found=found)}


class Conditions:
    """The active conditions of one flight, and their texts for ground stations."""

    def __init__(self, pilot: "Pilot") -> None:
        self._pilot = pilot
        self._say = pilot.session.announcer.say
        self._active: dict[str, object] = {}
        self._sent: dict[str, object] = {}
        """Value of `found` when `short` was last sent, by name of the condition; True without
        `repeats`."""

    @property
    def alarms(self) -> dict[str, str]:
        """Texts of the active alarms, by name, the worst first."""
        rows = (row for row in TABLE if row.long and row.name in self._active)
        return {
            row.name: row.long.format(found=self._active[row.name], p=self._pilot) for row in rows
        }

    def update(self, now: float) -> None:
        """Evaluate the table, and send texts for the conditions that have begun or ended."""
        pilot = self._pilot
        for row in TABLE:
            hidden = (row.steering and not pilot.mission.steering) or (
                pilot.done and row is not ENDED
            )
            if not hidden and (found := row.find(pilot, now)):
                self._active[row.name], news = found, found if row.repeats else True
                if row.short and self._sent.get(row.name) != news:
                    self._sent[row.name] = news
                    self._say(
                        row.name, row.short.format(found=found, p=pilot), severity=row.severity
                    )
            elif row.name in self._active:
                self.forget(row)
                if row.over and not hidden:
                    self._say(row.name, row.over, severity=NOTICE)

    def forget(self, row: Condition) -> None:
        """Mark a condition as not active, without a text for its end."""
        self._active.pop(row.name, None)
        if not row.once:
            self._sent.pop(row.name, None)


def _lost(name: str) -> Callable[["Pilot", float], object]:
    return lambda p, now: name in p.lost_reports


def _second_sender(name: str) -> Callable[["Pilot", float], object]:
    return lambda p, now: [
        one for one in p.session.identity.second_senders.recent(now) if one.startswith(name)
    ]


# fmt: off
ENDED = Condition(
    "ended",
    lambda p, now: (
        (end := p.mission.outcome) and end.ending not in NO_FAILURE and (end.ending.value.upper(), end.reason)
    ),
    long="{found[0]}: {found[1]}",
)
NOT_FOLLOWING = Condition(
    "not_following", lambda p, now: not p.controller.vehicle.obedience.follows, steering=True,
    short="vehicle does not follow turn commands", over="vehicle follows turn commands again",
    long="VEHICLE DOES NOT FOLLOW turn commands: the flight ends after {p.settings.timing.unfollowed:g} s",
)
LIMIT_CYCLE = Condition(
    "limit_cycle", lambda p, now: (share := p.controller.vehicle.limit_cycle.share) < 1 and 100 * share,
    short="limit cycle, gains reduced to {found:.0f} %", repeats=True,
    long="LIMIT CYCLE: the turn command oscillates, gains reduced to {found:.0f} %",
)
CLOCK_SPEED = Condition(
    "clock_speed", lambda p, now: (speed := p.session.clock_speed.found) is not None and max(speed, 1e-3),
    short="autopilot clock at {found:.2g} times our speed", over="autopilot clock at our speed",
    long='CLOCK: autopilot time runs {found:.2g} times as fast as ours: for a simulator set link.clock = "autopilot"',
)
NOT_RECORDING = Condition("not_recording", long="NOT RECORDING: {found}")
"""Condition that the recorder detects, because it depends on the disk in flight, which a replay
cannot reproduce."""
EXTRA_STOPPED = Condition("extra_stopped", long="{found}")
"""Condition that `Onlookers` detects."""

TABLE = (
    *(
        Condition(
            f"second_sender_{key}",
            _second_sender(name),
            short=f"{name}: second sender rejected", long="{found[0]}",
        )
        for key, name in (("vehicle", VEHICLE_NAME), ("companion", OUR_NAME), ("radio", RADIO_NAME))
    ),
    Condition(
        "flood", lambda p, now: p.allowance.flooded(now) and p.allowance.dropped / 1000,
        short="network flood: unknown senders ignored", over="network flood over",
        long="FLOOD: unknown senders are ignored, {found:.0f} kB so far",
    ),
    Condition(
        "second_controller", lambda p, now: p.second_controller.evidence(now),
        short="another program also steers", over="another program no longer steers",
        long="SECOND CONTROLLER: {found}: stop the other program",
    ),
    ENDED,
    Condition(
        "link_silent", lambda p, now: SILENT < (age := p.session.heartbeat_age(now)) < inf and age,
        short="link silent", over="link restored", long="LINK SILENT for {found:.1f} s",
    ),
    Condition(
        "uplink_silent",
        lambda p, now: p.session.timesync.silent(now, UPLINK_SILENT) and p.session.heartbeat_age(now) <= SILENT,
        long="UPLINK SILENT: the vehicle does not answer TIMESYNC, and may not receive setpoints", steering=True,
    ),
    Condition(
        "link_too_slow",
        lambda p, now: p.mission.begun and (age := p.tracker.one_way) > p.settings.timing.stale and (2 * age, age),
        long="LINK TOO SLOW: round trip {found[0]:.1f} s, ranges may be {found[1]:.1f} s old and are rejected",
    ),
    Condition(
        "holding",
        lambda p, now: (
            p.mission.phase is Phase.HOLDING and (p.tracker.age(now), p.settings.timing.stale + p.mission.hold)
        ),
        short="range lost, holding", over="range regained", steering=True,
        long="RANGE STALE {found[0]:.1f} s: holding the circle's turn rate with {p.rates.newest.setpoints:.0f} "
        "setpoints per second, the flight ends after {found[1]:g} s without a range",
    ),
    Condition(
        "range_stale",
        lambda p, now: (
            p.mission.phase is not Phase.HOLDING
            and (age := p.tracker.age(now) or 0.0) > p.settings.timing.stale and age
        ),
        long="RANGE STALE {found:.1f} s",
    ),
    Condition(
        "range_frozen", lambda p, now: p.tracker.noise.repeated,
        short="range frozen, rejected", over="range accepted again",
        long="RANGE FROZEN: the same value for {found:.0f} s, ranges are rejected until it changes",
    ),
    Condition(
        "range_jumped", lambda p, now: p.tracker.jumps.found,
        short="range jumped, rejected", over="range jumped back", steering=True,
        long="RANGE JUMPED by {found:+.0f} m, farther than the vehicle can have flown: ranges are rejected",
    ),
    Condition(
        "range_rate_dropped", lambda p, now: p.tracker.rates.trouble,
        short="range rate wrong, not used", over="range rate used again", long="RANGE RATE NOT USED: {found}",
    ),
    Condition(
        "gps_lost",
        lambda p, now: p.gps_loss.changed_at is not None and [p.gps_loss.failure or NO_PLACE],
        long="GPS LOST: flown by attitude, {found[0]}. At the end the exit action is {p.exit_name}; "
        "without setpoints the copter levels and drifts with the wind",
    ),
    NOT_FOLLOWING,
    LIMIT_CYCLE,
    Condition(
        "lean_limit",
        lambda p, now: (lean := p.controller.vehicle.lean_limit).share < 1 and (lean.share, degrees(atan(lean.found / GRAVITY))),
        short="lean limit {found[1]:.0f} deg, speed cut to {p.controller.speed:.1f} m/s", repeats=True,
        long="LEAN LIMIT: the copter leans {found[1]:.0f} deg at most, too little for {p.settings.orbit.speed:g} m/s "
        "in this wind: speed reduced to {p.controller.speed:.1f} m/s",
    ),
    Condition(
        "drift_too_strong", lambda p, now: p.drift_alarm.on and p.drift_alarm,
        short="drift {found.drift:.1f} m/s, circle allows {found.allowed:.1f} m/s", over="drift within limit again",
        long="DRIFT TOO STRONG: {found.drift:.1f} m/s by wind or target, circle allows {found.allowed:.1f} m/s",
    ),
    Condition(
        "bound_not_watched", lambda p, now: (why := unwatched(p.settings, p.session, now)) and why.split(": "),
        short="{found[0]}", over="bounds checked again", steering=True, repeats=True,
        long="BOUND NOT CHECKED: {found[0]}: {found[1]}",
    ),
    Condition(
        "most_ranges_rejected",
        # If a link delivers every range three times, two thirds are rejected as duplicates, but
        # none is lost.
        lambda p, now: (
            (one := p.rates.whole) and one.refused > MOST_REJECTED * one.ranges
            and one.taken < MOST_REJECTED * p.settings.ranging.rate_hz and one
        ),
        long="MOST RANGES REJECTED: {found.refused:.1f} of {found.ranges:.1f} per second",
    ),
    Condition(
        "sensor_clock_stepped", lambda p, now: p.tracker.ranging.clock.doubted,
        short="sensor clock stepped", over="sensor clock steady again",
        long="SENSOR CLOCK stepped: ranges are rejected until it is steady again",
    ),
    CLOCK_SPEED,
    *(
        Condition(
            f"no_{name}", _lost(name), steering=True,
            short=f"no {name}", over=f"{name} received again", long=long,
        )
        for name, long in LOST.items()
    ),
    Condition(
        "heading_jumped", lambda p, now: round(degrees(p.session.motion.jumped)), repeats=True,
        short="heading jumped by {found:+d} deg", over="heading jumped back",
        long="HEADING JUMPED by {found:+d} deg: the jump does not count as a turn, check the compass",
    ),
    Condition(
        "altitude_lost", lambda p, now: p.tracker.height.is_held(now) and [p.tracker.height.at(now)],
        short="altitude not received", over="altitude received again",
        long="ALTITUDE NOT RECEIVED: height above the target held at {found[0]:.1f} m",
    ),
    Condition(
        "altitude_jumped", lambda p, now: p.tracker.height.jump, repeats=True,
        short="altitude jumped by {found:+.1f} m", over="altitude jumped back",
        long="ALTITUDE JUMPED by {found:+.1f} m: not applied to the height above the target, compare the radius with "
        "the map",
    ),
    Condition(
        "few_setpoints",
        lambda p, now: (
            p.flies and (rates := p.rates.while_steering)
            and rates.setpoints < FEW_SETPOINTS * (wanted := 1 / p.settings.timing.tick) and (rates.setpoints, wanted)
        ),
        long="FEW SETPOINTS: only {found[0]:.1f} of {found[1]:.0f} per second are sent: the computer is overloaded, "
        "stop other programs or lower limits.tick_hz",
    ),
    # not alarms: only sent to ground stations
    Condition("range_noise", lambda p, now: p.tracker.noise.found, NOISE, severity=NOTICE),
    Condition("low_range_noise", lambda p, now: p.tracker.noise.lowered, NOISE, severity=NOTICE),
    Condition(
        "range_sources",
        lambda p, now: not p.tracker.ranging.sender_stays and p.tracker.ranging.sources.short_choice(now),
        short="{found}", over="one range source", repeats=True, severity=NOTICE,
    ),
    Condition(
        "airspeed_implausible", lambda p, now: (speed := p.path.implausible_airspeed) is not None and [speed],
        short="airspeed {found[0]:.1f} m/s implausible, ignored", once=True, steering=True, severity=NOTICE,
    ),
    Condition(
        "bank_limit",
        lambda p, now: (
            (turn := p.controller.vehicle.bank_limit.bank) < inf and p.own
            and degrees(atan(turn * p.own.airspeed / GRAVITY))
        ),
        short="vehicle banks {found:.0f} deg at most", once=True, severity=NOTICE,
    ),
    Condition(
        "next_circle", lambda p, now: p.controller.circle is not p.settings.orbit and id(p.controller.circle),
        short="next circle, {p.controller.circle.label}", repeats=True, severity=NOTICE,
    ),
    Condition("law", lambda p, now: p.flies and p.law, "{p.why}", repeats=True, severity=NOTICE),
)
"""All conditions that the pilot itself detects, the worst first."""
# fmt: on
