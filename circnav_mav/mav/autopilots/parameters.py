"""Rules for the autopilots' parameters: what the value of one implies for a flight. Each vehicle's file has its own."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import atan, ceil, degrees, hypot, isfinite, radians, sqrt, tan

from circnav_mav.mav.check_result import Check, Grade
from circnav_mav.mav.frames import GRAVITY

PASS, WARN, FAIL = Grade.PASS, Grade.WARN, Grade.FAIL
SHORT_TIMEOUT, LONG_TIMEOUT = 0.5, 5.0
"""Seconds of silence before the vehicle's own answer: shorter trips over a hiccup, longer flies on blind."""
SPEED_NEAR, SPEED_FAR = 0.05, 0.2
"""Fractions by which the speed that the autopilot holds may differ from the mission's: PASS, then WARN, then FAIL."""
COMMON_WIND = 8.0
"""Wind in which copters are commonly flown, m/s: a lean limit that allows less is worth a warning."""
ROUNDING = 1e-6
"""Fraction by which the vehicle's 2.3, reported in 32 bits, and the mission's may differ."""


@dataclass(frozen=True, slots=True)
class Context:
    """What a rule may know besides its value: the mission's speed (m/s), limits of turn rate (deg/s) and bank, bank at
    full stick (deg) and tick (s), the vehicle's system id, every parameter read, and the turn rate of the smallest
    circle (rad/s)."""

    speed: float
    max_turn_rate_deg: float
    max_bank_deg: float
    stick_bank_deg: float
    tick: float
    system: int
    values: Mapping[str, float]
    circle_turn_rate: float = 0.0


Verdict = tuple[Grade, str]
Judge = Callable[[float, Context], Verdict]


@dataclass(frozen=True, slots=True)
class Rule:
    """Rule for one parameter.

    names: in different versions, newest first, each with the factor to the unit that `judge` takes. optional: not every
    vehicle has it, no line when it is missing. unit: that `judge` takes. advised: function from the context to the
    value for this mission in that unit, an int if the parameter is one; None where airframe or operator decide.
    """

    names: tuple[tuple[str, float], ...]
    judge: Judge
    optional: bool = False
    unit: str = ""
    advised: Callable[[Context], float] | None = None

    def check(self, context: Context) -> Check | None:
        """The line of the parameter, also of one that the vehicle does not know unless it is optional."""
        for name, factor in self.names:
            if name in context.values:
                value = context.values[name]
                if not isfinite(value):
                    return Check(FAIL, "parameter", f"{name} = {value:g}: is not a number: set it anew")
                grade, words = self.judge(value * factor, context)
                meant = "" if factor == 1 else f" ({value * factor:g} {self.unit})"
                return Check(grade, "parameter", f"{name} = {value:g}{meant}: {words}")
        either = " or ".join(name for name, _ in self.names)
        words = f"{either}: no answer, this version may not have it"
        return None if self.optional else Check(WARN, "parameter", words)


def rule(name: str, judge: Judge, *, optional: bool = False, advised: Callable[[Context], float] | None = None) -> Rule:
    """Return the rule for a parameter that has one name and one unit in all versions."""
    return Rule(((name, 1.0),), judge, optional, advised=advised)


def always(value: float) -> Callable[[Context], float]:
    """Return the advice that does not depend on the mission."""
    return lambda context: value


def mission_speed(context: Context) -> float:
    """Return the mission's speed, m/s."""
    return float(context.speed)


def mission_bank(context: Context) -> float:
    """Return the mission's bank limit, deg."""
    return float(context.max_bank_deg)


def enough_speed(usual: float) -> Callable[[Context], float]:
    """Return the advice for a speed limit, m/s: the firmware's default, or 1.2 times the mission's speed."""
    return lambda context: max(usual, 1.2 * context.speed)


# --- judges that several vehicles share -------------------------------------------------------------------------------


def below(value: float, other: float) -> bool:
    """Whether a value is below another by more than what 32 bits and a change of units leave of equal ones."""
    return value < other - ROUNDING * abs(other)


