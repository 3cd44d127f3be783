"""Preflight checks of the vehicle and the ranging: from the data of a `PreflightListener` to check
lines."""

from collections.abc import Iterator, Mapping
from math import degrees, isnan

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.autopilots.interface import Autopilot, rules_by_parameter
from circnav_mav.mav.autopilots.parameters import Context
from circnav_mav.mav.check_result import FAIL, PASS, WARN, Check, Grade
from circnav_mav.mav.clocks import span_speed
from circnav_mav.mav.identity import RADIO_NAME
from circnav_mav.mav.own_motion import ACCELERATIONS
from circnav_mav.mission.mission import Mission
from circnav_mav.pilot import VEHICLE
from circnav_mav.pilot.airborne import LEAST_AIRSPEED
from circnav_mav.pilot.method import WITHOUT_STREAM
from circnav_mav.preflight.listener import PreflightListener
from circnav_mav.preflight.ranging import FULL_RATE, SPEED_OFF, judge_ranging

SILENT = 2.0
"""Age of the newest heartbeat at the end of preflight, s, above which the check fails. Autopilots
send one heartbeat a second."""
TROUBLE = ("prearm", "arm:", "failsafe", "failed", "error", "unhealthy", "denied", "variance")
"""Preflight repeats each STATUSTEXT that contains one of these words."""


def judge(mission: Mission, listener: PreflightListener, clock_speed: float = 1.0) -> list[Check]:
    """Return all lines of a completed preflight. clock_speed: speed of the run's clock relative to
    real time. It differs from 1 only if the run follows the autopilot's clock."""
    if not listener.session.up:
        why = listener.connection.no_vehicle
        return [Check(FAIL, "vehicle", f"no vehicle for this mission: {why}")]
    parts = (_identity, _mode, _protocol, _signing, _company, _streams, _motion, _battery)
    lines = [line for part in parts for line in part(mission, listener)]
    lines += [*_clock(mission, listener, clock_speed), _round_trip(mission, listener)]
    lines += judge_ranging(mission, listener)
    context = parameter_context(mission, listener.session.vehicle_ids[0], listener.parameters)
    lines += _parameters(_methods(mission, listener), context)
    repeated = [text for text in listener.texts if any(word in text.lower() for word in TROUBLE)]
    return lines + [Check(WARN, "STATUSTEXT", f'"{text}"') for text in repeated]


def _methods(mission: Mission, listener: PreflightListener) -> tuple[type[Autopilot], ...]:
    """Return the adapters that may steer the connected vehicle. The first one begins the flight."""
    return mission.methods(type(listener.session.adapter))


def _parameters(methods: tuple[type[Autopilot], ...], context: Context) -> list[Check]:
    """Check the parameters for every method that the mission may fly. A result that is the same
    for a later method has no line of its own."""
    lines: list[Check | None] = []
    results: set[Check | None] = {None}
    for rules in rules_by_parameter(methods).values():
        for rule, method in rules.items():
            result = rule.check(context)
            if result not in results:
                when = "" if method is methods[0] else f"as {method.name}: "
                lines.append(rule.check(context, when))
            results.add(result)
    return [line for line in lines if line is not None]


def parameter_context(mission: Mission, system: int, values: Mapping[str, float]) -> Context:
    """Return the context of the parameter rules. system: id of the vehicle. values: the parameters
    read."""
    return Context(
        speed=mission.orbit.speed,
        max_turn_rate_deg=degrees(mission.orbit.max_turn_rate),
        max_bank_deg=mission.file.vehicle.max_bank_deg or 0.0,
        tick=1 / mission.file.limits.tick_hz,
        system=system,
        values=values,
        circle_turn_rate=mission.orbit.speed / mission.orbit.radius,
    )


# --- identity


