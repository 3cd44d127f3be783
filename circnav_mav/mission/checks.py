"""Checks of a mission before a flight: one line per fact, with its value and bound."""

from collections.abc import Iterator
from math import atan, ceil, degrees, floor, inf, isfinite

from circnav_mav.extension import added_checks
from circnav_mav.guidance.laws import LAWS, settling_time, tolerated_drift
from circnav_mav.guidance.margin import DESIGN_DRIFT, drift_with_margin, radius_with_margin
from circnav_mav.guidance.own_code import OwnCodeError, StuckCodeError, turn_rate_of
from circnav_mav.guidance.types import GRAVITY, OwnLaw, RangeEstimate
from circnav_mav.guidance.vehicle_model import MEASUREMENT_DELAY
from circnav_mav.mav.autopilots.interface import FOLLOWED
from circnav_mav.mav.autopilots.table import AUTOPILOTS, REFUSED, allowed
from circnav_mav.mav.check_result import FAIL, PASS, WARN, Check, graded
from circnav_mav.mav.ranging.driver import split_driver
from circnav_mav.mission.checks_ranging import check_ranging
from circnav_mav.mission.mission import Mission
from circnav_mav.time_limit import time_limit

TILT_USED = 0.8
"""Share of the tilt limit above which `check` warns, for the tilt that airspeed or turns need.
Before a flight the drag is known within a quarter only."""
TURN_USED = 0.7
"""Share of the vehicle's turn rate above which `check` warns, for the turn rate that the circle
needs. The remaining share is for wind and the approach."""
LOOPBACK = ("127.0.0.1", "localhost", "[::1]")
"""Hosts of endpoints that only this computer can reach."""
DRIFT_LAWS = frozenset({"auto", "drift"})


def check_mission(mission: Mission) -> list[Check]:
    """Return all check lines of a mission."""
    parts = (
        *(_keys, _vehicle, _exit, _tilt, _gps_loss, _own_code, _estimator, _gain),
        *(_turn_rate, _acceleration, check_ranging, _drift, _margin, _signing),
    )
    lines = [line for part in parts for line in part(mission)]
    return [*lines, *added_checks("checks", mission)]


def _keys(mission: Mission) -> Iterator[Check]:
    yield Check(PASS, "keys", "all keys valid, none missing")


def _vehicle(mission: Mission) -> Iterator[Check]:
    autopilot, kind = mission.vehicle_key
    able = allowed(autopilot, kind)
    method = mission.file.vehicle.method
    owners = [whose for whose, what in AUTOPILOTS if what.endswith(f" {method}")]
    if method is not None and autopilot not in (*owners, "auto"):
        words = f'vehicle.method = "{method}" is a method of {owners[0]}, not of {autopilot}'
        yield Check(FAIL, "autopilot", f"{words}: omit the key")
        return
    if not able:
        reason = REFUSED.get(
            (autopilot, kind), "MAVLink offers no way to steer this vehicle without its position"
        )
        yield Check(FAIL, "autopilot", f"{autopilot} {kind} cannot be flown: {reason}")
        return
    yield Check(PASS, "autopilot", " or ".join(" ".join(one) for one in able))


def _exit(mission: Mission) -> Iterator[Check]:
    """Check that every vehicle that may be flown can end the flight by the exit action."""
    able = mission.vehicles
    exits = mission.file.exit.action
    if lacking := [one for one in able if exits not in (None, "stop", *one.exits)]:
        choice = f"choose {', '.join(lacking[0].exits)}"
        yield Check(FAIL, "exit", f"{lacking[0].name} has no exit action {exits}: {choice}")
    why = next((one.firmware.why_must_leave for one in able if one.firmware.why_must_leave), "")
    if why and (exits == "stop" or mission.file.engage.on_takeover == "wait"):
        others = [f'"{one.firmware.key}"' for one in able if not one.firmware.why_must_leave]
        otherwise = f", or vehicle.autopilot {' or '.join(others)}" if others else ""
        words = 'exit.action must command a mode, and engage.on_takeover must be "end"'
        yield Check(FAIL, "exit", f"{why}: {words}{otherwise}")
    elif exits == "stop":
        for one in able:
            if one.why_no_stop:
                words = f"exit.action must command a mode, choose {', '.join(one.exits)}"
                yield Check(FAIL, "exit", f"{one.why_no_stop}: {words}")


