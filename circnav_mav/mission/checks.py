"""What can be said of a mission before anything flies: one line per fact, with the number and its bound."""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from math import degrees, hypot, inf, sqrt

from circnav_mav.core.laws import LAWS
from circnav_mav.core.radius_trim import MOST
from circnav_mav.core.slant import MAX_SIGMA_GROWTH
from circnav_mav.core.theory import settling_time, tolerated_drift
from circnav_mav.mav.autopilots.table import AUTOPILOTS, REFUSED, adapters
from circnav_mav.mav.ranging import DOWNWARD
from circnav_mav.mission.mission import Mission

LOOP_BOUND = 0.4
"""Bound on V |d omega/d r'| (turn lag + filter lag): from about .45 on the laws limit-cycle."""
PLANE_GAIN = 0.72
"""Realised over coordinated turn rate of a plane that slips in its turns (flown: .70 .. .75)."""
NEED_MOTION = frozenset({"drift", "unicycle"})
DRIFT_LAWS = frozenset({"auto", "drift"})
REACH = 0.8
"""Fraction of the farthest range that the circle may use."""
ROOM = 0.1
"""Fraction of the radius that should lie between the circle and the bounds of the range."""


class Grade(Enum):
    """How a check came out. FAIL refuses the flight."""

    PASS = "PASS"
    WARN = "WARN"
    FAIL = "FAIL"


@dataclass(frozen=True, slots=True)
class Check:
    """One line of the check."""

    grade: Grade
    subject: str
    says: str


def check_mission(mission: Mission) -> list[Check]:
    """All the lines for a mission."""
    return [
        line
        for part in (
            _keys,
            _vehicle,
            _estimator,
            _gain,
            _trim,
            _radius,
            _turn_rate,
            _reach,
            _bounds,
            _radio,
            _sampling,
            _delay,
            _noise,
            _slant,
            _drift,
            _signing,
        )
        for line in part(mission)
    ]


def _grade(value: float, *, warn_above: float, fail_above: float) -> Grade:
    return Grade.FAIL if value > fail_above else Grade.WARN if value > warn_above else Grade.PASS


def _keys(mission: Mission) -> Iterator[Check]:
    yield Check(Grade.PASS, "keys", "all keys known, none missing")


def _vehicle(mission: Mission) -> Iterator[Check]:
    autopilot, kind = mission.vehicle_key
    able = [one for one in AUTOPILOTS if autopilot in ("auto", one[0]) and one[1] == kind]
    if not able:
        reason = REFUSED.get((autopilot, kind), "there is no honest, position-free way to steer it over MAVLink")
        yield Check(Grade.FAIL, "vehicle", f"{autopilot} {kind} cannot be flown: {reason}")
        return
    yield Check(Grade.PASS, "vehicle", " or ".join(" ".join(one) for one in able))
    exits = mission.file.exit.action
    adapters_allowed = adapters(autopilot, kind, mission.pilot_settings().facts)
    lacking = [one.name for one in adapters_allowed if exits not in (None, "stop", *one.exits)]
    if lacking:
        yield Check(
            Grade.FAIL,
            "exit",
            f"{lacking[0]} knows no exit action {exits}: choose {', '.join(adapters_allowed[0].exits)}",
        )
    if autopilot == "px4" and (exits == "stop" or mission.file.engage.on_takeover == "wait"):
        yield Check(
            Grade.FAIL,
            "exit",
            "PX4 goes back to OFFBOARD by itself when setpoints resume: exit.action must command a mode, "
            'and engage.on_takeover must be "end"',
        )
    elif exits == "stop" and kind.startswith("plane"):
        yield Check(
            Grade.FAIL,
            "exit",
            "a plane left in its mode loiters 3 s later, banking hard at once: exit.action must command a mode, "
            f"choose {', '.join(adapters_allowed[0].exits)}",
        )