def _identity(mission: Mission, listener: PreflightListener) -> Iterator[Check]:
    adapter = listener.session.adapter
    firmware = listener.session.vehicle.firmware
    system, component = listener.session.vehicle_ids
    yield Check(
        PASS,
        "vehicle",
        f"system {system}, component {component}: {listener.kind}, autopilot {adapter.name}",
    )
    if firmware is None:
        yield Check(WARN, "firmware", "no answer to a request for AUTOPILOT_VERSION")
    else:
        flown = f"our messages were tested on {adapter.firmware.flown}"
        yield Check(PASS, "firmware", f"{firmware} ({flown})")


def _mode(mission: Mission, listener: PreflightListener) -> Iterator[Check]:
    adapter = listener.session.adapter
    vehicle = listener.session.vehicle
    now = f"now {vehicle.mode_name} ({vehicle.mode}), {'armed' if vehicle.armed else 'disarmed'}"
    if vehicle.armed and vehicle.mode == adapter.guided_mode:
        yield Check(WARN, "mode", f"{now}: a flight would steer the vehicle immediately")
    else:
        who = (
            "requested by circnav"
            if mission.file.engage.request_mode
            else "entered by the operator"
        )
        later = "".join(
            f"; as {method.name} in {method.mode_names[method.guided_mode]}"
            f" ({method.guided_mode}), requested by circnav"
            for method in _methods(mission, listener)[1:]
        )
        words = f"flown in {adapter.guided_name} ({adapter.guided_mode}), {who}{later}; {now}"
        yield Check(PASS, "mode", words)


def _protocol(mission: Mission, listener: PreflightListener) -> Iterator[Check]:
    received = listener.connection.counts[VEHICLE]
    if received.version_1:
        yield Check(
            WARN, "MAVLink", f"{received.version_1} of {received.frames} frames are of version 1"
        )
    else:
        yield Check(PASS, "MAVLink", "version 2 only")


def _signing(mission: Mission, listener: PreflightListener) -> Iterator[Check]:
    """Check that received frames are signed as the mission requires. No line if neither side
    signs."""
    received = listener.connection.counts[VEHICLE]
    if mission.file.signing is None:
        if received.signed:
            words = (
                f"{received.signed} of {received.frames} frames are signed, and the mission has"
                " no key"
            )
            yield Check(
                WARN, "signing", f"{words}: our frames may be rejected; set signing.key_file"
            )
        elif received.zero_key:
            words = "the autopilot signs with the all-zero key, as PX4 does without a key"
            yield Check(
                PASS, "signing", f"{words}, and accepts unsigned frames: the link is not protected"
            )
    elif received.refused:
        why = ", ".join(f"{count} {reason}" for reason, count in sorted(received.refused.items()))
        yield Check(
            WARN,
            "signing",
            f"{received.refused.total()} of {received.frames} frames rejected: {why}",
        )
    else:
        yield Check(
            PASS,
            "signing",
            f"{received.signed} of {received.frames} frames signed, all with our key",
        )


def _company(mission: Mission, listener: PreflightListener) -> list[Check]:
    alone = "no other autopilot on the link, no other companion with our ids"
    return list(_others(mission, listener)) or [Check(PASS, "others", alone)]


def _others(mission: Mission, listener: PreflightListener) -> Iterator[Check]:
    """Yield a line for each kind of other senders."""
    session = listener.session
    ours = mission.file.link.component_id
    if twins := session.identity.ignored["twin"]:
        words = (
            f"{twins} frames of another companion with our component id {ours}: "
            "change link.component_id on one of the two companions"
        )
        yield Check(FAIL, "others", words)
    if others := session.identity.ignored["other_vehicle"]:
        also = (
            f": {'; '.join(session.identity.misfits.values())}" if session.identity.misfits else ""
        )
        advice = "" if mission.file.vehicle.system_id else "; select yours by vehicle.system_id"
        yield Check(
            WARN, "others", f"{others} heartbeats of another autopilot on the link{also}{advice}"
        )
    if peripherals := session.identity.ignored["no_autopilot"]:
        ids = "{}/{}".format(*session.vehicle_ids)
        words = (
            f"{peripherals} heartbeats from a component that is no autopilot, but has the vehicle's"
            f" ids {ids}"
        )
        yield Check(WARN, "others", f"{words}: give that component another id")
    for rival in session.identity.second_senders.recent(listener.end):
        of_driver = mission.ranging_driver is not None and rival.startswith(RADIO_NAME)
        advice = "ranging.beacon_id" if of_driver else "link.peer, or sign"
        yield Check(FAIL, "others", f"{rival}; select yours by {advice}")