def _tilt(mission: Mission) -> Iterator[Check]:
    """Check that the tilt limit of a copter flown by attitude suffices for its airspeed and its
    turns."""
    if not mission.by_attitude:
        return
    vehicle = mission.file.vehicle
    most = vehicle.max_bank_deg or 0.0
    needed = degrees(atan(vehicle.drag_per_s * vehicle.speed_mps / GRAVITY))
    lateral = degrees(atan(mission.orbit.speed * abs(mission.orbit.steady_turn_rate) / GRAVITY))
    when = "" if mission.by_attitude[0] in mission.vehicles else "after a loss of GPS, "
    words = (
        f"{when}{vehicle.speed_mps:g} m/s through the air needs {needed:.0f} deg of forward tilt"
        f" and {lateral:.0f} deg of roll of the {most:g} deg allowed (vehicle.drag_per_s ="
        f" {vehicle.drag_per_s:g})"
    )
    share = max(needed, lateral) / most
    advice = "" if share < TILT_USED else ": lower vehicle.speed_mps or raise vehicle.max_bank_deg"
    yield Check(graded(share, warn_above=TILT_USED, fail_above=1.0), "tilt", words + advice)


def _gps_loss(mission: Mission) -> Iterator[Check]:
    """Report a mode request that the operator may not expect, and a vehicle that cannot continue
    after a loss of GPS."""
    engage = mission.file.engage
    words = 'engage.on_gps_loss = "attitude": '
    if engage.on_gps_loss == "exit":
        return
    if not any(one.replacement for one in mission.vehicles):
        yield Check(FAIL, "gps loss", f"{words}only an ArduPilot copter in GUIDED can: omit it")
    elif not engage.request_mode:
        words += "after a loss of GPS circnav requests GUIDED_NOGPS,"
        words += ' although engage.request_mode = false. With "exit" circnav requests no mode'
        yield Check(WARN, "gps loss", words)


def _estimator(mission: Mission) -> Iterator[Check]:
    """Check that an estimator that needs own motion receives it before the engagement."""
    if mission.estimator != "drift":
        return
    if mission.vehicles and not any(one.fixed_wing for one in mission.vehicles):
        needs = f"{mission.estimator} needs the airspeed before the vehicle can be engaged"
        why = (
            f"a {mission.file.vehicle.kind} measures none: its speed is given only while circnav"
            " steers"
        )
        yield Check(FAIL, "estimator", f'{needs}, and {why}. Set guidance.estimator = "auto"')


def _own_code(mission: Mission) -> Iterator[Check]:
    """Check that a user-defined law or estimator can be imported and created, and that the law
    returns a turn rate on the circle. Nothing else about it is checked."""
    if not mission.own_code:
        return
    names = " and ".join(mission.own_code)
    try:
        law = mission.import_own_code()
        returned = "" if law is None else f"; {_called_once(law, mission)}"
    except (OwnCodeError, StuckCodeError) as error:
        yield Check(FAIL, "own code", str(error))
        return
    ignored = mission.file.guidance.gain is not None and mission.law.name not in LAWS
    unused = "; guidance.gain has no effect" if ignored else ""
    grade = PASS if mission.flies_sim and not ignored else WARN
    words = f"{names}: imported{returned}; nothing else about it is checked{unused}"
    yield Check(grade, "own code", words)


def _called_once(law: OwnLaw, mission: Mission) -> str:
    """Call a user-defined law once, with an estimate on the circle. Return the result as text.
    Raises OwnCodeError, StuckCodeError."""
    name = mission.law.name
    orbit = mission.orbit
    sigma = mission.file.ranging.sigma_m
    with time_limit(simulated=mission.flies_sim):
        on_circle = RangeEstimate(0.0, orbit.radius, 0.0, sigma, r_dot_sigma=1.0)
        found = turn_rate_of(law, on_circle)
    if not isfinite(found):
        raise OwnCodeError(f"law {name} returns {found} on the circle, not a turn rate in rad/s")
    needed = orbit.direction.turn_sign * orbit.speed / orbit.radius
    return f"on the circle it returns {found:+.3f} rad/s, the circle needs {needed:+.3f} rad/s"


def _gain(mission: Mission) -> Iterator[Check]:
    law = LAWS.get(mission.law.name)
    if law is None:
        return
    gain = mission.law.gain
    orbit = mission.orbit
    bound = law.gain_bound(orbit.speed, orbit.radius)
    default = mission.tuning.default_gain(orbit)
    # 0.1: share of the default gain below which a law hardly turns the vehicle.
    grade = FAIL if gain <= bound else WARN if gain < 0.1 * default else PASS
    weak = (
        f"; the default is {default:.4g}, with this gain the vehicle hardly turns"
        if grade is WARN
        else ""
    )
    origin = "given" if mission.file.guidance.gain else "default"
    needs = law.gain_condition + (f" = {bound:.4g}" if bound else "")
    yield Check(
        grade, "gain", f"{law.name}: k = {gain:.4g} {law.gain_unit} ({origin}), needs {needs}{weak}"
    )


