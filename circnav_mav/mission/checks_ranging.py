"""Checks of a mission's ranging before a flight."""

from collections.abc import Iterator
from math import hypot, inf, sqrt

from circnav_mav.guidance.maths import MAX_SIGMA_GROWTH, radius_sensitivity
from circnav_mav.mav.check_result import FAIL, PASS, WARN, Check, graded
from circnav_mav.mav.ranging.table import RANGING_MESSAGES
from circnav_mav.mission.mission import Mission

LOOP_BOUND = 0.4
"""Loop gain V |d omega/d r'| (turn lag + filter lag) above which `check` warns, with turn rate
omega and range rate r'. Above about 0.45 the laws fly a limit cycle."""
REACH = 0.8
"""Largest slant range on the circle, as a share of the largest range that the message can
report."""
ROOM = 0.1
"""Distance between the circle and the bounds of the range below which `check` warns, as a share of
the radius."""


def check_ranging(mission: Mission) -> list[Check]:
    """Return all check lines about ranging."""
    parts = (_reach, _bounds, _radio, _calibration, _sampling, _noise, _slant)
    return [line for part in parts for line in part(mission)]


def _reach(mission: Mission) -> Iterator[Check]:
    slant = _slant_range(mission, mission.orbit.radius)
    farthest = mission.max_range
    words = (
        f"range on the circle {slant:.1f} m, {mission.file.ranging.message} reports up to"
        f" {_length(farthest)}"
    )
    share = f"{100 * slant / farthest:.0f} %, at most {100 * REACH:.0f} %"
    yield Check(
        graded(slant / farthest, warn_above=REACH / 2, fail_above=REACH),
        "reach",
        f"{words} ({share})",
    )


def _slant_range(mission: Mission, horizontal: float) -> float:
    """Return the slant range that the radio measures at a horizontal range, m."""
    return hypot(horizontal, mission.file.orbit.height_above_target_m or 0.0)


def _length(metres: float) -> str:
    return f"{metres:.1f} m" if metres < 1e4 else f"{metres / 1000:.0f} km"


def _bounds(mission: Mission) -> Iterator[Check]:
    """Check that the circle lies between the bounds of the range, with room for oscillations."""
    nearest = mission.file.bounds.min_range_m
    farthest = mission.file.bounds.max_range_m
    radius = mission.orbit.radius
    if mission.farthest is None:
        remedy = "set it to 1.5 times the range of the start"
        words = f"no bounds.max_range_m: the flight may lead away to any range; {remedy}"
        yield Check(WARN, "bounds", words)
    given = [] if nearest is None else [f"above bounds.min_range_m = {nearest:g} m"]
    given += [] if farthest is None else [f"below bounds.max_range_m = {farthest:g} m"]
    if not given:
        return
    used = max((nearest or 0.0) / radius, radius / (farthest or inf))
    words = (
        f"the circle of {radius:g} m must be {' and '.join(given)} (horizontal), with"
        f" {100 * ROOM:.0f} % to spare"
    )
    yield Check(graded(used, warn_above=1 / (1 + ROOM), fail_above=1.0), "bounds", words)
    if farthest is not None and _slant_range(mission, farthest) > mission.max_range:
        end = f"{mission.file.ranging.message} reports up to {_length(mission.max_range)}"
        yield Check(WARN, "bounds", f"bounds.max_range_m = {farthest:g} m has no effect: {end}")


def _radio(mission: Mission) -> Iterator[Check]:
    table = mission.file.ranging
    message = RANGING_MESSAGES[table.message]
    if why := message.why_never(mission.ranging):
        yield Check(FAIL, "ranging", why)
    if not message.forwarded and table.endpoint is None:
        remedy = "set ranging.endpoint, unless the radio itself sends to link.endpoint"
        yield Check(WARN, "ranging", f"ArduPilot and PX4 do not forward {message.type}: {remedy}")


