"""Conditions of a flight that the operator must be informed of: one table for display, page,
STATUSTEXT and verdict.

`Conditions` evaluates the table after each step. It sends texts to ground stations once when a
condition begins and once when it ends. `alarms` holds the current texts. Extras report their own
conditions by `Listener.alarms`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import degrees, hypot

from pymavlink.dialects.v20.all import MAV_SEVERITY_NOTICE as NOTICE
from pymavlink.dialects.v20.all import MAV_SEVERITY_WARNING as WARNING

from circnav_mav.guidance.limits import SHORT
from circnav_mav.mav.identity import OUR_NAME, RADIO_NAME, VEHICLE_NAME
from circnav_mav.mav.statustext import Announcer
from circnav_mav.pilot.authority import SILENT
from circnav_mav.pilot.mission_state import NO_FAILURE, Phase
from circnav_mav.pilot.step_view import StepView

MOST_REJECTED = 0.5
"""An alarm is raised if more than this share of the ranges is rejected, and accepted ranges arrive
at less than this share of `ranging.rate_hz`."""
LOST = {
    "attitude": (
        "NO ATTITUDE from the vehicle: steered by ranges alone, no check that it follows turn"
        " commands"
    ),
    "airspeed": "NO AIRSPEED from the vehicle: vehicle.speed_mps is used instead",
    "altitude": "NO ALTITUDE from the vehicle: no climb is commanded",
}
"""Alarms for telemetry that a steered vehicle no longer sends."""
ATTITUDE_RATE_LOW = (
    "ATTITUDE RATE LOW from the vehicle: extrapolated by body rates, no check that it follows turn"
    " commands: raise the rate of ATTITUDE to 10 Hz (ArduPilot: SRn_EXTRA1, PX4: MAV_n_RATE)"
)


@dataclass(frozen=True, slots=True)
class Active:
    """An active condition.

    short: STATUSTEXT at the beginning of the condition, at most 41 characters, empty for none.
    long: text of the alarm on display, live page and verdict, empty if the condition is no alarm.
    key: `short` is sent again when this value changes.
    """

    short: str = ""
    long: str = ""
    key: object = True


@dataclass(frozen=True)
class Condition:
    """A row of the table.

    name: stable key, also in summary.json.
    find: returns the texts of the condition, or None while it is not active.
    over: STATUSTEXT at the end of the condition.
    severity: severity of the STATUSTEXT at the beginning.
    once: True to send the texts once per flight.
    steering: True if the condition exists only while the vehicle is steered. The end of steering
        then ends the condition without a text.
    by_stall: True if a stall of this computer causes the condition too. The condition is then
        hidden, because the stall itself is reported.
    """

    name: str
    find: Callable[[StepView], Active | None]
    over: str = ""
    severity: int = WARNING
    once: bool = False
    steering: bool = False
    by_stall: bool = False


class Conditions:
    """The active conditions of one flight, and their texts for ground stations."""

    def __init__(self, announcer: Announcer) -> None:
        self._say = announcer.say
        self._active: dict[str, Active] = {}
        self._sent: dict[str, object] = {}
        """`Active.key` at the time when the text was last sent, by name of the condition."""

    @property
    def alarms(self) -> dict[str, str]:
        """Texts of the active alarms, by name, the worst first."""
        found = ((row.name, self._active.get(row.name)) for row in TABLE)
        return {name: active.long for name, active in found if active is not None and active.long}

    def update(self, view: StepView) -> None:
        """Evaluate the table, and send texts for the conditions that have begun or ended."""
        steering = view.steering
        done = view.done
        for row in TABLE:
            hidden = row.steering and not steering
            hidden |= done and row is not ENDED
            hidden |= row.by_stall and view.stalled > 0
            active = None if hidden else row.find(view)
            if active is not None:
                self._active[row.name] = active
                if active.short and self._sent.get(row.name) != active.key:
                    self._sent[row.name] = active.key
                    self._say(row.name, active.short, severity=row.severity)
            elif row.name in self._active:
                self.forget(row)
                if row.over and not hidden:
                    self._say(row.name, row.over, severity=NOTICE)

    def forget(self, row: Condition) -> None:
        """Mark a condition as not active, without a text for its end."""
        self._active.pop(row.name, None)
        if not row.once:
            self._sent.pop(row.name, None)


# --- sender and link


def _second_sender(name: str) -> Callable[[StepView], Active | None]:
    def find(view: StepView) -> Active | None:
        lines = [line for line in view.second_senders if line.startswith(name)]
        return Active(f"{name}: second sender rejected", lines[0]) if lines else None

    return find


def _flood(view: StepView) -> Active | None:
    if not view.flood:
        return None
    return Active(
        "network flood: unknown senders ignored",
        f"FLOOD: unknown senders are ignored, {view.flood:.0f} kB so far",
    )


def _second_controller(view: StepView) -> Active | None:
    if not view.second_controller:
        return None
    return Active(
        "another program also steers",
        f"SECOND CONTROLLER: {view.second_controller}: stop the other program",
    )


def _ended(view: StepView) -> Active | None:
    outcome = view.outcome
    if outcome is None or outcome.ending in NO_FAILURE:
        return None
    return Active(long=f"{outcome.ending.value.upper()}: {outcome.reason}")


def _stalled(view: StepView) -> Active | None:
    if not view.stalled or view.engaged_at is None:
        return None
    return Active(
        f"computer stalled for {view.stalled:.1f} s",
        f"COMPUTER STALLED for {view.stalled:.1f} s, in which nothing was sent: stop other"
        " programs, and keep the computer awake",
    )


def _link_silent(view: StepView) -> Active | None:
    age = view.link_age
    if age is None or age <= SILENT:
        return None
    return Active("link silent", f"LINK SILENT for {age:.1f} s")


def _uplink_silent(view: StepView) -> Active | None:
    age = view.link_age
    if not view.uplink_silent or age is None or age > SILENT:
        return None
    return Active(
        long="UPLINK SILENT: the vehicle does not answer TIMESYNC, and may not receive setpoints"
    )


def _link_too_slow(view: StepView) -> Active | None:
    age = view.one_way
    if view.engaged_at is None or age <= view.settings.stale:
        return None
    return Active(
        long=f"LINK TOO SLOW: round trip {2 * age:.1f} s, ranges may be {age:.1f} s old and are"
        " rejected"
    )


# --- ranges


def _coasting(view: StepView) -> Active | None:
    if view.phase is not Phase.COASTING:
        return None
    rate = view.rates.setpoints if view.rates is not None else 0.0
    return Active(
        "range lost, coasting",
        f"RANGE STALE {view.range_age or 0.0:.1f} s: holding the circle's turn rate with"
        f" {rate:.0f} setpoints per second, the flight ends after"
        f" {view.settings.stale + view.coast:g} s without a range",
    )


def _range_stale(view: StepView) -> Active | None:
    age = view.range_age or 0.0
    if view.phase is Phase.COASTING or age <= view.settings.stale:
        return None
    return Active(long=f"RANGE STALE {age:.1f} s")


def _range_frozen(view: StepView) -> Active | None:
    if not view.frozen_for:
        return None
    return Active(
        "range frozen, rejected",
        f"RANGE FROZEN: the same value for {view.frozen_for:.0f} s, ranges are rejected until it"
        " changes",
    )


def _range_jumped(view: StepView) -> Active | None:
    if not view.jumped_by:
        return None
    return Active(
        "range jumped, rejected",
        f"RANGE JUMPED by {view.jumped_by:+.0f} m, farther than the vehicle can have flown: ranges"
        " are rejected",
    )


def _range_rate_dropped(view: StepView) -> Active | None:
    if not view.range_rate_trouble:
        return None
    return Active("range rate wrong, not used", f"RANGE RATE NOT USED: {view.range_rate_trouble}")


def _most_ranges_rejected(view: StepView) -> Active | None:
    rates = view.full_rates
    # No alarm while enough ranges are accepted. A link that delivers every range three times causes
    # two thirds of rejections, but loses no range.
    if (
        rates is None
        or rates.refused <= MOST_REJECTED * rates.ranges
        or rates.taken >= MOST_REJECTED * view.settings.ranging.rate_hz
    ):
        return None
    return Active(
        long=f"MOST RANGES REJECTED: {rates.refused:.1f} of {rates.ranges:.1f} per second"
    )


def _sensor_clock_stepped(view: StepView) -> Active | None:
    if not view.sensor_clock_doubted:
        return None
    return Active(
        "sensor clock stepped",
        "SENSOR CLOCK stepped: ranges are rejected until it is steady again",
    )


def _range_noise(view: StepView) -> Active | None:
    return _noise(view.noise_found)


def _low_range_noise(view: StepView) -> Active | None:
    return _noise(view.noise_lowered)


def _noise(found: tuple[float, float] | None) -> Active | None:
    if found is None:
        return None
    reported, used = found
    return Active(f"range noise {used:.2g} m, expected {reported:.2g} m")


def _range_sources(view: StepView) -> Active | None:
    choice = view.source_choice
    return Active(choice, key=choice) if choice else None


# --- vehicle


def _not_airborne(view: StepView) -> Active | None:
    needed = view.not_airborne
    return Active(f"waits: {needed}", key=needed) if needed else None


def _gps_lost(view: StepView) -> Active | None:
    if view.method_failure is None:
        return None
    state = view.method_failure or "the autopilot holds no place now"
    return Active(
        long=f"GPS LOST: flown by attitude, {state}. At the end the exit action is"
        f" {view.exit_name}; without setpoints the copter levels and drifts with the wind"
    )


def _not_following(view: StepView) -> Active | None:
    if view.follows:
        return None
    return Active(
        "vehicle does not follow turn commands",
        "VEHICLE DOES NOT FOLLOW turn commands: the flight ends after"
        f" {view.settings.file.limits.not_following_s:g} s in which it does not turn along its"
        " circle",
    )


def limit_cycle_alarm(share: float) -> str:
    """Return the alarm for a limit cycle. share: present gains over the original gains."""
    return f"LIMIT CYCLE: the turn command oscillates, gains reduced to {100 * share:.0f} %"


def _limit_cycle(view: StepView) -> Active | None:
    share = view.gain_share
    if share >= 1:
        return None
    return Active(
        f"limit cycle, gains reduced to {100 * share:.0f} %", limit_cycle_alarm(share), key=share
    )


def _lean_limit(view: StepView) -> Active | None:
    share = view.lean_share
    if share >= 1:
        return None
    lean = degrees(view.lean_limit)
    return Active(
        f"lean limit {lean:.0f} deg, speed cut to {view.speed:.1f} m/s",
        f"LEAN LIMIT: the copter leans {lean:.0f} deg at most, too little for"
        f" {view.circle.speed:g} m/s in this wind: speed reduced to {view.speed:.1f} m/s",
        key=(share, lean),
    )


def _airspeed_sensor(view: StepView) -> Active | None:
    alarm = view.airspeed_alarm
    if not alarm.on:
        return None
    error = f"{abs(alarm.change):.0f} m/s too {'high' if alarm.change > 0 else 'low'}"
    return Active(
        f"airspeed reads {error}",
        f"AIRSPEED SENSOR reads about {error}: the estimated drift turns with the nose, check pitot"
        " tube and calibration",
    )


def _accelerometer(view: StepView) -> Active | None:
    if not view.failed_imu:
        return None
    if view.used_imu:
        instead = f"{view.used_imu} is used, check the IMUs before the next flight"
    else:
        instead = "no other IMU is received, a copter without GPS cannot measure its airspeed"
    return Active(
        f"accelerometer of {view.failed_imu} failed",
        f"ACCELEROMETER of {view.failed_imu} repeats its value, or measures no gravity: {instead}",
        key=view.failed_imu,
    )


def _wind_too_strong(view: StepView) -> Active | None:
    alarm = view.drift_alarm
    # A wrong airspeed or wrong ranges look like a drift, and have alarms of their own.
    if not alarm.on or view.airspeed_alarm.on or view.lap_alarm.on:
        return None
    drift = f"{alarm.drift:.1f} m/s"
    allowed = f"circle allows {alarm.allowed:.1f} m/s"
    return Active(
        f"wind {drift}, {allowed}",
        f"WIND TOO STRONG: {drift} (wind minus the target's motion), {allowed}",
    )


def _not_closing(view: StepView) -> Active | None:
    alarm = view.closing_alarm
    if not alarm.on or view.drift_alarm.on:
        return None
    wind = "" if alarm.drift is None else f"wind {alarm.drift:.0f}, "
    speeds = f"{wind}airspeed {alarm.airspeed:.0f} m/s"
    return Active(
        f"not closing, {speeds}",
        f"NOT CLOSING ON TARGET: {alarm.r:.0f} m from the target ({speeds}): fly faster, or end"
        " the flight",
    )


def _radius_mismatch(view: StepView) -> Active | None:
    alarm = view.lap_alarm
    if not alarm.on or view.airspeed_alarm.on:
        return None
    height = view.height or 0.0
    off = hypot(alarm.by_ranges, height) - hypot(alarm.by_turns, height)
    return Active(
        f"radius {alarm.by_turns:.0f} m by turns, {alarm.by_ranges:.0f} m by range",
        f"RADIUS MISMATCH: {alarm.by_turns:.0f} m by airspeed and turns,"
        f" {alarm.by_ranges:.0f} m by ranges. The radio may measure {abs(off):.0f} m too"
        f" {'long' if off > 0 else 'short'}: calibrate it, and check the height ({height:.0f} m)"
        " and the airspeed",
    )


def _bound_not_watched(view: StepView) -> Active | None:
    why = view.unchecked_bound
    if not why:
        return None
    return Active(why.partition(": ")[0], f"BOUND NOT CHECKED: {why}", key=why)


def clock_alarm(speed: float) -> str:
    """Return the alarm for an autopilot clock with a wrong speed. speed: autopilot seconds per
    second of our clock."""
    return (
        f"CLOCK: autopilot time runs {speed:.2g} times as fast as ours: for a simulator set"
        ' link.clock = "autopilot"'
    )


def _clock_speed(view: StepView) -> Active | None:
    if view.clock_speed is None:
        return None
    speed = max(view.clock_speed, 1e-3)
    return Active(f"autopilot clock at {speed:.2g} times our speed", clock_alarm(speed))


def _lost(name: str) -> Callable[[StepView], Active | None]:
    def find(view: StepView) -> Active | None:
        if name not in view.lost_reports:
            return None
        if name == "attitude" and view.heading is not None:
            return Active("attitude rarer than 1.3 Hz", ATTITUDE_RATE_LOW, key="rare")
        return Active(f"no {name}", LOST[name])

    return find


def _heading_jumped(view: StepView) -> Active | None:
    jump = round(degrees(view.heading_jump))
    if not jump:
        return None
    return Active(
        f"heading jumped by {jump:+d} deg",
        f"HEADING JUMPED by {jump:+d} deg: the jump does not count as a turn, check the compass",
        key=jump,
    )


def _altitude_lost(view: StepView) -> Active | None:
    height = view.height
    if not view.height_held or height is None:
        return None
    return Active(
        "altitude not received",
        f"ALTITUDE NOT RECEIVED: height above the target held at {height:.1f} m",
    )


def _altitude_jumped(view: StepView) -> Active | None:
    jump = view.altitude_jump
    if not jump:
        return None
    return Active(
        f"altitude jumped by {jump:+.1f} m",
        f"ALTITUDE JUMPED by {jump:+.1f} m: not applied to the height above the target, compare the"
        " radius with the map",
        key=jump,
    )


def _setpoint_rate_low(view: StepView) -> Active | None:
    rates = view.steered_rates
    wanted = 1 / view.settings.file.limits.tick
    # 0.5: share of the setpoint rate `limits.tick_hz` below which a steered vehicle receives too
    # few setpoints.
    if not view.flies or rates is None or rates.setpoints >= 0.5 * wanted:
        return None
    return Active(
        long=f"SETPOINT RATE LOW: only {rates.setpoints:.1f} of {wanted:.0f} per second are sent:"
        " the computer is overloaded, stop other programs or lower limits.tick_hz"
    )


def _airspeed_implausible(view: StepView) -> Active | None:
    if view.implausible_airspeed is None:
        return None
    return Active(f"airspeed {view.implausible_airspeed:.1f} m/s implausible, ignored")


def _bank_limit(view: StepView) -> Active | None:
    # A plane that reaches the mission's bank limit but for a few percent has no lower limit.
    if view.bank_limit > SHORT * view.settings.facts.max_bank:
        return None
    return Active(f"vehicle banks {degrees(view.bank_limit):.0f} deg at most")


def _next_circle(view: StepView) -> Active | None:
    if view.circle is view.settings.orbit:
        return None
    return Active(f"next circle, {view.circle.label}", key=id(view.circle))


def _law(view: StepView) -> Active | None:
    return Active(view.why, key=view.flown_law) if view.flies and view.flown_law else None


ENDED = Condition("ended", _ended)
NOT_FOLLOWING = Condition(
    "not_following", _not_following, over="vehicle follows turn commands again", steering=True
)

TABLE = (
    Condition("second_sender_vehicle", _second_sender(VEHICLE_NAME)),
    Condition("second_sender_companion", _second_sender(OUR_NAME)),
    Condition("second_sender_radio", _second_sender(RADIO_NAME)),
    Condition("flood", _flood, over="network flood over"),
    Condition("second_controller", _second_controller, over="another program no longer steers"),
    ENDED,
    Condition("stalled", _stalled),
    Condition("link_silent", _link_silent, over="link restored", by_stall=True),
    Condition("uplink_silent", _uplink_silent, steering=True, by_stall=True),
    Condition("link_too_slow", _link_too_slow, by_stall=True),
    Condition("coasting", _coasting, over="range regained", steering=True, by_stall=True),
    Condition("range_stale", _range_stale, by_stall=True),
    Condition("range_frozen", _range_frozen, over="range accepted again"),
    Condition("range_jumped", _range_jumped, over="range jumped back", steering=True),
    Condition("range_rate_dropped", _range_rate_dropped, over="range rate used again"),
    Condition("gps_lost", _gps_lost),
    NOT_FOLLOWING,
    Condition("limit_cycle", _limit_cycle),
    Condition("lean_limit", _lean_limit),
    Condition("airspeed_sensor", _airspeed_sensor, over="airspeed is right again", steering=True),
    Condition("accelerometer", _accelerometer, over="accelerometer works again"),
    Condition("wind_too_strong", _wind_too_strong, over="drift within limit again", steering=True),
    Condition("not_closing", _not_closing, over="comes nearer again", steering=True),
    Condition("radius_mismatch", _radius_mismatch, over="radius fits turns", steering=True),
    Condition("bound_not_watched", _bound_not_watched, over="bounds checked again", steering=True),
    Condition("most_ranges_rejected", _most_ranges_rejected, by_stall=True),
    Condition("sensor_clock_stepped", _sensor_clock_stepped, over="sensor clock steady again"),
    Condition("clock_speed", _clock_speed, over="autopilot clock at our speed"),
    *(
        Condition(
            f"no_{name}", _lost(name), over=f"{name} received again", steering=True, by_stall=True
        )
        for name in LOST
    ),
    Condition("heading_jumped", _heading_jumped, over="heading jumped back"),
    Condition("altitude_lost", _altitude_lost, over="altitude received again"),
    Condition("altitude_jumped", _altitude_jumped, over="altitude jumped back"),
    Condition("setpoint_rate_low", _setpoint_rate_low, by_stall=True),
    # not alarms: only sent to ground stations
    Condition("not_airborne", _not_airborne, severity=NOTICE),
    Condition("range_noise", _range_noise, severity=NOTICE),
    Condition("low_range_noise", _low_range_noise, severity=NOTICE),
    Condition("range_sources", _range_sources, over="one range source", severity=NOTICE),
    Condition(
        "airspeed_implausible", _airspeed_implausible, once=True, steering=True, severity=NOTICE
    ),
    Condition("bank_limit", _bank_limit, once=True, severity=NOTICE),
    Condition("next_circle", _next_circle, severity=NOTICE),
    Condition("law", _law, severity=NOTICE),
)
"""All conditions that `Pilot` itself detects, the worst first."""
