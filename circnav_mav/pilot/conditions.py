"""The conditions of a flight that the operator has to know: one table for display, page, STATUSTEXT and verdict.

`Conditions` evaluates the table after each step. The texts of alarms are `alarms`; texts for ground stations are sent
once as a condition begins and once as it ends. Extras have rows of their own and report them by `Onlooker.alarms`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import atan, degrees, inf
from typing import TYPE_CHECKING

from pymavlink.dialects.v20.all import MAV_SEVERITY_NOTICE as NOTICE
from pymavlink.dialects.v20.all import MAV_SEVERITY_WARNING as WARNING

from circnav_mav.guidance.types import Orbit
from circnav_mav.mav.frames import GRAVITY
from circnav_mav.mav.identity import OUR_NAME, RADIO_NAME, VEHICLE_NAME
from circnav_mav.pilot.authority import SILENT, unwatched
from circnav_mav.pilot.mission_state import Ending, Phase

if TYPE_CHECKING:
    from circnav_mav.pilot.pilot import Pilot

MOST_REJECTED = 0.5
"""Share of the ranges above which rejected ones are an alarm."""
FEW_SETPOINTS = 0.5
"""Share of the setpoints of `limits.tick_hz` below which a steered vehicle gets too few."""
NOISE = "range noise {measured:.2g} m, expected {expected:.2g} m"

Values = Mapping[str, object]
"""The values in the texts of a condition, by name."""


@dataclass(frozen=True)
class Condition:
    """A row of the table.

    name: stable key, in summary.json too. active: function from pilot and time to the values of the texts, None while
    the condition is not active. short: STATUSTEXT as it begins, at most 41 characters, empty for none. long: text of
    the alarm on display, page and verdict, empty for a condition that is no alarm. over: STATUSTEXT as it ends. again:
    name of a value whose change is sent, too. once: True to send the text once in a flight. steering: True if the
    condition exists only while the vehicle is steered, and ends without a text when that ends.
    """

    name: str
    active: Callable[["Pilot", float], Values | None] = lambda pilot, now: None
    short: str = ""
    long: str = ""
    over: str = ""
    severity: int = WARNING
    again: str = ""
    once: bool = False
    steering: bool = False

    def alarm(self, **values: object) -> dict[str, str]:
        """Return the alarm by its name."""
        return {self.name: self.long.format(**values)}


class Conditions:
    """The active conditions of one flight, and their texts for ground stations."""

    def __init__(self, say: Callable[..., None]) -> None:
        """say: function of a kind, a text and a severity that sends the text."""
        self._say = say
        self._active: dict[str, Values] = {}
        self._sent: dict[str, object] = {}
        """The value of `again` with which each text was sent last."""

    @property
    def alarms(self) -> dict[str, str]:
        """The texts of the alarms, by name, the worst first."""
        rows = (row for row in TABLE if row.long and row.name in self._active)
        return {row.name: row.long.format(**self._active[row.name]) for row in rows}

    def update(self, pilot: "Pilot", now: float) -> None:
        """Evaluate the table, and send the texts of what has begun or ended."""
        for row in TABLE:
            hidden = (row.steering and not pilot.mission.steering) or (pilot.done and row is not ENDED)
            values = None if hidden else row.active(pilot, now)
            if values is not None:
                self._active[row.name] = values
                self._send_news(row, values)
            elif row.name in self._active:
                self.forget(row)
                if row.over and not hidden:
                    self._say(row.name, row.over, severity=NOTICE)

    def _send_news(self, row: Condition, values: Values) -> None:
        news = values.get(row.again, True)
        if row.short and self._sent.get(row.name) != news:
            self._sent[row.name] = news
            self._say(row.name, row.short.format(**values), severity=row.severity)

    def forget(self, row: Condition) -> None:
        """Forget that a condition was active: no text is sent for its end."""
        self._active.pop(row.name, None)
        if not row.once:
            self._sent.pop(row.name, None)


def circle(orbit: Orbit) -> str:
    """Describe a circle, short enough for a STATUSTEXT."""
    return f"{orbit.radius:g} m {orbit.direction.value}"


# --- conditions that need more than one expression -------------------------------------------------------------------


def _second_sender(name: str) -> Callable[["Pilot", float], Values | None]:
    def active(pilot: "Pilot", now: float) -> Values | None:
        lines = pilot.session.identity.rivals.recent(now)
        return next(({"line": line} for line in lines if line.startswith(f"{name} has ")), None)

    return active


def _ended(pilot: "Pilot", now: float) -> Values | None:
    outcome = pilot.mission.outcome
    if outcome is None or outcome.ending is Ending.COMPLETED:
        return None
    return {"ending": outcome.ending.value.upper(), "reason": outcome.reason}


def _range_stale(pilot: "Pilot", now: float) -> Values | None:
    age = pilot.tracker.age(now)
    stale = age is not None and age > pilot.settings.timing.stale and pilot.mission.phase is not Phase.HOLDING
    return {"age": age} if stale else None


def _holding(pilot: "Pilot", now: float) -> Values | None:
    if pilot.mission.phase is not Phase.HOLDING:
        return None
    timing, rates = pilot.settings.timing, pilot.rates.whole
    flow = "" if rates is None else f" by {rates.setpoints:.0f} setpoints per second"
    return {"age": pilot.tracker.age(now) or 0.0, "flow": flow, "ends": timing.stale + pilot.mission.hold}


def _lean_limit(pilot: "Pilot", now: float) -> Values | None:
    lean = pilot.controller.lean
    if lean.share >= 1:
        return None
    angle = degrees(atan(lean.found / GRAVITY))
    return {"angle": angle, "wanted": pilot.settings.orbit.speed, "speed": pilot.controller.speed, "share": lean.share}


def _bank_limit(pilot: "Pilot", now: float) -> Values | None:
    limit, own = pilot.controller.bank_limit, pilot.own
    return None if limit is None or own is None else {"bank": degrees(atan(limit * own.airspeed / GRAVITY))}


def _unwatched(pilot: "Pilot", now: float) -> Values | None:
    why = unwatched(pilot.settings, pilot.session, now)
    return {"missing": why.partition(":")[0], "why": why} if why else None


def _most_rejected(pilot: "Pilot", now: float) -> Values | None:
    rates = pilot.rates.whole
    if rates is None or rates.refused <= MOST_REJECTED * (rates.taken + rates.refused):
        return None
    return {"rejected": rates.refused, "all": rates.taken + rates.refused}


def _few_setpoints(pilot: "Pilot", now: float) -> Values | None:
    rates, wanted = pilot.rates.while_steering, 1 / pilot.settings.timing.tick
    if rates is None or not pilot.flies or rates.setpoints >= FEW_SETPOINTS * wanted:
        return None
    return {"sent": rates.setpoints, "wanted": wanted}


def _range_sources(pilot: "Pilot", now: float) -> Values | None:
    ranging = pilot.tracker.ranging
    choice = "" if ranging.sender_stays else ranging.sources.short_choice(now)
    return {"choice": choice} if choice else None


def _next_circle(pilot: "Pilot", now: float) -> Values | None:
    orbit = pilot.controller.orbit
    return None if orbit is pilot.settings.orbit else {"orbit": id(orbit), "circle": circle(orbit)}


def _noise(found: tuple[float, float] | None) -> Values | None:
    return None if found is None else {"expected": found[0], "measured": found[1]}


# --- the table --------------------------------------------------------------------------------------

# fmt: off
ENDED = Condition("ended", _ended, long="{ending}: {reason}")
NOT_FOLLOWING = Condition(
    "not_following", lambda p, now: None if p.controller.turns.follows else {"ends": p.settings.timing.unfollowed},
    short="vehicle does not follow turn commands", over="vehicle follows turn commands again", steering=True,
    long="VEHICLE DOES NOT FOLLOW turn commands: ends after {ends:g} s",
)
LIMIT_CYCLE = Condition(
    "limit_cycle", lambda p, now: {"share": 100 * turns.share} if (turns := p.controller.turns).share < 1 else None,
    short="limit cycle, gains reduced to {share:.0f} %", again="share",
    long="LIMIT CYCLE: the turn command oscillates, gains reduced to {share:.0f} %",
)
CLOCK_SPEED = Condition(
    "clock_speed", lambda p, now: None if (speed := p.session.clock_speed.found) is None else {"speed": speed},
    short="autopilot clock at {speed:.2g} times our speed", over="autopilot clock at our speed",
    long='CLOCK: autopilot time runs {speed:.2g} times as fast as ours: for a simulator set link.clock = "autopilot"',
)
NOT_RECORDING = Condition("not_recording", long="NOT RECORDING: {problem}")
"""Raised beside the pilot by the recorder: a replay does not have its disk."""
EXTRA_STOPPED = Condition("extra_stopped", long="{problem}")
"""Raised for onlookers that have failed."""

TABLE = (
    *(
        Condition(f"second_sender_{key}", _second_sender(name), f"{name}: second sender rejected", "{line}")
        for key, name in (("vehicle", VEHICLE_NAME), ("companion", OUR_NAME), ("radio", RADIO_NAME))
    ),
    Condition(
        "flood", lambda p, now: {"size": p.allowance.dropped / 1000} if p.allowance.flooded(now) else None,
        short="network flood: unknown senders ignored", over="network flood over",
        long="FLOOD: unknown senders are ignored, {size:.0f} kB so far",
    ),
    Condition(
        "second_controller", lambda p, now: {"shows": words} if (words := p.second_controller.evidence(now)) else None,
        short="another program steers, too", over="another program no longer steers",
        long="SECOND CONTROLLER: {shows}: stop the other program",
    ),
    ENDED,
    Condition(
        "yielded", lambda p, now: {"mode": p.session.vehicle.mode_name} if p.mission.phase is Phase.YIELDED else None,
        long="OPERATOR HAS THE VEHICLE, mode {mode}",
    ),
    Condition(
        "link_silent", lambda p, now: {"age": age} if SILENT < (age := p.session.heartbeat_age(now)) < inf else None,
        short="link silent", over="link restored", long="LINK SILENT for {age:.1f} s",
    ),
    Condition(
        "holding", _holding, short="range lost, holding", over="range regained", steering=True,
        long="RANGE STALE {age:.1f} s: holding the circle's turn rate{flow}, ends at {ends:g} s",
    ),
    Condition("range_stale", _range_stale, long="RANGE STALE {age:.1f} s"),
    Condition(
        "range_frozen", lambda p, now: {"time": time} if (time := p.tracker.noise.repeated) else None,
        short="range frozen, rejected", over="range accepted again",
        long="RANGE FROZEN: the same number for {time:.0f} s, ranges are rejected until it changes",
    ),
    Condition(
        "range_rate_dropped", lambda p, now: {"why": why} if (why := p.tracker.rates.trouble) else None,
        short="range rate wrong, dropped", over="range rate used again", long="RANGE RATE DROPPED: {why}",
    ),
    NOT_FOLLOWING,
    LIMIT_CYCLE,
    Condition(
        "lean_limit", _lean_limit, short="leans {angle:.0f} deg at most, speed {speed:.1f} m/s", again="share",
        long="LEAN LIMIT: the copter leans {angle:.0f} deg at most, too little for {wanted:g} m/s in this wind: "
        "speed {speed:.1f} m/s",
    ),
    Condition(
        "drift_too_strong", lambda p, now: p.drift_alarm._asdict() if p.drift_alarm.on else None,
        short="drift {drift:.1f} m/s, this circle allows {allowed:.1f}", over="drift within the limit of this circle",
        long="DRIFT TOO STRONG: drift {drift:.1f} m/s, this circle allows {allowed:.1f}",
    ),
    Condition(
        "bound_not_watched", _unwatched, short="{missing}", over="bounds watched again", again="why", steering=True,
        long="BOUND NOT WATCHED: {why}",
    ),
    Condition(
        "most_ranges_rejected", _most_rejected, long="MOST RANGES REJECTED: {rejected:.1f} of {all:.1f} per second",
    ),
    Condition(
        "sensor_clock_stepped", lambda p, now: {} if p.tracker.ranging.clock.doubted else None,
        short="sensor clock stepped", over="sensor clock runs steadily again",
        long="SENSOR CLOCK stepped: ranges are rejected until it runs steadily again",
    ),
    CLOCK_SPEED,
    Condition(
        "altitude_lost", lambda p, now: None if (m := p.tracker.height.held(now)) is None else {"height": m},
        short="altitude not received", over="altitude received again",
        long="ALTITUDE NOT RECEIVED: height above the target held at {height:.1f} m",
    ),
    Condition(
        "altitude_jumped", lambda p, now: {"jump": jump} if (jump := p.tracker.height.jump) else None,
        short="altitude jumped by {jump:+.1f} m", over="altitude jumped back", again="jump",
        long="ALTITUDE JUMPED by {jump:+.1f} m, not counted as height: compare the radius with the map",
    ),
    Condition(
        "few_setpoints", _few_setpoints,
        long="FEW SETPOINTS: {sent:.1f} of {wanted:.0f} per second are sent: the computer is overloaded, stop other "
        "programs or lower limits.tick_hz",
    ),
    # --- no alarms: only sent to ground stations
    Condition("range_noise", lambda p, now: _noise(p.tracker.noise.found), NOISE, severity=NOTICE),
    Condition("low_range_noise", lambda p, now: _noise(p.tracker.noise.lowered), NOISE, severity=NOTICE),
    Condition("range_sources", _range_sources, "{choice}", over="one range source", again="choice", severity=NOTICE),
    Condition(
        "airspeed_implausible",
        lambda p, now: None if (speed := p.path.implausible_airspeed) is None else {"speed": speed},
        short="airspeed {speed:.1f} m/s implausible, ignored", once=True, steering=True, severity=NOTICE,
    ),
    Condition("bank_limit", _bank_limit, "vehicle banks {bank:.0f} deg at most", once=True, severity=NOTICE),
    Condition("next_circle", _next_circle, "next circle, {circle}", again="orbit", severity=NOTICE),
    Condition(
        "law", lambda p, now: {"law": p.law, "why": p.why} if p.law and p.flies else None,
        short="{why}", again="law", severity=NOTICE,
    ),
)
"""All conditions that a pilot finds by itself, the worst first."""
# fmt: on
