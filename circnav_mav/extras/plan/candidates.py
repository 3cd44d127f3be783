"""Candidate circles of a plan, each with the checks of a mission and its expected figures."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import atan, ceil, degrees, pi

import numpy as np

from circnav_mav.extension import extensions, load
from circnav_mav.extras.plan.radius_error import radius_rms
from circnav_mav.guidance.laws import settling_time
from circnav_mav.guidance.types import GRAVITY
from circnav_mav.mav.check_result import PASS, Grade
from circnav_mav.mission.checks import (
    TURN_USED,
    check_mission,
    drift_allowed,
    drift_with_loop_margin,
)
from circnav_mav.mission.mission import Mission

MOST_USED = 0.9
"""Largest share of the vehicle's turn rate that a circle may need in wind and gusts. The rest
corrects errors. Chosen."""


@dataclass(frozen=True, slots=True)
class Site:
    """Conditions of a plan.

    smallest, largest: bounds of the radius, m.
    wind: steady wind, m/s.
    gusts: RMS of the gusts per axis, m/s.
    laps: number of laps to locate the beacon.
    """

    smallest: float
    largest: float
    wind: float
    gusts: float
    laps: float

    @property
    def strongest(self) -> float:
        """Wind with gusts, m/s."""
        # 2.0: strength of the gusts that are added to the wind, in standard deviations.
        return self.wind + 2.0 * self.gusts


@dataclass(frozen=True, slots=True)
class Candidate:
    """A circle and its expected figures.

    radius: m.
    speed: m/s.
    bank: mean bank of a plane or lean of a copter, deg, None for a rover.
    turn: turn rate in still air, deg/s.
    used: turn rate needed at the most downwind point, as a share of the vehicle's turn rate.
    most_wind: largest wind for this circle, m/s, None if the autopilot compensates the wind.
    lap: duration of a lap, s.
    flight: duration of approach and circles, s.
    rms: RMS of the radius error, m.
    place: standard deviation of the beacon's place, m, None without a locator.
    problems: subjects of the check lines that do not pass.
    """

    radius: float
    speed: float
    bank: float | None
    turn: float
    used: float
    most_wind: float | None
    lap: float
    flight: float
    rms: float
    place: float | None
    problems: tuple[str, ...]

    @property
    def sound(self) -> bool:
        return not self.problems


def smallest_radius(mission: Mission, wind: float) -> float:
    """Return the smallest radius, m, that the vehicle's turn rate permits.

    In still air the circle needs at most the share TURN_USED of the turn rate, in this wind at most
    MOST_USED.
    """
    orbit = mission.orbit
    able = orbit.max_turn_rate * mission.least_turn_gain
    return max(
        orbit.speed / (TURN_USED * able),
        (orbit.speed + wind) ** 2 / (MOST_USED * orbit.speed * able),
    )


def radii(least: float, site: Site) -> Sequence[float]:
    """Return the radii of the candidates, m, rounded up to whole meters."""
    low = max(least, site.smallest)
    # 6.0: largest radius of the candidates, as a multiple of the smallest one, if the site does not
    # limit the radius.
    high = min(site.largest, ceil(6.0 * low))
    # Replace a radius that would be rounded up above the largest radius by the largest radius. Then
    # at least one candidate remains, even if the smallest and the largest radius are less than a
    # meter apart.
    # 7: number of candidates; chosen.
    return sorted({min(float(ceil(one)), high) for one in np.geomspace(low, max(high, low), 7)})


def candidate(mission: Mission, site: Site) -> Candidate:
    """Return the figures of the mission's first circle."""
    orbit = mission.orbit
    gain = mission.least_turn_gain
    able = orbit.max_turn_rate * gain
    lap = 2 * pi * orbit.radius / orbit.speed
    allowed = drift_allowed(mission)
    kept = drift_with_loop_margin(mission, allowed)
    still = holds_ground_speed(mission)
    most = None if still else max(allowed if kept is None else kept, 0.0)
    wind = 0.0 if still else site.strongest
    banked = mission.file.vehicle.kind != "rover"
    # A vehicle that slips in turns (turn gain below 1) needs more bank than in a coordinated turn.
    bank = degrees(atan(orbit.speed**2 / (orbit.radius * GRAVITY * gain))) if banked else None
    failing = [line.subject for line in check_mission(mission) if line.grade is not PASS]
    if most is not None and most < wind:
        failing.append("wind")
    circling = site.laps * lap
    way = settling_time(min(5 * orbit.radius, mission.max_range), orbit.speed, orbit.radius, able)
    return Candidate(
        radius=orbit.radius,
        speed=orbit.speed,
        bank=bank,
        turn=degrees(abs(orbit.steady_turn_rate)),
        used=(orbit.speed + wind) ** 2 / (orbit.speed * orbit.radius * able),
        most_wind=most,
        lap=lap,
        flight=way + circling,
        rms=radius_rms(mission, site.gusts),
        place=position_sigma(mission, circling),
        problems=tuple(dict.fromkeys(failing)),
    )


def holds_ground_speed(mission: Mission) -> bool:
    """True if the autopilot compensates the wind, as ArduPilot's copters and rovers do."""
    return any(one.holds_ground_speed for one in mission.vehicles)


def position_sigma(mission: Mission, seconds: float) -> float | None:
    """Return the expected standard deviation of the beacon's place, m, if an extra computes it."""
    reference = next((one.position_forecast for one in extensions() if one.position_forecast), None)
    sigma: float | None = load(reference)(mission, seconds) if reference else None
    return sigma


def recommended(found: Sequence[Candidate]) -> tuple[Candidate, str]:
    """Return the recommended circle and the reason. Of the circles that pass all checks, the one
    with the shortest lap is recommended. If no circle passes, the circle with the fewest problems
    is recommended."""
    sound = [one for one in found if one.sound]
    if sound:
        best = min(sound, key=lambda one: one.lap)
        return best, "the shortest lap that passes every check in this wind and its gusts"
    best = min(found, key=lambda one: (len(one.problems), one.lap))
    return (
        best,
        (
            "no circle passes every check; this one has the fewest warnings"
            f" ({', '.join(best.problems)})"
        ),
    )


def fails(mission: Mission) -> Iterator[str]:
    """Yield the failing check lines of a mission."""
    for line in check_mission(mission):
        if line.grade is Grade.FAIL:
            yield f"{line.subject}: {line.text}"