def _turn_rate(mission: Mission) -> Iterator[Check]:
    orbit = mission.orbit
    gain = mission.least_turn_gain
    needed = abs(orbit.steady_turn_rate)
    able = gain * orbit.max_turn_rate
    slips = (
        ""
        if gain == 1
        else f"; it turns {gain:g} times a commanded {degrees(orbit.max_turn_rate):.2f} deg/s"
    )
    words = (
        f"the circle needs {degrees(needed):.2f} deg/s of the vehicle's {degrees(able):.2f} deg/s"
    )
    share = f"{100 * needed / able:.0f} %, must stay below 100 %"
    grade = graded(needed / able, warn_above=TURN_USED, fail_above=1.0)
    remedy = ""
    if grade is FAIL:
        remedy = f": a radius of {ceil(orbit.speed / able):g} m passes"
        bank = mission.file.vehicle.max_bank_deg
        # 5: bank limit, deg, below which the value may be in radians.
        if bank is not None and bank < 5:
            remedy += f"; vehicle.max_bank_deg = {bank:g} is in degrees"
    yield Check(grade, "turn rate", f"{words} ({share}){slips}{remedy}")
    if mission.law.name == "switching" and mission.law.gain > orbit.max_turn_rate:
        words = (
            f"the law switches between ±{degrees(mission.law.gain):.2f} deg/s, more than the"
            " vehicle's limit"
        )
        yield Check(WARN, "turn rate", f"{words}: the vehicle turns at its limit instead")


def fastest_turn(mission: Mission) -> float:
    """Return the turn rate, rad/s, that the vehicles' default acceleration limits allow at the
    mission's speed."""
    emulated = (mission.file.sim or {}).get("vehicle", {})
    if mission.flies_sim and emulated.get("dynamics") != "realistic":
        return inf  # the emulator's ideal copters have no limit
    limits = [one.acceleration_limit[1] for one in mission.vehicles if one.acceleration_limit]
    return min(limits, default=inf) * FOLLOWED / mission.orbit.speed


def _acceleration(mission: Mission) -> Iterator[Check]:
    """Warn if turns at the turn-rate limit need more than the vehicle's acceleration limit.

    The path then does not follow the nose, and the estimator mistakes the difference for a drift.
    An emulated flight oscillated about the circle without end. On firmware the same mission settled
    3 s later than with a lower turn-rate limit.
    """
    orbit = mission.orbit
    most = fastest_turn(mission)
    if orbit.max_turn_rate <= most:
        return
    names = " or ".join(
        one.acceleration_limit[0] for one in mission.vehicles if one.acceleration_limit
    )
    asked = orbit.max_turn_rate * orbit.speed
    words = (
        f"turns at vehicle.max_turn_rate_deg_s need {asked:.1f} m/s^2, more than the default of"
        f" {names} allows"
    )
    lower = f"lower vehicle.max_turn_rate_deg_s to {floor(degrees(most))}"
    yield Check(
        WARN,
        "acceleration",
        f"{words}: the path may follow late; {lower}, or raise {names} (circnav params)",
    )


def drift_allowed(mission: Mission) -> float:
    """Return the largest drift (wind minus target velocity), m/s, in which the circle can be held.
    The value is 0 or negative if the circle cannot be held even in still air."""
    orbit = mission.orbit
    return tolerated_drift(
        orbit.speed, mission.orbit.radius, orbit.max_turn_rate * mission.least_turn_gain
    )


def _drift(mission: Mission) -> Iterator[Check]:
    """Report the drift that the circle's geometry allows, and the time to reach the circle."""
    orbit = mission.orbit
    gain = mission.least_turn_gain
    tolerated = drift_allowed(mission)
    if tolerated > 0:
        rest = (
            ""
            if mission.law.name in DRIFT_LAWS or mission.law.name not in LAWS
            else f"; the law {mission.law.name} does not correct for wind"
        )
        most = (
            f"up to W = {tolerated:.1f} m/s of wind minus target motion"
            f" ({100 * tolerated / orbit.speed:.0f} % of V)"
        )
        words = (
            f"the circle can be flown in {most}: (V + W)^2/(V max turn rate) <= radius, V ="
            f" speed{rest}"
        )
        yield Check(PASS, "drift", words)
    far = min(5 * orbit.radius, mission.max_range)
    seconds = settling_time(far, orbit.speed, orbit.radius, orbit.max_turn_rate * gain)
    way = (
        f"on the shortest path (Dubins) from {far:.0f} m in still air, flying away from the target"
        " at first"
    )
    yield Check(
        PASS, "settling", f"about {seconds:.0f} s {way}; laws on range alone may take twice as long"
    )


