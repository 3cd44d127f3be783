"""What is said of the vehicle and the ranging before a flight: observations in, lines out. Nothing here listens."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from math import hypot, isnan, sqrt
from statistics import median

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mission.checks import Check, Grade
from circnav_mav.mission.mission import Mission
from circnav_mav.mission.param_rules import Context, judge_parameters
from circnav_mav.pilot import RANGING, VEHICLE
from circnav_mav.pilot.survey import Observations, RangeHeard, VehicleSeen

PASS, WARN, FAIL = Grade.PASS, Grade.WARN, Grade.FAIL
FLOWN = {dialect.MAV_AUTOPILOT_ARDUPILOTMEGA: "ArduPilot 4.6.3", dialect.MAV_AUTOPILOT_PX4: "PX4 main of 2026-03"}
"""The firmware whose behaviour the adapters were written for."""
FULL_RATE, LOW_RATE = 0.8, 0.5
"""Fractions of a wanted rate: PASS from the first, FAIL or WARN below the second."""
NOISE_NEAR, NOISE_FAR = 1.5, 4.0
"""Measured over assumed noise: PASS up to the first, FAIL above the second."""
MOST_REJECTED = 0.1
MOST_OUTLIERS = 0.05
MAD = 1.4826
"""Standard deviation over median absolute deviation of a Gaussian."""
FAR = 5.0
SPEED_OFF = 0.03
"""Fraction by which the autopilot's clock may differ from ours; beyond, it is a simulator at another speed."""
SLOW_ROUND_TRIP = 0.1
LATE = 0.1
TROUBLE = ("prearm", "arm:", "failsafe", "failed", "error", "unhealthy", "denied", "variance")
"""Words of a STATUSTEXT that are worth repeating."""


def judge(mission: Mission, seen: Observations, clock_speed: float = 1.0) -> list[Check]:
    """All lines. clock_speed: seconds of the run's clock per real second where the run follows the autopilot."""
    vehicle = seen.vehicle
    if vehicle is None:
        return [Check(FAIL, "vehicle", f"none that the mission means; {_why_none(seen)}")]
    lines = [
        *_identity(mission, seen, vehicle),
        *_streams(mission, vehicle),
        *_motion(vehicle),
        *_battery(mission, vehicle),
        *_clock(mission, vehicle, clock_speed),
        *_ranging(mission, seen, vehicle),
    ]
    lines += judge_parameters(vehicle.adapter, Context(mission, vehicle.system, vehicle.parameters))
    return lines + [Check(WARN, "says", f'"{text}"') for text in vehicle.texts if _troubled(text)]


def _why_none(seen: Observations) -> str:
    return "; ".join(seen.misfits) if seen.misfits else f"no autopilot heartbeat, {seen.links[VEHICLE]}"


def _troubled(text: str) -> bool:
    return any(word in text.lower() for word in TROUBLE)


# --- who it is --------------------------------------------------------------------------------------------------------


def _identity(mission: Mission, seen: Observations, vehicle: VehicleSeen) -> Iterator[Check]:
    adapter = vehicle.adapter
    who = f"system {vehicle.system}, component {vehicle.component}: {vehicle.kind}, flown as {adapter.name}"
    yield Check(PASS, "vehicle", who)
    if vehicle.firmware is None:
        yield Check(WARN, "firmware", "no answer to a request for AUTOPILOT_VERSION")
    else:
        yield Check(
            PASS, "firmware", f"{vehicle.firmware} (the messages we send were flown on {FLOWN[adapter.autopilot]})"
        )
    yield _mode(mission, vehicle)
    if seen.version_1:
        yield Check(WARN, "MAVLink", f"{seen.version_1} of {seen.frames} frames are of version 1")
    else:
        yield Check(PASS, "MAVLink", "version 2 only")
    yield from _signing(mission, seen)
    yield from _company(mission, seen)


def _signing(mission: Mission, seen: Observations) -> Iterator[Check]:
    """Whether the frames heard are signed as the mission wants them; nothing where nobody signs."""
    if mission.file.signing is None:
        if seen.signed:
            words = f"{seen.signed} of {seen.frames} frames are signed and we have no key: what we send may be refused"
            yield Check(WARN, "signing", f"{words}; give it with [signing] key_file")
        return
    if refused := sum(seen.refused.values()):
        why = ", ".join(f"{count} {reason}" for reason, count in sorted(seen.refused.items()))
        yield Check(WARN, "signing", f"{refused} of {seen.frames} frames refused: {why}")
    else:
        yield Check(PASS, "signing", f"{seen.signed} of {seen.frames} frames signed, all with our key")