# --- telemetry


def _streams(mission: Mission, listener: PreflightListener) -> Iterator[Check]:
    if (silence := listener.session.heartbeat_age(listener.end)) > SILENT:
        yield Check(
            FAIL, "heartbeat", f"the last one was received {silence:.1f} s before preflight ended"
        )
    for message_id, (wanted, measured) in listener.streams.items():
        name = dialect.mavlink_map[message_id].msgname
        words = f"{name} {measured:.1f} Hz, requested {wanted:g} Hz"
        if measured >= FULL_RATE * wanted:
            yield Check(PASS, "stream", words)
        # 0.5: share of the requested rate below which a stream is treated as missing.
        elif measured >= 0.5 * wanted:
            yield Check(WARN, "stream", words)
        else:
            grade, without = _without(mission, listener, name)
            yield Check(grade, "stream", f"{words}: {without}")


def _without(mission: Mission, listener: PreflightListener, name: str) -> tuple[Grade, str]:
    """Return the grade of a missing or slow stream, and its reason."""
    file = mission.file
    needs = " and ".join(sorted(_needs(mission, listener)))
    by_drag = next((one.name for one in _methods(mission, listener) if one.airspeed_from_drag), "")
    for streams, needed, why in (
        (("VFR_HUD",), needs, f"the mission needs its {needs}"),
        (("ATTITUDE",), file.vehicle.turn_gain == "learn", "the turn gain is learned from it"),
        (ACCELERATIONS, by_drag, f"{by_drag}: the airspeed is measured by it"),
        (
            ("SYS_STATUS",),
            file.bounds.min_battery_percent is not None,
            "bounds.min_battery_percent needs it",
        ),
        ((file.ranging.message.upper(),), True, "the ranges arrive in it"),
    ):
        if name in streams and needed:
            return FAIL, why
    return WARN, _WITHOUT.get(name, "circnav requested it")


_WITHOUT = WITHOUT_STREAM | {
    "HEARTBEAT": "a change of mode is detected late",
    "CURRENT_MODE": "a change of mode is detected by the heartbeat only, once a second",
    "SYSTEM_TIME": "a reboot is detected by ATTITUDE only",
    "SYS_STATUS": "no battery charge",
    "ATTITUDE": "no heading",
    "VFR_HUD": "no altitude and airspeed",
    "GLOBAL_POSITION_INT": "no height above home: start circnav before the take-off",
    "RAW_IMU": "no accelerations",
    "HIGHRES_IMU": "no accelerations",
    "HOME_POSITION": "a change of the home position is detected late",
}


def _motion(mission: Mission, listener: PreflightListener) -> Iterator[Check]:
    needs = _needs(mission, listener)
    motion = listener.session.motion.at(listener.end)
    for name, unit in (("airspeed", "m/s"), ("altitude", "m above sea level")):
        value = getattr(motion, name)
        if value is not None:
            yield Check(
                PASS, name, f"{value:.1f} {unit}" + ("" if name in needs else ", not needed")
            )
        elif name not in needs:
            yield Check(PASS, name, "not received, not needed")
        else:
            yield _missing(name, mission, listener)


