"""Rules that judge autopilot parameters for a flight. The rules of each vehicle are in the file of
its adapter."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import atan, ceil, degrees, hypot, isfinite, radians, sqrt, tan
from typing import NamedTuple

from circnav_mav.guidance.types import GRAVITY
from circnav_mav.mav.check_result import Check, Grade

PASS = Grade.PASS
WARN = Grade.WARN
FAIL = Grade.FAIL
SHORT_TIMEOUT = 0.5
"""Least setpoint timeout without a warning, s. A shorter timeout expires in a short link outage."""
LONG_TIMEOUT = 5.0
"""Largest setpoint timeout without a warning, s. During a longer timeout the vehicle flies on
without control."""
SPEED_NEAR = 0.05
"""Largest difference between the autopilot's and the mission's airspeed that gives PASS, as a
fraction."""
SPEED_FAR = 0.2
"""Largest difference between the autopilot's and the mission's airspeed that gives WARN, as a
fraction. A larger difference gives FAIL."""
COMMON_WIND = 8.0
"""Common wind for copter flights, m/s. A lean limit too small for this wind gives a warning."""


@dataclass(frozen=True, slots=True)
class Context:
    """Inputs of a rule besides its value.

    speed: m/s, max_turn_rate_deg: deg/s, max_bank_deg: deg, tick: s, all from the mission.
    system: id of the vehicle.
    values: all parameters read from the vehicle, by name.
    circle_turn_rate: turn rate on the smallest circle of the mission, rad/s.
    """

    speed: float
    max_turn_rate_deg: float
    max_bank_deg: float
    tick: float
    system: int
    values: Mapping[str, float]
    circle_turn_rate: float = 0.0


Verdict = tuple[Grade, str]
Judge = Callable[[float, Context], Verdict]
"""Function that grades the value of a parameter, with a text for the operator."""


class Name(NamedTuple):
    """Name of a parameter in some versions of the firmware.

    factor: factor from the vehicle's unit to the unit of the rule.
    since, until: first and last version with this name. Empty if all supported versions on that
        side have it.
    """

    name: str
    factor: float = 1.0
    since: str = ""
    until: str = ""

    def __str__(self) -> str:
        versions = " ".join(
            f"{word} {version}"
            for word, version in (("from", self.since), ("up to", self.until))
            if version
        )
        return f"{self.name} ({versions})" if versions else self.name


@dataclass(frozen=True, slots=True)
class Rule:
    """Rule for one parameter.

    names: names of the parameter in different firmware versions, newest first.
    optional: True if some vehicles lack the parameter. A missing optional parameter gives no
        result.
    unit: unit of the value for `judge`.
    advised: function from the context to the recommended value in `unit`, an int for an integer
        parameter. None if the right value depends on airframe or operator.
    also: names of further parameters that `judge` reads from the context.
    """

    names: tuple[Name, ...]
    judge: Judge
    optional: bool = False
    unit: str = ""
    advised: Callable[[Context], float] | None = None
    also: tuple[str, ...] = ()

    @property
    def requested(self) -> tuple[str, ...]:
        """Names to request from the vehicle."""
        return (*(name.name for name in self.names), *self.also)

    def check(self, context: Context, when: str = "") -> Check | None:
        """Return the result for the parameter. A missing parameter gives a warning, or None if it
        is optional.

        when: part of the flight that the result applies to, for the operator. Empty: all of it.
        """
        for name, factor, *_ in self.names:
            if name in context.values:
                value = context.values[name]
                if not isfinite(value):
                    return Check(
                        FAIL, "parameter", f"{name} = {value:g}: is not a number: set it again"
                    )
                grade, words = self.judge(value * factor, context)
                meant = "" if factor == 1 else f" ({value * factor:g} {self.unit})"
                return Check(grade, "parameter", f"{name} = {value:g}{meant}: {when}{words}")
        either = " or ".join(map(str, self.names))
        words = f"{either}: no answer, this version may not have it"
        return None if self.optional else Check(WARN, "parameter", words)


def rule(
    name: str,
    judge: Judge,
    *,
    optional: bool = False,
    advised: Callable[[Context], float] | None = None,
) -> Rule:
    """Return the rule for a parameter that has one name and one unit in all versions."""
    return Rule((Name(name),), judge, optional, advised=advised)


def always(value: float) -> Callable[[Context], float]:
    """Return a function that advises this value for every mission."""
    return lambda context: value


def mission_speed(context: Context) -> float:
    """Return the mission's speed, m/s."""
    return float(context.speed)


def mission_bank(context: Context) -> float:
    """Return the mission's bank limit, deg."""
    return float(context.max_bank_deg)


