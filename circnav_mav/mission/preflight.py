"""Preflight checks of the vehicle and the ranging: the data of a `Survey` in, lines out."""

from collections.abc import Iterator, Mapping
from math import degrees, isnan

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.autopilots.parameters import Context
from circnav_mav.mav.check_result import FAIL, PASS, WARN, Check, Grade
from circnav_mav.mav.clocks import span_speed
from circnav_mav.mav.identity import RADIO_NAME
from circnav_mav.mission.mission import Mission
from circnav_mav.mission.preflight_ranging import FULL_RATE, SPEED_OFF, judge_ranging
from circnav_mav.pilot import VEHICLE
from circnav_mav.pilot.survey import Survey

LOW_RATE = 0.5
"""Share of the requested rate below which a stream counts as missing."""
SILENT = 2.0
"""Age of the newest heartbeat, s, above which at least one was lost: autopilots send one a second."""
SLOW_ROUND_TRIP = 0.1
"""Round trip to the autopilot, s, above which the delay is no longer small compared to a turn lag of 0.4 s."""
LEAST_SPAN = 1.0
"""Least time, s, to measure the speed of a clock within a few percent."""
TROUBLE = ("prearm", "arm:", "failsafe", "failed", "error", "unhealthy", "denied", "variance")
"""Words by which preflight selects the STATUSTEXTs that it repeats."""


def judge(mission: Mission, survey: Survey, clock_speed: float = 1.0) -> list[Check]:
    """Return all lines for a completed survey. clock_speed: speed of the run's clock relative to real time, if the run
    follows the autopilot's clock."""
    if not survey.session.up:
        misfits = "; ".join(survey.session.misfits.values())
        why = misfits or f"no autopilot heartbeat, {survey.connection.counts[VEHICLE].describe()}"
        return [Check(FAIL, "vehicle", f"none that the mission means; {why}")]
    parts = (_identity, _mode, _protocol, _signing, _company, _streams, _motion, _battery)
    lines = [line for part in parts for line in part(mission, survey)]
    lines += [*_clock(mission, survey, clock_speed), *judge_ranging(mission, survey)]
    context = parameter_context(mission, survey.session.vehicle_ids[0], survey.parameters)
    lines += [line for rule in survey.session.adapter.parameters if (line := rule.check(context)) is not None]
    told = [text for text in survey.texts if any(word in text.lower() for word in TROUBLE)]
    return lines + [Check(WARN, "says", f'"{text}"') for text in told]


def parameter_context(mission: Mission, system: int, values: Mapping[str, float]) -> Context:
    """Return the context of the parameter rules. system: id of the vehicle. values: the parameters read."""
    return Context(
        speed=mission.orbit.speed,
        max_turn_rate_deg=degrees(mission.orbit.max_turn_rate),
        max_bank_deg=mission.file.vehicle.max_bank_deg or 0.0,
        tick=1 / mission.file.limits.tick_hz,
        system=system,
        values=values,
        circle_turn_rate=mission.orbit.speed / min(mission.radii),
    )


# --- identity ---------------------------------------------------------------------------------------------------------


def _identity(mission: Mission, survey: Survey) -> Iterator[Check]:
    adapter, firmware = survey.session.adapter, survey.session.vehicle.firmware
    system, component = survey.session.vehicle_ids
    yield Check(PASS, "vehicle", f"system {system}, component {component}: {survey.kind}, flown as {adapter.name}")
    if firmware is None:
        yield Check(WARN, "firmware", "no answer to a request for AUTOPILOT_VERSION")
    else:
        flown = f"the messages we send were flown on {adapter.firmware.flown}"
        yield Check(PASS, "firmware", f"{firmware} ({flown})")


def _mode(mission: Mission, survey: Survey) -> Iterator[Check]:
    adapter, vehicle = survey.session.adapter, survey.session.vehicle
    now = f"now {vehicle.mode_name} ({vehicle.mode}), {'armed' if vehicle.armed else 'disarmed'}"
    if vehicle.armed and vehicle.mode == adapter.guided_mode:
        yield Check(WARN, "mode", f"{now}: a flight would take the vehicle at once")
    else:
        who = "the flight asks for it" if mission.file.engage.request_mode else "the operator enters it"
        yield Check(PASS, "mode", f"flown in {adapter.guided_name} ({adapter.guided_mode}), {who}; {now}")


