"""A cell of the fault matrix: the flight of one vehicle with one fault at one level, and its pass
criteria."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import partial
from math import inf, sqrt
from typing import Any

from circnav_mav.pilot import Ending
from circnav_mav.runtime.listeners import Listeners
from circnav_mav.runtime.status import StatusSource
from tests.tools.fault_link import CLEAN, Impairment
from tests.tools.fault_link.link import Intruder, Tamper
from tests.tools.faults.course import BAND, SETTLED, Course, Keys, on_the_circle

LAW = "auto"
"""Law of the missions: the default."""
REGAIN_WITHIN = {"px4_copter": 60.0}
"""Largest time to regain the circle after a fault, s, by profile; 30 s for other profiles. The PX4
copter has more time, because one lap takes 63 s. The time for the straight path back to the circle
is added, because the autopilot's timeout may move the vehicle: a plane loiters round the point
where it entered GUIDED."""
FRESH_PATIENCE = 150.0
LAST = 10.0
"""Last part of a flight in which the direction of rotation is checked, s. The radius error does not
show a mirrored circle."""
LEAVE_WITHIN = 13.0
"""Time limit for the exit action to take effect, or for the setpoints to end without it, s."""


Arrange = Callable[[Course, int], None]
"""Callback(flight, seed): adds faults to a flight."""


class Want(Enum):
    """Required reaction of a vehicle to a fault. The rules for setpoints always apply."""

    HOLD = "holds the circle"
    REGAIN = "regains the circle"
    END = "ends the mission"
    ENGAGE = "engages"
    REFUSE = "does not engage"
    SAFE = "breaks no rule"


@dataclass(frozen=True)
class Scenario:
    """One fault at one level.

    up, down: impairments of the link.
    arrange: function that adds other faults at the start, called with the flight and the seed.
    lasts, after: time with the fault and time after it, s.
    want: required reaction.
    on: exceptions from `want`, by profile.
    regain: exceptions from REGAIN_WITHIN, s, by profile.
    reason: required text of the outcome.
    rejects: rejection reasons that must be counted.
    blind: part of the age of a range that circnav cannot measure, s.
    clocks: True if the fault changes timestamps, so that they do not give the age.
    fresh: True if the fault begins with the mission, and not on the circle.
    keys: signing keys of circnav and of the vehicle.
    reported: text that must be shown to the operator during the fault.
    """

    fault: str
    level: str
    up: Impairment = CLEAN
    down: Impairment = CLEAN
    arrange: Arrange | None = None
    lasts: float = 60.0
    after: float = 40.0
    want: Want = Want.HOLD
    reason: str = ""
    rejects: tuple[str, ...] = ()
    blind: float = 0.0
    clocks: bool = False
    fresh: bool = False
    stream: bool = False
    overrides: tuple[str, ...] = ()
    quick: bool = False
    on: Mapping[str, Want] = field(default_factory=dict)
    regain: Mapping[str, float] = field(default_factory=dict)
    check: Callable[[Course], str | None] | None = None
    profiles: tuple[str, ...] = ()
    keys: Keys = (None, None)
    reported: str = ""


FRESH: dict[str, Any] = {"fresh": True, "lasts": FRESH_PATIENCE, "after": 0.0}
"""Options of a scenario about the start of a flight."""


def tampered(make: Callable[[int], Tamper]) -> Arrange:
    """Return an arrangement of a tamper, which is made from the seed."""
    return lambda course, seed: course.link.tampers.append(make(seed))


def intruded(make: Callable[[int], Intruder]) -> Arrange:
    """Return an arrangement of another sender at the trusted address, made from the seed."""
    return lambda course, seed: course.link.intruders.append(make(seed))


@dataclass(frozen=True)
class Verdict:
    """Result of a cell. recovery: time from the end of the fault until the radius error stays
    within the band, s; None: it does not. swing: largest radius error after the first return to the
    band, as a share of the radius."""

    faults: tuple[str, ...]
    rms: float
    worst_age: float
    to_safe: float | None
    recovery: float | None
    swing: float
    rejects: Mapping[str, int]
    outcome: str
    engaged: bool
    reported: tuple[str, ...]

    @property
    def passed(self) -> bool:
        return not self.faults


def fly(
    scenario: Scenario, profile: str, seed: int, law: str = LAW, settling: float = SETTLED
) -> Verdict:
    """Fly a cell by a law and evaluate the pass criteria. seed: of the faults; other seeds than 1
    also change the noise of the vehicle. settling: least time of the flight before the fault, s."""
    noise = () if seed == 1 else (f"sim.seed={seed}",)
    overrides = tuple(dict.fromkeys((f'guidance.law="{law}"', *noise, *scenario.overrides)))
    make = Course if scenario.fresh else partial(on_the_circle, seconds=settling)
    course = make(profile, overrides, stream=scenario.stream, keys=scenario.keys)
    start = course.now
    end = start + scenario.lasts
    before = Counter(course.pilot.tracker.ranging.rejected)
    backward = course.spy.backward
    _begin(course, scenario, seed)
    shown = ShownTexts(course)
    course.fly(end, shown.look if scenario.reported else None)
    _finish(course)
    during = course.errors(start, end)
    course.way_home = abs(during[-1][1]) * course.radius / course.allowed.speed if during else 0.0
    course.fly(end + max(scenario.after, regain_within(scenario, profile, 0.0) + 10))
    rejects = Counter(course.pilot.tracker.ranging.rejected) - before
    rms = sqrt(sum(e * e for _, e in during) / len(during)) if during else inf
    recovery, swing = _recovery(course, end)
    wanting = _want_fault(course, scenario, rms, recovery)
    outcome = course.pilot.mission.outcome
    to_safe = _to_safe(course, start)
    _part(course)
    own = scenario.check(course) if scenario.check else None
    backward = 0 if scenario.clocks else course.spy.backward - backward
    checks = (
        *_age_faults(course, scenario),
        (bool(wanting), wanting),
        (backward > 0, f"{backward} samples fused twice or backwards"),
        *_count_faults(scenario, rejects, "\n".join(shown.lines)),
        (own is not None, own or ""),
    )
    return Verdict(
        (*course.broken[:3], *(text for fault, text in checks if fault)),
        rms,
        course.worst_told_age if scenario.clocks else course.worst_age,
        to_safe,
        recovery,
        swing,
        dict(rejects),
        outcome.reason if outcome else "",
        course.pilot.mission.engaged_at is not None,
        tuple(shown.lines),
    )


def regain_within(scenario: Scenario, profile: str, default: float) -> float:
    """Return the time allowed to regain the circle, s, without the way back."""
    return (REGAIN_WITHIN | scenario.regain).get(profile, default)


class ShownTexts:
    """Texts shown to the operator: alarms, waiting conditions and texts of the vehicle."""

    def __init__(self, course: Course) -> None:
        self._watch = StatusSource(course.pilot, Listeners())
        self._next = course.now
        self.lines: dict[str, None] = {}

    def look(self, course: Course) -> None:
        """Collect the texts at 2 Hz and at the end."""
        if course.ticks and (course.now >= self._next or course.pilot.done):
            self._next = course.now + 0.5
            status = self._watch.status(course.ticks[-1], course.now)
            refused = (f"{why} frames refused" for why in course.pilot.frames_refused())
            vehicle_texts = (
                f'the vehicle reports "{text}"' for text in course.pilot.session.vehicle.texts
            )
            self.lines |= dict.fromkeys(
                line
                for line in (*status.alarms, status.view.waits, *refused, *vehicle_texts)
                if line
            )


def _begin(course: Course, scenario: Scenario, seed: int) -> None:
    since = course.now
    up, down = (_shifted(one, since) for one in (scenario.up, scenario.down))
    link = type(course.link)(up=up, down=down, seed=seed)
    course.link = link
    if scenario.arrange is not None:
        scenario.arrange(course, seed)


def _finish(course: Course) -> None:
    """End the fault. Frames that were already delayed by the link still arrive."""
    course.link.impair()
    course.link.tampers.clear()
    course.link.intruders.clear()
    course.intruders.clear()


def _part(course: Course) -> None:
    """End a flight that is still in progress by a stall of 1 s and then a signal. The rules for
    setpoints apply to both."""
    if course.pilot.done:
        return
    course.stall(1.0)
    course.fly(course.now + 2.5)
    course.interrupt()
    course.fly(course.now + LEAVE_WITHIN)
    if not course.pilot.done:
        course.broken.append(
            f"still {course.pilot.mission.phase.value} {LEAVE_WITHIN:g} s after the signal"
        )


def _shifted(impairment: Impairment, by: float) -> Impairment:
    """Return the impairment with its outages relative to the start of the fault."""
    return replace(
        impairment, outages=tuple((since + by, until + by) for since, until in impairment.outages)
    )


def _recovery(course: Course, end: float) -> tuple[float | None, float]:
    """Return recovery and swing, as in `Verdict`."""
    late = course.errors(end, inf)
    outside = [time for time, error in late if abs(error) > BAND]
    back = next((time for time, error in late if abs(error) < BAND), inf)
    swing = max((abs(error) for time, error in late if time > back), default=inf)
    if not late or (outside and outside[-1] >= late[-1][0] - 1.0):
        return None, swing
    return (outside[-1] - end if outside else 0.0), swing


def _to_safe(course: Course, start: float) -> float | None:
    """Return the time from the start of the fault to the safe setpoint, s. If no safe setpoint was
    allowed: to the last steering setpoint. None: the mission was neither aborted nor taken over."""
    outcome = course.pilot.mission.outcome
    if outcome is None or outcome.ending not in (Ending.ABORTED, Ending.TAKEN_OVER):
        return None
    if course.safe_at is not None:
        return course.safe_at - start
    return course.steered_at[-1] - start if course.steered_at else 0.0


def _age_faults(course: Course, scenario: Scenario) -> list[tuple[bool, str]]:
    """Return pairs: True if a range was too old, and the text."""
    stale = course.pilot.settings.stale
    told, true = course.worst_told_age, course.worst_age
    bound = stale + scenario.blind + scenario.down.delay + scenario.down.jitter + 1e-3
    return [
        (told > stale + 1e-6, f"steered by a range {told:.2f} s old, bound {stale:g} s"),
        (
            not scenario.clocks and true > bound,
            f"steered by a range truly {true:.2f} s old, bound {bound:.2f} s",
        ),
    ]


def _count_faults(
    scenario: Scenario, rejects: Mapping[str, int], texts: str
) -> Iterator[tuple[bool, str]]:
    """Yield pairs: True if a text was not shown or a rejection not counted, and the text."""
    unseen = scenario.reported not in texts
    yield unseen, f"the operator was not shown {scenario.reported!r} but {texts!r}"
    for name in scenario.rejects:
        yield not rejects.get(name), f"no reject counted as {name}"


def _want_fault(course: Course, scenario: Scenario, rms: float, recovery: float | None) -> str:
    """Return the difference from the required reaction; empty: none."""
    want = scenario.on.get(course.profile, scenario.want)
    outcome = course.pilot.mission.outcome
    if outcome is not None and want in (Want.HOLD, Want.REGAIN, Want.END) and course.timed_out:
        return ""
    state = outcome.reason if outcome else course.pilot.mission.phase.value
    allowed = regain_within(scenario, course.profile, 30.0) + course.way_home
    took = "not" if recovery is None else f"in {recovery:.0f} s"
    ended = outcome is not None and scenario.reason in outcome.reason
    engaged = course.pilot.mission.engaged_at is not None
    regained = [
        (
            outcome is None and recovery is not None and recovery <= allowed,
            f"circle regained {took}, {state}",
        ),
        (course.goes_round_as_wanted(LAST), "the circle is flown the wrong way round"),
    ]
    has_ended = (ended, f"should have ended with {scenario.reason!r}: {state}")
    required = {
        Want.HOLD: [
            (outcome is None and rms < BAND, f"circle not held: RMS {100 * rms:.1f} %, {state}"),
            *regained,
        ],
        Want.REGAIN: regained,
        Want.END: [has_ended],
        Want.ENGAGE: [(engaged, f"did not engage: {state}")],
        Want.REFUSE: [(not engaged, "engaged all the same"), has_ended],
        Want.SAFE: [],
    }
    return next((text for met, text in required[want] if not met), "")