def enough_speed(usual: float) -> Callable[[Context], float]:
    """Return the advice for a speed limit, m/s: the larger of the firmware's default and 1.2 times
    the mission's speed."""
    return lambda context: max(usual, 1.2 * context.speed)


# --- judges that several vehicles share


def below(value: float, other: float) -> bool:
    """True if `value` is below `other` by more than the rounding of single precision and unit
    conversion."""
    # 1e-6: largest rounding error of a vehicle's 32-bit value, as a fraction.
    return value < other - 1e-6 * abs(other)


def one_of(special: Mapping[int, Verdict], otherwise: Verdict) -> Judge:
    """Return a judge with one verdict for each listed integer value, and `otherwise` for all other
    values."""
    return lambda value, context: special.get(int(value), otherwise)


def at_least(
    wanted: Callable[[Context], float], fits: str, lacks: str, grade: Grade = FAIL
) -> Judge:
    """Return a judge of a parameter that must be at least `wanted`, a value from the mission. {:g}
    in the texts is replaced by this value."""

    def judge(value: float, context: Context) -> Verdict:
        number = wanted(context)
        return (
            (grade, lacks.format(number)) if below(value, number) else (PASS, fits.format(number))
        )

    return judge


def timeout(what_follows: str) -> Judge:
    """Return a judge of the setpoint timeout, s. what_follows: action of the vehicle after the
    timeout."""

    def judge(seconds: float, context: Context) -> Verdict:
        words = f"{seconds:g} s after the last setpoint the vehicle {what_follows}"
        if seconds < 2 * context.tick:
            return FAIL, f"{words}: shorter than two steps (limits.tick_hz)"
        if seconds < SHORT_TIMEOUT:
            return WARN, f"{words}: a short outage of the link is enough"
        if seconds > LONG_TIMEOUT:
            return WARN, f"{words}: a long time without control"
        return PASS, words

    return judge


def held_airspeed(value: float, context: Context) -> Verdict:
    """Judge the airspeed that the autopilot holds, m/s."""
    off = abs(value / context.speed - 1)
    grade = PASS if off <= SPEED_NEAR else WARN if off <= SPEED_FAR else FAIL
    words = f"the autopilot holds {value:g} m/s, vehicle.speed_mps = {context.speed:g}"
    return grade, words if grade is PASS else f"{words}: set vehicle.speed_mps = {value:g}"


def least_airspeed(value: float, context: Context) -> Verdict:
    """Judge the autopilot's least airspeed (stall protection), m/s."""
    bound = f"the mission's {context.speed:g} m/s"
    return (FAIL, f"above {bound}") if below(context.speed, value) else (PASS, f"below {bound}")


most_airspeed = at_least(
    lambda mission: mission.speed, "above the mission's {:g} m/s", "below the mission's {:g} m/s"
)
bank_limit = at_least(
    lambda mission: mission.max_bank_deg,
    "enough for the mission's {:g} deg",
    "below the mission's {:g} deg, so the autopilot banks less: lower vehicle.max_bank_deg",
)
COPTER_DRAG = 0.3
"""Default drag coefficient of a bare quadrotor, 1/s. Simulated and flown copters have 0.15 to 1."""


def lean_limit(degrees_: float, context: Context) -> Verdict:
    """Judge the lean limit of a copter, deg. A copter leans against the drag of the airflow, at
    most V plus wind, and toward the center of its circle."""
    acceleration = GRAVITY * tan(radians(min(max(degrees_, 0.0), 80.0)))
    inward = context.speed * context.circle_turn_rate
    wind = sqrt(max(acceleration**2 - inward**2, 0.0)) / COPTER_DRAG - context.speed
    leans = f"the copter leans {degrees_:g} deg at most"
    if wind <= 0:
        words = (
            f"too little lean for {context.speed:g} m/s even in still air (assumed drag"
            f" {COPTER_DRAG:g}/s)"
        )
        return WARN, f"{leans}: {words}"
    words = (
        f"{leans}: at a drag of {COPTER_DRAG:g}/s it holds {context.speed:g} m/s in wind up to"
        f" {wind:.0f} m/s"
    )
    return (PASS if wind >= COMMON_WIND else WARN), words


def enough_lean(usual: float) -> Callable[[Context], float]:
    """Return the advice for a lean limit, deg: the larger of the firmware's default and the lean
    for COMMON_WIND on the circle."""

    def advised(context: Context) -> float:
        drag = COPTER_DRAG * (context.speed + COMMON_WIND)
        return max(
            usual,
            ceil(degrees(atan(hypot(drag, context.speed * context.circle_turn_rate) / GRAVITY))),
        )

    return advised


velocity_limit = at_least(
    lambda mission: mission.speed,
    "enough for the mission's {:g} m/s",
    "below the mission's {:g} m/s: the autopilot may not reach the speed of the mission",
    WARN,
)
