"""F10 to F13: values, noise, repetition and timestamps of the ranges, changed on the way from the
vehicle."""

from collections.abc import Callable
from functools import partial
from typing import Any

from tests.frames import read, rewritten
from tests.tools.faults.cell import FRESH, Scenario, Want
from tests.tools.faults.cell import tampered as by_tamper
from tests.tools.faults.course import Course
from tests.tools.faults.scenarios.line import PX4
from tests.tools.faults.tampering import (
    Change,
    every,
    noise,
    offset,
    on,
    outliers,
    quantised,
    scaled,
    sometimes,
    stamps,
    stuck,
)

HOLD = Want.HOLD
REGAIN = Want.REGAIN
SLOW = {"px4_copter": REGAIN}
"""Required reaction after 10 s without ranges: the PX4 copter leaves its circle and must regain it.
The other vehicles must hold it."""
RANGE = 132
NAMED = 251
WRAP = 2**32 / 1000
FLYING = ("arducopter", "arduplane", *PX4)
NAMED_RANGING = ('ranging.message="named_value_float"', 'sim.ranging.message="named_value_float"')


def tampered(
    fault: str, level: str, change: Callable[[int], Change], number: int = RANGE, **more: Any
) -> Scenario:
    """Return a scenario that changes the ranging radio's frames. change: function of the seed that
    returns the change."""
    arrange = by_tamper(lambda seed: on(number, change(seed)))
    return Scenario(fault, level, arrange=arrange, **more)


def value(
    level: str, *rejects: str, quick: bool = False, profiles: tuple[str, ...] = (), **fields: float
) -> Scenario:
    """Return a scenario in which a fifth of the ranges has this invalid value."""
    change = partial(sometimes, 0.2, **fields)
    return tampered("F10", level, change, rejects=rejects, quick=quick, profiles=profiles)


def named(level: str, reject: str, number: float) -> Scenario:
    change = partial(sometimes, 0.2, value=number)
    return tampered(
        "F10", f"named value {level}", change, NAMED, rejects=(reject,), overrides=NAMED_RANGING
    )


VALUES = [
    value("0 cm", "no_range", quick=True, current_distance=0),
    value("1 cm", "overhead", profiles=FLYING, current_distance=1),
    value("1 cm on the ground", "gated", profiles=("ardurover",), current_distance=1),
    value("65534 cm", "gated", current_distance=65534),
    value("65535 cm", "no_range", current_distance=65535),
    value("below min", "below_min", min_distance=65000, max_distance=0),
    value("at max", "no_range", max_distance=1),
    value("quality 1", "poor_quality", signal_quality=1),
    value("quality 0", signal_quality=0),
    value("covariance 0", covariance=0),
    value("covariance 1", covariance=1),
    value("downward sensor", orientation=25),
    named("NaN", "not_finite", float("nan")),
    named("+inf", "not_finite", float("inf")),
    named("-inf", "not_finite", float("-inf")),
    named("-1", "no_range", -1.0),
    named("0", "no_range", 0.0),
    named("1e30", "above_max", 1e30),
]

NOISE = [
    *(
        tampered("F11", f"noise {sigma:g} m", partial(noise, sigma), want=want)
        for sigma, want in ((0.05, HOLD), (0.5, HOLD), (1.0, HOLD), (2.0, REGAIN))
    ),
    *(
        tampered(
            "F11",
            f"outliers {p} %, 2 to 50 m",
            partial(outliers, p / 100, (2.0, 50.0)),
            want=want,
            quick=p == 10,
        )
        for p, want in ((1, HOLD), (5, HOLD), (10, HOLD), (20, REGAIN), (30, REGAIN))
    ),
    tampered("F11", "+5 m for 5 s", lambda seed: offset(5.0), lasts=5.0, want=REGAIN),
    *(
        tampered(
            "F11",
            f"{level} for 20 s",
            partial(scaled, share),
            lasts=20.0,
            reported="RANGE JUMPED",
            **more,
        )
        for level, share, more in (
            ("twice the range", 2.0, {"want": REGAIN, "quick": True}),
            # with ranges again, the rover needs most of a lap (42 s)
            ("feet for meters", 3.28, {"want": REGAIN, "regain": {"ardurover": 40.0}}),
        )
    ),
    *(
        tampered("F11", f"steps of {step:g} m", lambda seed, s=step: quantised(s))
        for step in (0.01, 0.1, 1.0)
    ),
]


def repeating(seconds: float, *, new_stamps: bool, quick: bool = False) -> Scenario:
    """The range is constant. The rules for setpoints apply even before this fault can be
    detected."""
    level = f"stuck {seconds:g} s, {'new stamps' if new_stamps else 'same stamp'}"
    more = {"lasts": seconds, "after": 50.0, "want": REGAIN, "quick": quick}
    return tampered("F12", level, lambda seed: stuck(new_stamps=new_stamps), **more)