def _estimator(mission: Mission) -> Iterator[Check]:
    """An estimator that lives on own motion alone must see some before the vehicle is ours."""
    autopilot, kind = mission.vehicle_key
    if mission.estimator not in NEED_MOTION:
        return
    allowed = adapters(autopilot, kind, mission.pilot_settings().facts)
    if allowed and not any(one.measures_airspeed for one in allowed):
        yield Check(
            Grade.FAIL,
            "estimator",
            f"{mission.estimator} must see the vehicle's motion before it can be engaged, and a {kind} measures no "
            'airspeed: it is known only while we steer. Set guidance.estimator = "auto"',
        )


def _gain(mission: Mission) -> Iterator[Check]:
    law, gain, orbit = LAWS[mission.law.name], mission.law.gain, mission.orbit
    bound = law.gain_bound(orbit.speed, orbit.radius)
    grade = Grade.PASS if gain > bound else Grade.FAIL
    whose = "given" if mission.file.guidance.gain else "default"
    worth = f" = {bound:.4g}" if bound else ""
    yield Check(
        grade, "gain", f"{law.name}: k = {gain:.4g} {law.gain_unit} ({whose}), needs {law.gain_condition}{worth}"
    )


def _trim(mission: Mission) -> Iterator[Check]:
    """A trim feeds the law a smaller radius than the mission's, for which its gain must do as well."""
    law, gain, orbit = LAWS[mission.law.name], mission.law.gain, mission.orbit
    least = (1 - MOST) * orbit.radius
    bound = law.gain_bound(orbit.speed, least)
    if mission.file.guidance.radius_trim_per_s > 0 and law.gain_bound(orbit.speed, orbit.radius) < gain <= bound:
        yield Check(
            Grade.WARN,
            "trim",
            f"guidance.radius_trim_per_s may feed the law a radius down to {least:g} m, which needs "
            f"{law.gain_condition} = {bound:.4g}: k = {gain:.4g} flies no circle that small; raise "
            "guidance.gain",
        )


def _radius(mission: Mission) -> Iterator[Check]:
    law, gain, orbit = LAWS[mission.law.name], mission.law.gain, mission.orbit
    if gain <= law.gain_bound(orbit.speed, orbit.radius):
        return
    fed = law.fed_radius(orbit.speed, orbit.radius, gain) if mission.law.correct_radius else orbit.radius
    reached = law.reached_radius(orbit.speed, fed, gain)
    off = abs(reached / orbit.radius - 1)
    advice = "" if off < 0.01 else "; set guidance.correct_radius = true to reach it exactly"
    grade = Grade.PASS if off < 0.01 else Grade.WARN
    yield Check(grade, "radius", f"{reached:.3f} m will be reached, {orbit.radius:g} m asked for{advice}")


def _turn_rate(mission: Mission) -> Iterator[Check]:
    orbit = mission.orbit
    needed, gain = abs(orbit.steady_turn_rate), _expected_gain(mission)
    able = gain * orbit.max_turn_rate
    share = needed / able
    yield Check(
        _grade(share, warn_above=0.7, fail_above=1.0),
        "turn rate",
        f"the circle needs {degrees(needed):.2f} deg/s of the vehicle's {degrees(able):.2f} deg/s "
        f"({100 * share:.0f} %, must stay below 100 %)"
        + ("" if gain == 1 else f": {gain:g} of the {degrees(orbit.max_turn_rate):.2f} deg/s that it may be told"),
    )
    if mission.law.name == "switching" and mission.law.gain > orbit.max_turn_rate:
        yield Check(
            Grade.WARN,
            "turn rate",
            f"the law switches between +-{degrees(mission.law.gain):.2f} deg/s, more than the vehicle's limit, "
            "which it flies instead",
        )


def _expected_gain(mission: Mission) -> float:
    """The least of what it is told that the vehicle is expected to turn: a plane may reach only .72."""
    given = mission.file.vehicle.turn_gain
    return given if isinstance(given, float) else PLANE_GAIN if mission.file.vehicle.kind == "plane" else 1.0