def _mode(mission: Mission, vehicle: VehicleSeen) -> Check:
    adapter = vehicle.adapter
    ours = f"{adapter.mode_names[adapter.guided_mode]} ({adapter.guided_mode})"
    now = f"now {vehicle.mode_name} ({vehicle.mode}), {'armed' if vehicle.armed else 'disarmed'}"
    if vehicle.armed and vehicle.mode == adapter.guided_mode:
        return Check(WARN, "mode", f"{now}: a flight would take the vehicle at once")
    who = "the flight asks for it" if mission.file.engage.request_mode else "the operator enters it"
    return Check(PASS, "mode", f"flown in {ours}, {who}; {now}")


def _company(mission: Mission, seen: Observations) -> Iterator[Check]:
    ours = mission.file.link.component_id
    if twins := seen.others.get("twin"):
        yield Check(
            FAIL, "others", f"{twins} frames of another companion with our component id {ours}: change one of them"
        )
    if strangers := seen.others.get("other_vehicle"):
        also = f": {'; '.join(seen.misfits)}" if seen.misfits else ""
        advice = "" if mission.file.vehicle.system_id else "; name yours with vehicle.system_id"
        yield Check(WARN, "others", f"{strangers} heartbeats of another autopilot on the link{also}{advice}")
    if not twins and not strangers:
        yield Check(PASS, "others", "no other autopilot and no twin of ours on the link")


# --- what it tells ----------------------------------------------------------------------------------------------------


def _streams(mission: Mission, vehicle: VehicleSeen) -> Iterator[Check]:
    if vehicle.heartbeat_age > 2.0:
        yield Check(FAIL, "heartbeat", f"the vehicle fell silent {vehicle.heartbeat_age:.1f} s before the end")
    for message_id, (wanted, measured) in vehicle.streams.items():
        name = dialect.mavlink_map[message_id].msgname
        words = f"{name} {measured:.1f} Hz, {wanted:g} Hz asked for"
        if measured >= FULL_RATE * wanted:
            yield Check(PASS, "stream", words)
        elif measured >= LOW_RATE * wanted:
            yield Check(WARN, "stream", words)
        else:
            grade, without = _without(mission, vehicle, name)
            yield Check(grade, "stream", f"{words}: {without}")


def _without(mission: Mission, vehicle: VehicleSeen, name: str) -> tuple[Grade, str]:
    """How bad it is when a stream is missing or thin, and why."""
    if name == "VFR_HUD" and vehicle.adapter.needs:
        return FAIL, f"{' and '.join(sorted(vehicle.adapter.needs))} come with it"
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
}


def _motion(vehicle: VehicleSeen) -> Iterator[Check]:
    needs = vehicle.adapter.needs
    for name, unit, subject in (("airspeed", "m/s", "airspeed"), ("altitude", "m above sea level", "height")):
        value = getattr(vehicle.motion, name)
        if value is not None:
            yield Check(PASS, subject, f"{value:.1f} {unit}" + ("" if name in needs else ", not needed"))
        elif name not in needs:
            yield Check(PASS, subject, "not known, not needed")
        elif name == "airspeed" and vehicle.airspeed_told == 0 and not vehicle.armed:
            yield Check(WARN, subject, "0 m/s: none before take-off; a flight engages only when there is one")
        else:
            yield Check(FAIL, subject, f"not known{_why_unknown(name, vehicle)}; a {vehicle.adapter.name} needs it")


def _why_unknown(name: str, vehicle: VehicleSeen) -> str:
    if vehicle.airspeed_told is None:
        return ": no VFR_HUD"
    if name == "airspeed" and isnan(vehicle.airspeed_told):
        return ": VFR_HUD carries none (NaN), is there an airspeed sensor?"
    return ""


def _battery(mission: Mission, vehicle: VehicleSeen) -> Iterator[Check]:
    least = mission.file.bounds.min_battery_percent
    if least is None:
        return
    if vehicle.battery is None:
        yield Check(FAIL, "battery", f"not told, the mission ends at {least:g} %")
    else:
        grade = PASS if vehicle.battery > least else FAIL
        yield Check(grade, "battery", f"{vehicle.battery:.0f} %, the mission ends at {least:g} %")


