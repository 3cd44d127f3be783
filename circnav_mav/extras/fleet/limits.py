"""Spacing settings that a mission allows, and the fleet limits printed by `check`."""

from collections.abc import Iterator
from math import degrees, pi, radians

from circnav_mav.extras.fleet.law import (
    MAX_SPEED_SHARE,
    SpacingSettings,
    evenness_floor,
    least_time_to_even,
)
from circnav_mav.extras.fleet.settings import FleetTable
from circnav_mav.mav.check_result import FAIL, PASS, WARN, Check
from circnav_mav.mission.mission import Mission

COMPASS_SIGMA = radians(2.0)
"""Standard deviation of the error of a typical calibrated compass, rad."""
LEAST_GAP = 25.0
"""Smallest distance between neighbors on the circle, m, at which they need no different height
layers."""
AUTO_LAWS = ("auto", "drift")


def spacing_settings(mission: Mission, member: int) -> SpacingSettings:
    """Return the spacing settings of a member. The mission's circle limits bound the requested
    changes."""
    orbit = mission.orbit
    limits = mission.circle_limits
    tightest = orbit.speed / (limits.turn_gain * orbit.max_turn_rate)
    # 1.0: distance kept from the bounds, m.
    inward = orbit.radius - max(limits.nearest, tightest) - 1.0
    outward = limits.farthest - orbit.radius - 1.0
    return SpacingSettings(
        member=member,
        radius=orbit.radius,
        speed=orbit.speed,
        sense=orbit.direction.turn_sign,
        speed_share=0.0 if limits.keeps_speed else MAX_SPEED_SHARE,
        # A copter changes only its speed for the spacing: the speed is enough, and the circle stays
        # the same.
        inward=0.0 if mission.file.vehicle.kind == "copter" else max(inward, 0.0),
        outward=max(outward, 0.0),
    )


def fleet_limits(mission: Mission, table: FleetTable) -> Iterator[Check]:
    """Yield checks of the law, the fleet size, the evenness, the time to reach this evenness, and
    the ranges per second."""
    assert table.id is not None
    if mission.file.guidance.law not in AUTO_LAWS:
        words = (
            f"the law {mission.file.guidance.law} does not estimate the phase: set guidance.law ="
            ' "auto"'
        )
        yield Check(FAIL, "fleet", words)
    orbit = mission.orbit
    n = table.size
    settings = spacing_settings(mission, table.id)
    by_distance = int(2 * pi * orbit.radius / LEAST_GAP)
    # 4.0: smallest gap of an even ring, in units of the expected largest gap error.
    too_many = (m for m in range(2, 256) if 2 * pi / m < 4.0 * evenness_floor(m, COMPASS_SIGMA))
    by_phase = next(too_many, 256) - 1
    why = "because of compass errors" if by_phase < by_distance else f"{LEAST_GAP:g} m apart"
    words = (
        f"{n} members; a radius of {orbit.radius:g} m takes at most {min(by_distance, by_phase)},"
        f" {why}"
    )
    yield Check(FAIL if n > min(by_distance, by_phase) else PASS, "fleet size", words)
    floor = f"worst gap {degrees(evenness_floor(n, COMPASS_SIGMA)):.1f} deg rms"
    words = f"{floor} with compass errors of {degrees(COMPASS_SIGMA):g} deg"
    if settings.most > 0:
        seconds = least_time_to_even(n, orbit.speed / orbit.radius, settings.most)
        yield Check(
            PASS,
            "fleet evenness",
            f"{words}; from one place, evenly spaced after at least {seconds:.0f} s",
        )
    else:
        remedy = "enlarge orbit.radius_m or the bounds"
        yield Check(
            FAIL,
            "fleet evenness",
            f"bounds and turn rate leave no room beside the circle: {remedy}",
        )
    rate = mission.file.ranging.rate_hz
    words = (
        f"if a two-way beacon has {rate:g} Hz in all, each of {n} members gets {rate / n:.1f} Hz"
    )
    if table.ranging is not None:
        yield _member_ranging(mission, table.ranging)
    # 1.0: smallest rate of ranges of one member, Hz, for estimating the relative motion.
    grade = WARN if rate / n < 1.0 else PASS
    yield Check(grade, "fleet ranging", f"{words}: set ranging.rate_hz to the rate of one member")


def _member_ranging(mission: Mission, first: int) -> Check:
    """Return the check of the ranges between members, whose radios have ids above `first`."""
    ranging = mission.file.ranging
    if ranging.message != "ranging_beacon" or ranging.beacon_id is None:
        words = 'needs ranging.message = "ranging_beacon" and ranging.beacon_id'
        return Check(FAIL, "fleet.ranging", f"{words}, to distinguish the beacon from the members")
    if first < ranging.beacon_id <= first + 255:
        words = f"ranging.beacon_id = {ranging.beacon_id} is one of the ids of the members' radios"
        return Check(FAIL, "fleet.ranging", f"{words}, {first + 1} to {first + 255}")
    return Check(PASS, "fleet.ranging", f"the radio of member n has the id {first} + n")