def _protocol(mission: Mission, survey: Survey) -> Iterator[Check]:
    heard = survey.connection.counts[VEHICLE]
    if heard.version_1:
        yield Check(WARN, "MAVLink", f"{heard.version_1} of {heard.frames} frames are of version 1")
    else:
        yield Check(PASS, "MAVLink", "version 2 only")


def _signing(mission: Mission, survey: Survey) -> Iterator[Check]:
    """Check that received frames are signed as the mission requires. No line if neither side signs."""
    heard = survey.connection.counts[VEHICLE]
    if mission.file.signing is None:
        if heard.signed:
            words = f"{heard.signed} of {heard.frames} frames are signed and we have no key"
            yield Check(WARN, "signing", f"{words}: what we send may be rejected; give it with [signing] key_file")
        elif heard.zero_key:
            words = "the autopilot signs with the all-zero key, as PX4 does until it is given one"
            yield Check(PASS, "signing", f"{words}: it takes unsigned frames, the link counts as unsigned")
    elif heard.refused:
        why = ", ".join(f"{count} {reason}" for reason, count in sorted(heard.refused.items()))
        yield Check(WARN, "signing", f"{heard.refused.total()} of {heard.frames} frames rejected: {why}")
    else:
        yield Check(PASS, "signing", f"{heard.signed} of {heard.frames} frames signed, all with our key")


def _company(mission: Mission, survey: Survey) -> Iterator[Check]:
    session, ours = survey.session, mission.file.link.component_id
    rivals = session.identity.rivals.recent(survey.end)
    if twins := session.ignored["twin"]:
        words = f"{twins} frames of another companion with our component id {ours}: change one of them"
        yield Check(FAIL, "others", words)
    if strangers := session.ignored["other_vehicle"]:
        also = f": {'; '.join(session.misfits.values())}" if session.misfits else ""
        advice = "" if mission.file.vehicle.system_id else "; name yours with vehicle.system_id"
        yield Check(WARN, "others", f"{strangers} heartbeats of another autopilot on the link{also}{advice}")
    if peripherals := session.ignored["no_autopilot"]:
        ids = "{}/{}".format(*session.vehicle_ids)
        words = f"{peripherals} heartbeats of a component that is no autopilot with the vehicle's ids {ids}"
        yield Check(WARN, "others", f"{words}: give it a component id of its own")
    for rival in rivals:
        of_driver = mission.ranging_driver is not None and rival.startswith(RADIO_NAME)
        advice = "ranging.beacon_id" if of_driver else "link.peer, or sign"
        yield Check(FAIL, "others", f"{rival}; name yours with {advice}")
    if not twins and not strangers and not rivals and not peripherals:
        yield Check(PASS, "others", "no other autopilot and no twin of ours on the link")


# --- telemetry --------------------------------------------------------------------------------------------------------


def _streams(mission: Mission, survey: Survey) -> Iterator[Check]:
    if (silence := survey.session.heartbeat_age(survey.end)) > SILENT:
        yield Check(FAIL, "heartbeat", f"the vehicle fell silent {silence:.1f} s before the end")
    if survey.session.streams.by_group:
        words = "SET_MESSAGE_INTERVAL is unsupported: old firmware, REQUEST_DATA_STREAM is used"
        yield Check(WARN, "stream", words)
    for message_id, (wanted, measured) in survey.streams.items():
        name = dialect.mavlink_map[message_id].msgname
        words = f"{name} {measured:.1f} Hz, {wanted:g} Hz asked for"
        if measured >= FULL_RATE * wanted:
            yield Check(PASS, "stream", words)
        elif measured >= LOW_RATE * wanted:
            yield Check(WARN, "stream", words)
        else:
            grade, without = _without(mission, survey, name)
            yield Check(grade, "stream", f"{words}: {without}")


def _without(mission: Mission, survey: Survey, name: str) -> tuple[Grade, str]:
    """Return the grade of a missing or slow stream, and its reason."""
    if name == "VFR_HUD" and (needs := _needs(mission, survey)):
        return FAIL, f"{' and '.join(sorted(needs))} come with it"
    if name == "ATTITUDE" and mission.file.vehicle.turn_gain == "learn":
        return FAIL, "the turn-rate gain is learnt from it"
    if name == "SYS_STATUS" and mission.file.bounds.min_battery_percent is not None:
        return FAIL, "bounds.min_battery_percent needs it"
    return (WARN, _TELLS[name]) if name in _TELLS else (FAIL, "the ranging comes with it")