def drift_with_loop_margin(mission: Mission, most: float) -> float | None:
    """Return the largest drift up to `most`, m/s, in which the turn loop keeps its stability
    margin. The value is negative if the margin is missing even in still air, and None for a law
    without this loop."""
    orbit = mission.orbit
    allowed_drift = drift_allowed(mission)
    delay = mission.file.vehicle.turn_lag_s
    if mission.law.name not in DRIFT_LAWS or allowed_drift <= 0 or delay <= 0:
        return None
    return drift_with_margin(orbit.speed, orbit.radius, most, *_turn_loop(mission))


def _design_drift(mission: Mission) -> float:
    return min(drift_allowed(mission), DESIGN_DRIFT * mission.orbit.speed)


def _turn_loop(mission: Mission) -> tuple[float, float, float]:
    """Return delay from a command to its turn (s), delay of the reported turn rate (s) and
    turn-rate limit (rad/s)."""
    late = MEASUREMENT_DELAY if any(one.fixed_wing for one in mission.vehicles) else 0.0
    return mission.file.vehicle.turn_lag_s, late, mission.orbit.max_turn_rate


def _margin(mission: Mission) -> Iterator[Check]:
    """Check the stability margin of the drift law's turn loop in the wind that the geometry allows.

    In flight the law is tuned to the measured delay. Here vehicle.turn_lag_s is used instead.
    """
    kept = drift_with_loop_margin(mission, _design_drift(mission))
    if kept is None:
        return
    V = mission.orbit.speed
    r_d = mission.orbit.radius
    wanted = _design_drift(mission)
    delay = _turn_loop(mission)[0]
    if kept >= wanted:
        words = (
            f"with a turn delay of {delay:g} s, the turn loop is stable in {kept:.1f} m/s of wind"
            " minus target motion"
        )
        yield Check(PASS, "margin", words)
        return
    until = (
        f"in more than {kept:.1f} m/s of wind minus target motion"
        if kept > 0
        else "even in still air"
    )
    words = f"with a turn delay of {delay:g} s, the turn loop may oscillate on this circle {until}"
    radius = radius_with_margin(V, r_d, wanted, *_turn_loop(mission))
    larger = (
        f"a radius of {ceil(radius):g} m suffices for up to {wanted:.1f} m/s"
        if isfinite(radius)
        else "lower V"
    )
    yield Check(WARN, "margin", f"{words}; {larger}")


def _signing(mission: Mission) -> Iterator[Check]:
    table = mission.file.signing
    if table is None:
        yield from _unsigned(mission)
        return
    if table.accept_unsigned is True:
        words = (
            "frames are signed, but unsigned frames are accepted too: any program can pose as the"
            " vehicle"
        )
        yield Check(WARN, "signing", f"{words} (signing.accept_unsigned)")
    else:
        also = ", on the ranging endpoint also unsigned" if table.accept_unsigned else ""
        yield Check(
            PASS, "signing", f"frames are signed, and accepted only if signed with our key{also}"
        )


def _unsigned(mission: Mission) -> Iterator[Check]:
    """Check which senders can pose as the vehicle on an unsigned link."""
    link = mission.file.link
    ranging = mission.file.ranging
    ports = [split_driver(one)[1] for one in (link.endpoint, ranging.endpoint) if one]
    received = [one for one in ports if one.startswith(("udp:", "udpin:"))]
    if link.peer and not received:
        yield Check(
            WARN, "peer", "link.peer has no effect: only udpin receives from more than one address"
        )
    elif link.peer:
        yield Check(PASS, "peer", f"{' and '.join(received)} accepts {', '.join(link.peer)} only")
    elif received and not any(host in received[0] for host in LOOPBACK):
        words = f"{received[0]} trusts any program that is first to send as the vehicle"
        yield Check(
            WARN,
            "peer",
            f"{words}: set the vehicle's address (link.peer), or sign (docs/signing.md)",
        )