def _reach(mission: Mission) -> Iterator[Check]:
    slant, farthest = _slant_range(mission, mission.orbit.radius), mission.max_range
    yield Check(
        _grade(slant / farthest, warn_above=REACH / 2, fail_above=REACH),
        "reach",
        f"range on the circle {slant:.1f} m of the {_length(farthest)} that {_what_ends_ranges(mission)} "
        f"({100 * slant / farthest:.0f} %, at most {100 * REACH:.0f} %)",
    )


def _slant_range(mission: Mission, horizontal: float) -> float:
    """What the radio measures, m, at a horizontal range."""
    return hypot(horizontal, mission.file.orbit.height_above_target_m or 0.0)


def _what_ends_ranges(mission: Mission) -> str:
    table = mission.file.ranging
    return "ranging.max_range_m allows" if mission.max_range == table.max_range_m else f"{table.message} carries"


def _length(metres: float) -> str:
    return f"{metres:.1f} m" if metres < 1e4 else f"{metres / 1000:.0f} km"


def _bounds(mission: Mission) -> Iterator[Check]:
    """The circle must lie between the bounds of the range, with some room for the way it swings."""
    nearest, farthest, radius = mission.file.bounds.min_range_m, mission.file.bounds.max_range_m, mission.orbit.radius
    if nearest is None and farthest is None:
        return
    grade = _grade(
        max((nearest or 0.0) / radius, radius / (farthest or inf)), warn_above=1 / (1 + ROOM), fail_above=1.0
    )
    given = [
        f"{words} bounds.{key} = {value:g} m"
        for words, key, value in (("above", "min_range_m", nearest), ("below", "max_range_m", farthest))
        if value is not None
    ]
    yield Check(
        grade,
        "bounds",
        f"the circle of {radius:g} m must be {' and '.join(given)} (horizontal ranges), by {100 * ROOM:.0f} %",
    )
    if farthest is not None and _slant_range(mission, farthest) > mission.max_range:
        yield Check(
            Grade.WARN,
            "bounds",
            f"bounds.max_range_m = {farthest:g} m never acts: ranges end at the {_length(mission.max_range)} that "
            f"{_what_ends_ranges(mission)}, and the flight with them",
        )


def _radio(mission: Mission) -> Iterator[Check]:
    table = mission.file.ranging
    if table.orientation == DOWNWARD:
        yield Check(
            Grade.FAIL,
            "ranging",
            f"orientation {DOWNWARD} is downward, a height sensor: it is never taken, choose 24 (up)",
        )
    if table.message == "ranging_beacon" and table.endpoint is None:
        yield Check(
            Grade.WARN,
            "ranging",
            "ArduPilot and PX4 do not forward RANGING_BEACON: unless the radio itself speaks on link.endpoint, give it "
            "its own (ranging.endpoint)",
        )


def _sampling(mission: Mission) -> Iterator[Check]:
    period = 1 / mission.file.ranging.rate_hz
    stale = mission.file.limits.stale_s
    yield Check(
        _grade(period / stale, warn_above=0.5, fail_above=1.0),
        "sampling",
        f"a range every {period:.3f} s, stale after {stale:g} s (at least two must fit)",
    )
    law, gain = LAWS[mission.law.name], min(mission.law.gain, mission.orbit.max_turn_rate)
    if law.switches:
        yield Check(
            _grade(gain * period, warn_above=0.05, fail_above=0.5),
            "switching",
            f"turns {gain * period:.3f} rad between two samples (above 0.05 it wanders off the circle, "
            "above 0.5 it is lost)",
        )


def _delay(mission: Mission) -> Iterator[Check]:
    """A link that may be engaged over must not make its ranges stale at once."""
    limits = mission.file.limits
    if mission.file.ranging.endpoint is None and limits.round_trip_s / 2 > limits.stale_s:
        yield Check(
            Grade.WARN,
            "delay",
            f"limits.round_trip_s = {limits.round_trip_s:g} lets a link be flown over whose ranges are "
            f"{limits.round_trip_s / 2:g} s under way; beyond limits.stale_s = {limits.stale_s:g} they are lost",
        )