def _missing(name: str, mission: Mission, listener: PreflightListener) -> Check:
    """Return the line of a quantity of VFR_HUD that is needed, but not received."""
    session = listener.session
    airspeed = listener.airspeed
    if name == "airspeed" and airspeed == 0 and not session.vehicle.armed:
        least = LEAST_AIRSPEED * mission.facts.speed
        words = f"0 m/s, as before take-off; a flight engages from {least:.1f} m/s on"
        return Check(WARN, name, words)
    user = f"a {session.adapter.name}" if name in session.adapter.needs else "the mission"
    why = ""
    if airspeed is None:
        why = ": no VFR_HUD"
    elif name == "airspeed" and isnan(airspeed):
        why = ": VFR_HUD has none (NaN), check the airspeed sensor"
    return Check(FAIL, name, f"not received{why}; {user} needs it")


def _needs(mission: Mission, listener: PreflightListener) -> frozenset[str]:
    bounds = mission.file.bounds
    bounded = (bounds.min_altitude_m, bounds.max_altitude_m) != (None, None)
    needed = bounded or mission.file.orbit.needs_altitude
    return listener.session.adapter.needs | ({"altitude"} if needed else frozenset())


def _battery(mission: Mission, listener: PreflightListener) -> Iterator[Check]:
    least = mission.file.bounds.min_battery_percent
    battery = listener.session.vehicle.battery(listener.end)
    if least is None:
        return
    if battery is None:
        yield Check(
            FAIL, "battery", f"not reported, but needed for bounds.min_battery_percent = {least:g}"
        )
    else:
        grade = PASS if battery > least else FAIL
        yield Check(grade, "battery", f"{battery:.0f} %, the flight ends at {least:g} %")


# --- time


def _clock(mission: Mission, listener: PreflightListener, clock_speed: float) -> Iterator[Check]:
    reboots = listener.session.vehicle.reboots
    boot = listener.boot
    if reboots:
        yield Check(FAIL, "clock", f"the autopilot rebooted {reboots} times during preflight")
    follows = mission.file.link.clock == "autopilot"
    # 1.0: least time, s, in which the speed of a clock can be measured within a few percent.
    if boot is None or boot[1][0] - boot[0][0] < 1.0:
        words = (
            "no boot time of the autopilot (SYSTEM_TIME, ATTITUDE): a reboot would not be detected"
        )
        yield Check(FAIL if follows else WARN, "clock", words)
    else:
        speed = span_speed(boot) * clock_speed
        words = f"the autopilot's clock runs at {speed:.3f} times our speed"
        if speed < SPEED_OFF:
            yield Check(FAIL, "clock", f"{words}: it has stopped")
        elif follows:
            yield Check(PASS, "clock", f"{words}, and the flight follows it")
        elif abs(speed - 1) > SPEED_OFF:
            yield Check(
                FAIL,
                "clock",
                f'{words}: set link.clock = "autopilot" to fly a simulator at this speed',
            )
        # 0.08: difference between the two clocks during the measurement, s, above which preflight
        # warns. PX4's simulator once ran at 0.985 of real time. Then ranges were rejected as too
        # old, and one flight of five ended with RANGE STALE.
        elif abs(speed - 1) * (boot[1][0] - boot[0][0]) > 0.08:
            yield Check(
                WARN,
                "clock",
                f'{words}: ranges may count as old. For a simulator: link.clock = "autopilot"',
            )
        else:
            yield Check(PASS, "clock", words)


def _round_trip(mission: Mission, listener: PreflightListener) -> Check:
    trip = listener.session.timesync.typical
    if trip is None:
        words = "no answer to TIMESYNC: the delay of the link is not measured"
        return Check(WARN, "round trip", words)
    most = mission.slowest_answer
    # 0.1: round trip to the autopilot, s, above which the delay is no longer small compared to a
    # turn lag of 0.4 s.
    grade = PASS if trip < 0.1 else WARN if trip <= most else FAIL
    words = f"{1000 * trip:.0f} ms (TIMESYNC), at most {1000 * most:.0f} ms"
    return Check(grade, "round trip", words)