def restamped(frame: bytes, now: float) -> list[bytes]:
    """Each range is sent 5 times with slightly newer timestamps, as by an autopilot that sends its
    last range again."""
    stamp = read(frame).time_boot_ms
    return [rewritten(frame, time_boot_ms=stamp + 10 * n) for n in range(5)]


STUCK = [
    *(repeating(s, new_stamps=False, quick=s == 10) for s in (0.5, 2, 10, 30)),
    *(repeating(s, new_stamps=True) for s in (0.5, 2, 5, 10, 30)),
    tampered("F12", "2.5 Hz", lambda seed: every(4)),
    tampered("F12", "1 Hz", lambda seed: every(10), want=REGAIN),
    tampered("F12", "each frame 5 times", lambda seed: lambda frame, now: [frame] * 5),
    tampered("F12", "each value 5 times, new stamps", lambda seed: restamped, clocks=True),
]


def beside(**fields: int) -> Callable[[int], Change]:
    """A second sensor of the same radio measures another target at the same times."""

    def change(seed: int) -> Change:
        return lambda frame, now: [
            frame,
            rewritten(frame, current_distance=4000 + round(10 * now) % 50, **fields),
        ]

    return change


def setpoint_rate_low(course: Course) -> str | None:
    """Return a fault if circnav sends a setpoint for each range, so 100 or 1,000 per second."""
    sent = [time for time, _ in course.vehicle.setpoint_log if time > course.now - 10.0]
    most = 10.0 / (0.75 * course.pilot.settings.file.limits.tick) + 1
    return f"{len(sent)} setpoints in 10 s, at most {most:.0f}" if len(sent) > most else None


def refused(level: str, key: str, **fields: int) -> Scenario:
    """Two range sources from the start: circnav must not engage, and must report the key that
    selects a source."""
    more = {
        "want": Want.REFUSE,
        "reason": f"select yours by ranging.{key}",
        "quick": key == "sensor_id",
        **FRESH,
    }
    return tampered("F25", level, beside(**fields), profiles=("arducopter", "arduplane"), **more)


SENSORS = [
    refused("second sensor from the start", "sensor_id", id=9),
    refused("other orientation from the start", "orientation", orientation=2),
]
SENSORS += [
    tampered(
        "F25",
        "second sensor, ours is named",
        beside(id=9),
        want=Want.ENGAGE,
        overrides=("ranging.sensor_id=0",),
        **FRESH,
    ),
    tampered("F25", "second sensor in flight", beside(id=9), rejects=("other_sensor",), quick=True),
]
RATES = [
    Scenario(
        "F25",
        f"ranges at {hz} Hz",
        overrides=(f"sim.ranging.rate_hz={hz}.0", f"ranging.rate_hz={hz}.0"),
        lasts=20.0,
        after=10.0,
        check=setpoint_rate_low,
        profiles=("arducopter", "arduplane"),
        quick=hz == 100,
    )
    for hz in (100, 1000)
]


def stamped(level: str, shift: Callable[[float, float], float], **more: Any) -> Scenario:
    """Return a scenario that changes the timestamps of the radio only."""
    return tampered("F13", level, lambda seed: stamps(shift), clocks=True, **more)


def _alternating(shift: float) -> Callable[[float, float], float]:
    return lambda stamp, now: stamp + shift * (int(now * 5) % 2)


STAMPS = [
    stamped("frozen", lambda stamp, now: 100.0, want=REGAIN),
    stamped("zero", lambda stamp, now: 0.0),
    *(stamped(f"{ms} ms ahead", lambda stamp, now, ms=ms: stamp + ms / 1000) for ms in (40, 100)),
    stamped("400 ms ahead", lambda stamp, now: stamp + 0.4, want=REGAIN, quick=True),
    stamped(
        *("every other 400 ms ahead", _alternating(0.4)),
        want=REGAIN,
        # After a minute without ranges, the estimator first uses a wrong position of the target.
        regain={"px4_copter": 80.0},
    ),
    stamped("one sample back", lambda stamp, now: stamp - 0.1),
    *(stamped(f"{s:+g} s", lambda stamp, now, s=s: stamp + s, on=SLOW) for s in (1, -1, 3600)),
    stamped("epoch instead of boot", lambda stamp, now: stamp + 1_000_000.0, quick=True),
    stamped("back to boot", lambda stamp, now: stamp - 100.0),
    stamped("wrap of 49.7 days", lambda stamp, now: stamp + WRAP - 130.0),
    stamped("200 ppm fast", lambda stamp, now: stamp * (1 + 200e-6)),
    stamped("200 ppm slow", lambda stamp, now: stamp * (1 - 200e-6)),
    stamped("two clocks by turns, 1 h apart", _alternating(3600.0), want=Want.SAFE),
    stamped("random within 1 s", lambda stamp, now: stamp + (stamp * 7919.0) % 1.0, want=Want.SAFE),
]
RANGING = [*VALUES, *NOISE, *STUCK, *SENSORS, *RATES, *STAMPS]