def _noise(mission: Mission) -> Iterator[Check]:
    orbit, file = mission.orbit, mission.file
    steady = mission.steady_estimate
    share = steady.r_dot_sigma / orbit.speed
    yield Check(
        _grade(share, warn_above=0.2, fail_above=0.5),
        "range rate",
        f"known to {steady.r_dot_sigma:.2f} m/s at {file.ranging.sigma_m:g} m noise, {100 * share:.0f} % of the speed "
        f"(at most 50 %), {steady.lag:.2f} s late",
    )
    if mission.law.name != "smooth":
        return
    loop = 2 * mission.law.gain * orbit.radius * orbit.speed * mission.loop_lag
    yield Check(
        _grade(loop, warn_above=LOOP_BOUND, fail_above=4 * LOOP_BOUND),
        "damping",
        f"2 k r_d V (turn lag {file.vehicle.turn_lag_s:g} s + filter lag {steady.lag:.2f} s) = {loop:.2f}, "
        f"should be below {LOOP_BOUND:g} or the circle oscillates",
    )


def _slant(mission: Mission) -> Iterator[Check]:
    radius, height = mission.orbit.radius, mission.file.orbit.height_above_target_m
    if height is None:
        yield Check(
            Grade.WARN,
            "height",
            f"orbit.height_above_target_m is not given: ranges are taken as horizontal "
            f"(half the radius of height makes the circle {100 * (1 - sqrt(0.75)):.0f} % too small)",
        )
        return
    growth = sqrt(radius**2 + height**2) / radius
    yield Check(
        _grade(growth, warn_above=1.5, fail_above=MAX_SIGMA_GROWTH),
        "height",
        f"{height:g} m above the target: slant range counts {growth:.2f} times in noise (at most {MAX_SIGMA_GROWTH:g})",
    )


def drift_allowed(mission: Mission) -> float:
    """Wind less target motion, m/s, in which the circle can be held; not positive if not even in still air."""
    orbit = mission.orbit
    return tolerated_drift(orbit.speed, orbit.radius, orbit.max_turn_rate, _expected_gain(mission))


def _drift(mission: Mission) -> Iterator[Check]:
    """What the circle itself allows in wind or round a moving target, and how long the way to it may take."""
    orbit, gain = mission.orbit, _expected_gain(mission)
    tolerated = drift_allowed(mission)
    if tolerated > 0:
        share = 100 * tolerated / orbit.speed
        rest = "" if mission.file.guidance.law in DRIFT_LAWS else f"; the law {mission.law.name} itself knows no drift"
        yield Check(
            Grade.PASS,
            "drift",
            f"wind less target motion up to {tolerated:.1f} m/s ({share:.0f} % of V) leaves the circle flyable: "
            f"(V + W)^2/(V max turn rate) <= r_d{rest}",
        )
    far = min(5 * orbit.radius, mission.max_range)
    seconds = settling_time(far, orbit.speed, orbit.radius, orbit.max_turn_rate * gain)
    yield Check(Grade.PASS, "settling", f"about {seconds:.0f} s at most from {far:.0f} m in still air (Dubins path)")


def _signing(mission: Mission) -> Iterator[Check]:
    table = mission.file.signing
    if table is None:
        return
    if table.accept_unsigned is True:
        says = "frames are signed, but unsigned ones are believed too: anybody can speak for the vehicle"
        yield Check(Grade.WARN, "signing", f"{says} (signing.accept_unsigned)")
    else:
        also = ", on the ranging endpoint unsigned ones too" if table.accept_unsigned else ""
        yield Check(Grade.PASS, "signing", f"frames are signed, and believed only if signed with our key{also}")