def one_of(special: Mapping[int, Verdict], otherwise: Verdict) -> Judge:
    """By the value as a number."""
    return lambda value, context: special.get(int(value), otherwise)


def at_least(wanted: Callable[[Context], float], fits: str, lacks: str, grade: Grade = FAIL) -> Judge:
    """The value must reach what the mission wants; {:g} in the words is that."""

    def judge(value: float, context: Context) -> Verdict:
        number = wanted(context)
        return (grade, lacks.format(number)) if below(value, number) else (PASS, fits.format(number))

    return judge


def timeout(what_follows: str) -> Judge:
    """How long the vehicle flies on without setpoints, s."""

    def judge(seconds: float, context: Context) -> Verdict:
        words = f"{seconds:g} s after the last setpoint it {what_follows}"
        if seconds < 2 * context.tick:
            return FAIL, f"{words}: shorter than two of our ticks"
        if seconds < SHORT_TIMEOUT:
            return WARN, f"{words}: a short hiccup of the link is enough"
        if seconds > LONG_TIMEOUT:
            return WARN, f"{words}: it flies on blind for long"
        return PASS, words

    return judge


def held_airspeed(value: float, context: Context) -> Verdict:
    """The speed that the autopilot holds by itself, m/s."""
    off = abs(value / context.speed - 1)
    grade = PASS if off <= SPEED_NEAR else WARN if off <= SPEED_FAR else FAIL
    words = f"the autopilot holds {value:g} m/s, the mission counts on {context.speed:g}"
    return grade, words if grade is PASS else f"{words}: set vehicle.speed_mps to what is flown"


def least_airspeed(value: float, context: Context) -> Verdict:
    """The stall protection, m/s."""
    bound = f"the mission's {context.speed:g} m/s"
    return (FAIL, f"above {bound}") if below(context.speed, value) else (PASS, f"below {bound}")


most_airspeed = at_least(lambda mission: mission.speed, "above the mission's {:g} m/s", "below the mission's {:g} m/s")
bank_limit = at_least(
    lambda mission: mission.max_bank_deg,
    "the mission's bank limit of {:g} deg is within it",
    "the autopilot banks less than the {:g} deg that the mission counts on: lower vehicle.max_bank_deg",
)
COPTER_DRAG = 0.3
"""Drag of a bare quadrotor, 1/s, before a flight tells: simulated and flown ones have 0.15 to 1."""


def lean_limit(degrees_: float, context: Context) -> Verdict:
    """The lean that a copter may use: against the air at V plus wind, and to the inside of its circle, deg."""
    push, inward = GRAVITY * tan(radians(min(max(degrees_, 0.0), 80.0))), context.speed * context.circle_turn_rate
    wind = sqrt(max(push**2 - inward**2, 0.0)) / COPTER_DRAG - context.speed
    leans = f"it leans {degrees_:g} deg at most"
    if wind <= 0:
        return WARN, f"{leans}: at a drag of {COPTER_DRAG:g}/s too little for {context.speed:g} m/s even in still air"
    words = f"{leans}: at a drag of {COPTER_DRAG:g}/s {context.speed:g} m/s are held in wind up to {wind:.0f} m/s"
    return (PASS if wind >= COMMON_WIND else WARN), words


def enough_lean(usual: float) -> Callable[[Context], float]:
    """Return the advice for a lean limit, deg: the firmware's default, or the lean for COMMON_WIND on the circle."""

    def advised(context: Context) -> float:
        push = COPTER_DRAG * (context.speed + COMMON_WIND)
        return max(usual, ceil(degrees(atan(hypot(push, context.speed * context.circle_turn_rate) / GRAVITY))))

    return advised


velocity_limit = at_least(
    lambda mission: mission.speed,
    "the mission's {:g} m/s is within it",
    "slower than the mission's {:g} m/s: the autopilot may not fly it",
    WARN,
)