# --- time -------------------------------------------------------------------------------------------------------------


def _clock(mission: Mission, vehicle: VehicleSeen, clock_speed: float) -> Iterator[Check]:
    if vehicle.reboots:
        yield Check(FAIL, "clock", f"the autopilot rebooted {vehicle.reboots} times while we listened")
    follows = mission.file.link.clock == "autopilot"
    if vehicle.boot is None or vehicle.boot[1][0] - vehicle.boot[0][0] < 1.0:
        grade = FAIL if follows else WARN
        yield Check(
            grade, "clock", "no boot time of the autopilot (SYSTEM_TIME, ATTITUDE): its reboot would not be seen"
        )
    else:
        speed = _boot_speed(vehicle.boot) * clock_speed
        words = f"the autopilot's runs at {speed:.2f} of ours"
        if speed < SPEED_OFF:
            yield Check(FAIL, "clock", f"{words}: it stands still")
        elif follows:
            yield Check(PASS, "clock", f"{words}, and the run follows it")
        elif abs(speed - 1) > SPEED_OFF:
            yield Check(FAIL, "clock", f'{words}: set link.clock = "autopilot" to fly a simulator at this speed')
        else:
            yield Check(PASS, "clock", words)
    if vehicle.round_trip is not None:
        trip, most = vehicle.round_trip, mission.file.limits.round_trip_s
        grade = PASS if trip < SLOW_ROUND_TRIP else WARN if trip <= most else FAIL
        words = f"{1000 * trip:.0f} ms to the autopilot and back (TIMESYNC), limits.round_trip_s {1000 * most:.0f} ms"
        yield Check(grade, "round trip", words)
    else:
        yield Check(WARN, "round trip", "no answer to TIMESYNC: the delay of the link is not known")


def _boot_speed(boot: tuple[tuple[float, float], tuple[float, float]]) -> float:
    """Seconds of the autopilot per second of the run."""
    (began, at_first), (ended, at_last) = boot
    return (at_last - at_first) / (ended - began) if ended > began else 1.0


# --- ranging ----------------------------------------------------------------------------------------------------------


def _ranging(mission: Mission, seen: Observations, vehicle: VehicleSeen) -> Iterator[Check]:
    yield _heard(mission, seen)
    yield _rejected(mission, seen)
    ranges = seen.ranges
    if len(ranges) >= 10:
        yield from _noise(mission, ranges)
    if ranges:
        yield _age(mission, seen)
        yield from _stamps(mission, ranges, vehicle)
        yield _height(mission, ranges)


def _heard(mission: Mission, seen: Observations) -> Check:
    message = mission.file.ranging.message.upper()
    if not seen.ranges:
        if seen.carriers:
            heard = "; ".join(f"{count} of {sender}" for sender, count in sorted(seen.carriers.items()))
            return Check(FAIL, "ranging", f"no usable {message}. Heard: {heard}. Compare with the mission's [ranging]")
        link = seen.links[RANGING if mission.file.ranging.endpoint else VEHICLE]
        return Check(FAIL, "ranging", f"no {message}; {link}")
    wanted, stale = mission.file.ranging.rate_hz, mission.file.limits.stale_s
    rate = len(seen.ranges) / seen.seconds
    grade = FAIL if rate < 1 / stale else PASS if rate >= FULL_RATE * wanted else WARN
    return Check(
        grade,
        "ranging",
        f"{len(seen.ranges)} ranges in {seen.seconds:.1f} s, {rate:.1f} Hz, the mission says {wanted:g} Hz; "
        f"newest {seen.ranges[-1].r:.2f} m",
    )


def _rejected(mission: Mission, seen: Observations) -> Check:
    """Messages of other senders do no harm where the mission names ours."""
    table = mission.file.ranging
    named = table.component_id is not None or table.system_id is not None
    counts = {reason: count for reason, count in seen.rejected.items() if not (named and reason == "wrong_source")}
    words = ", ".join(f"{count} {reason}" for reason, count in sorted(seen.rejected.items())) or "none"
    share = sum(counts.values()) / max(sum(counts.values()) + len(seen.ranges), 1)
    if "wrong_source" in counts:
        return Check(WARN, "rejected", f"{words}: several senders, name yours with ranging.component_id")
    return Check(WARN if share > MOST_REJECTED else PASS, "rejected", words)