_TELLS = {
    "HEARTBEAT": "a change of mode is seen late",
    "CURRENT_MODE": "a change of mode is seen by the heartbeat only, once a second",
    "SYSTEM_TIME": "a reboot is seen by ATTITUDE only",
    "SYS_STATUS": "the battery is not known",
    "ATTITUDE": "the heading is not known",
    "VFR_HUD": "height and airspeed are not known",
    "HOME_POSITION": "a home that is set anew is seen late",
}


def _motion(mission: Mission, survey: Survey) -> Iterator[Check]:
    session, needs = survey.session, _needs(mission, survey)
    motion = session.motion.at(survey.end)
    for name, unit, subject in (("airspeed", "m/s", "airspeed"), ("altitude", "m above sea level", "height")):
        value = getattr(motion, name)
        if value is not None:
            yield Check(PASS, subject, f"{value:.1f} {unit}" + ("" if name in needs else ", not needed"))
        elif name not in needs:
            yield Check(PASS, subject, "not known, not needed")
        elif name == "airspeed" and survey.airspeed == 0 and not session.vehicle.armed:
            yield Check(WARN, subject, "0 m/s: none before take-off; a flight engages only when there is one")
        else:
            whose = f"a {session.adapter.name}" if name in session.adapter.needs else "the mission"
            why = ": no VFR_HUD" if survey.airspeed is None else ""
            if name == "airspeed" and survey.airspeed is not None and isnan(survey.airspeed):
                why = ": VFR_HUD carries none (NaN), is there an airspeed sensor?"
            yield Check(FAIL, subject, f"not known{why}; {whose} needs it")


def _needs(mission: Mission, survey: Survey) -> frozenset[str]:
    bounds = mission.file.bounds
    bounded = (bounds.min_altitude_m, bounds.max_altitude_m) != (None, None)
    needed = bounded or mission.height.needs_altitude
    return survey.session.adapter.needs | ({"altitude"} if needed else frozenset())


def _battery(mission: Mission, survey: Survey) -> Iterator[Check]:
    least, battery = mission.file.bounds.min_battery_percent, survey.session.vehicle.battery(survey.end)
    if least is None:
        return
    if battery is None:
        yield Check(FAIL, "battery", f"not reported, the mission ends at {least:g} %")
    else:
        grade = PASS if battery > least else FAIL
        yield Check(grade, "battery", f"{battery:.0f} %, the mission ends at {least:g} %")


# --- time -------------------------------------------------------------------------------------------------------------


def _clock(mission: Mission, survey: Survey, clock_speed: float) -> Iterator[Check]:
    reboots, boot, trip = survey.session.vehicle.reboots, survey.boot, survey.session.timesync.typical
    if reboots:
        yield Check(FAIL, "clock", f"the autopilot rebooted {reboots} times while we listened")
    follows = mission.file.link.clock == "autopilot"
    if boot is None or boot[1][0] - boot[0][0] < LEAST_SPAN:
        words = "no boot time of the autopilot (SYSTEM_TIME, ATTITUDE): its reboot would not be seen"
        yield Check(FAIL if follows else WARN, "clock", words)
    else:
        speed = span_speed(boot) * clock_speed
        words = f"the autopilot's runs at {speed:.2f} of ours"
        if speed < SPEED_OFF:
            yield Check(FAIL, "clock", f"{words}: it stands still")
        elif follows:
            yield Check(PASS, "clock", f"{words}, and the run follows it")
        elif abs(speed - 1) > SPEED_OFF:
            yield Check(FAIL, "clock", f'{words}: set link.clock = "autopilot" to fly a simulator at this speed')
        else:
            yield Check(PASS, "clock", words)
    if trip is not None:
        most = mission.slowest_answer
        grade = PASS if trip < SLOW_ROUND_TRIP else WARN if trip <= most else FAIL
        words = f"{1000 * trip:.0f} ms to the autopilot and back (TIMESYNC), at most {1000 * most:.0f} ms"
        yield Check(grade, "round trip", words)
    else:
        yield Check(WARN, "round trip", "no answer to TIMESYNC: the delay of the link is not known")