def _calibration(mission: Mission) -> Iterator[Check]:
    """Report the range that the radio reports on the circle, and check that the calibration points
    cover the circle."""
    calibration = mission.file.ranging.calibration
    if not calibration.is_set:
        return
    slant = _slant_range(mission, mission.orbit.radius)
    words = (
        f"{calibration.describe()}: {slant:.1f} m on the circle are reported as"
        f" {calibration.reported(slant):.1f} m"
    )
    yield Check(PASS, "calibration", words)
    points = calibration.points
    if points and not points[0][0] <= slant <= points[-1][0]:
        span = f"{points[0][0]:g} to {points[-1][0]:g} m"
        yield Check(
            WARN,
            "calibration",
            f"ranging.points_m covers {span}, the range on the circle is {slant:.1f} m: add a point"
            " near it",
        )


def _sampling(mission: Mission) -> Iterator[Check]:
    period = 1 / mission.file.ranging.rate_hz
    stale = mission.stale
    words = (
        f"a range every {period:.3f} s, stale after {stale:.3g} s (at least two ranges in this"
        " time)"
    )
    yield Check(graded(period / stale, warn_above=0.5, fail_above=1.0), "sampling", words)
    if mission.law.name == "switching":
        turn = min(mission.law.gain, mission.orbit.max_turn_rate) * period
        bounds = "above 0.05 rad it slowly drifts off the circle, above 0.5 rad it leaves it"
        words = f"the vehicle turns {turn:.3f} rad between two ranges ({bounds})"
        yield Check(graded(turn, warn_above=0.05, fail_above=0.5), "switching", words)


def _noise(mission: Mission) -> Iterator[Check]:
    orbit = mission.orbit
    file = mission.file
    steady = mission.tuning.steady_estimate(orbit.radius)
    share = steady.r_dot_sigma / orbit.speed
    error = (
        f"estimated range rate ±{steady.r_dot_sigma:.2f} m/s at a range noise of"
        f" {file.ranging.sigma_m:g} m"
    )
    words = f"{error}, {100 * share:.0f} % of the speed (at most 50 %), {steady.lag:.2f} s late"
    yield Check(graded(share, warn_above=0.2, fail_above=0.5), "rate error", words)
    if mission.law.name == "smooth":
        loop = (
            2
            * mission.law.gain
            * orbit.radius
            * orbit.speed
            * mission.tuning.loop_lag(orbit.radius)
        )
        lags = f"turn lag {file.vehicle.turn_lag_s:g} s + filter lag {steady.lag:.2f} s"
        words = f"2 k r_d V ({lags}) = {loop:.2f}: above {LOOP_BOUND:g} the radius oscillates"
        yield Check(
            graded(loop, warn_above=LOOP_BOUND, fail_above=4 * LOOP_BOUND), "damping", words
        )


def _slant(mission: Mission) -> Iterator[Check]:
    radius = mission.orbit.radius
    height = mission.file.orbit.height_above_target_m
    if mission.file.orbit.needs_altitude:
        yield Check(
            PASS,
            "height",
            "above the target, from the vehicle's altitude in flight; preflight prints the current"
            " height",
        )
    elif height is None:
        none = (
            "none of orbit.height_above_target_m, target_altitude_m, target_above_home_m is given"
        )
        cost = (
            f"at a height of half the radius, the circle is {100 * (1 - sqrt(0.75)):.0f} % too"
            " small"
        )
        yield Check(WARN, "height", f"{none}: ranges are taken as horizontal ({cost})")
    else:
        growth = sqrt(radius**2 + height**2) / radius
        counts = (
            f"removing the height multiplies the range noise by {growth:.2f} (at most"
            f" {MAX_SIGMA_GROWTH:g}). {radius_sensitivity(radius, height)}"
        )
        grade = graded(growth, warn_above=1.5, fail_above=MAX_SIGMA_GROWTH)
        yield Check(grade, "height", f"{height:g} m above the target: {counts}")