def _noise(mission: Mission, ranges: Sequence[RangeHeard]) -> Iterator[Check]:
    residuals = _residuals(ranges)
    noise, assumed = _spread(residuals), median(one.sigma for one in ranges)
    ratio = noise / assumed
    grade = PASS if ratio <= NOISE_NEAR else WARN if ratio <= NOISE_FAR else FAIL
    advice = "" if grade is PASS else ": set ranging.sigma_m to it"
    yield Check(grade, "noise", f"{noise:.2f} m standard deviation, {assumed:.2f} m assumed{advice}")
    gate = mission.file.guidance.gate_sigma * assumed
    outliers = sum(abs(residual) > gate for residual in residuals) / 3  # each shows in three second differences
    share = outliers / len(residuals)
    grade = PASS if share <= MOST_OUTLIERS else WARN
    yield Check(grade, "outliers", f"about {100 * share:.0f} % of the ranges are off by more than {gate:.1f} m")


def _spread(residuals: Sequence[float]) -> float:
    """Standard deviation of the bulk: from the median, and again without what lies far beyond the first answer."""
    sizes = list(map(abs, residuals))
    first = MAD * median(sizes)
    return MAD * median(size for size in sizes if size <= FAR * first)


def _residuals(ranges: Sequence[RangeHeard]) -> list[float]:
    """Each range against the line through its neighbours, scaled to the noise of one: blind to a steady motion, and
    nearly so to a turn (a second difference of 1 m/s^2 at 10 Hz is 4 mm)."""
    out = []
    for (a, b), (_, c) in pairwise(pairwise(ranges)):
        if not a.time < b.time < c.time:
            continue
        share = (b.time - a.time) / (c.time - a.time)
        line = a.r + share * (c.r - a.r)
        out.append((b.r - line) / hypot(1.0, share, 1 - share))
    return out or [0.0]


def _age(mission: Mission, seen: Observations) -> Check:
    age = seen.end - seen.ranges[-1].time
    delays = sorted(one.arrival - one.time for one in seen.ranges)
    late = delays[int(0.95 * (len(delays) - 1))]
    stale = mission.file.limits.stale_s
    grade = FAIL if age > stale else WARN if late > LATE else PASS
    return Check(
        grade,
        "age",
        f"newest {age:.2f} s old (stale from {stale:g} s); 95 % come within {1000 * late:.0f} ms of the quickest "
        "(a constant delay cannot be seen)",
    )


def _stamps(mission: Mission, ranges: Sequence[RangeHeard], vehicle: VehicleSeen) -> Iterator[Check]:
    """Whether the messages' own times are of use; nothing where the autopilot's clock says why they are not."""
    if mission.file.ranging.stamp == "arrival":
        yield Check(PASS, "stamps", "arrival times, as the mission says")
        return
    if all(one.stamp == one.arrival for one in ranges):
        words = 'the messages carry no time: arrival counts, delay and all (ranging.stamp = "arrival")'
        yield Check(WARN, "stamps", words)
        return
    first, last = ranges[0], ranges[-1]
    if last.arrival - first.arrival < 1.0:
        yield Check(WARN, "stamps", "too few to tell whether the sensor's clock is usable")
        return
    speed = (last.stamp - first.stamp) / (last.arrival - first.arrival)
    words = f"the sensor's clock runs at {speed:.3f} of ours"
    if abs(speed - 1) <= SPEED_OFF:
        yield Check(PASS, "stamps", words)
    elif vehicle.boot is None or abs(speed / (_boot_speed(vehicle.boot) or 1.0) - 1) > SPEED_OFF:
        yield Check(FAIL, "stamps", f'{words}: its stamps are of no use, set ranging.stamp = "arrival"')


def _height(mission: Mission, ranges: Sequence[RangeHeard]) -> Check:
    height, r = mission.file.orbit.height_above_target_m or 0.0, ranges[-1].r
    if r <= height:
        return Check(
            WARN,
            "distance",
            f"{r:.1f} m is less than the {height:g} m of orbit.height_above_target_m: fine on the ground only",
        )
    return Check(
        PASS, "distance", f"{r:.1f} m, {sqrt(r * r - height * height):.1f} m on the map at the mission's height"
    )
