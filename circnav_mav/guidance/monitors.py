"""Monitors beside the law: too strong a drift, an airspeed error that
changes, a vehicle that does not approach the target, and ranges that contradict the turns."""

from cmath import rect
from math import exp, inf, pi
from typing import NamedTuple

from circnav_mav.guidance.laws import tolerated_drift
from circnav_mav.guidance.maths import REACHABLE, wrap
from circnav_mav.guidance.types import Orbit, RangeEstimate
from circnav_mav.timers import Hysteresis, LowPass


class DriftAlarm(NamedTuple):
    """Alarm for a drift (wind minus target motion) in which the circle cannot be held.

    on: True while raised.
    drift: newest trusted estimate, m/s.
    allowed: largest drift in which the circle can be held, m/s.
    """

    on: bool = False
    drift: float = 0.0
    allowed: float = 0.0


class DriftMonitor:
    """Compares the estimated drift with the drift that the circle allows."""

    def __init__(self) -> None:
        # 3.0: time, s, for which the drift must be too strong to raise the alarm. Single gusts also
        # change the estimated drift. 10.0: time, s, for which it must be weak enough to end the
        # alarm.
        self._strong = Hysteresis(raise_after=3.0, clear_after=10.0)
        self.alarm = DriftAlarm()

    def update(self, estimate: RangeEstimate | None, orbit: Orbit, most_turn: float) -> None:
        """Process an estimate. Without a trusted drift, the alarm is unchanged.

        estimate: None while the vehicle is not steered.
        most_turn: learned turn rate that the vehicle reaches, rad/s.
        """
        if estimate is None:
            self._strong.clear()
            self.alarm = DriftAlarm()
            return
        motion = estimate.relative
        if motion is None or not motion.trusted:
            self._strong.since = None
            return
        V = max(motion.airspeed, 0.1 * orbit.speed)
        allowed = max(tolerated_drift(V, orbit.radius, most_turn), 0.0)
        strong = self._strong.update(motion.drift > allowed, estimate.time)
        self.alarm = DriftAlarm(strong, motion.drift, allowed)


class AirspeedAlarm(NamedTuple):
    """Alarm for an airspeed sensor whose error changes in flight.

    The estimator mistakes such an error for a drift that turns with the nose. A wind does not turn:
    its component along the nose averages to 0 over a lap. A constant error of the airspeed cannot
    be distinguished from an error of the ranges: see `LapAlarm`.

    on: True while raised.
    excess: measured minus true airspeed, averaged over about a lap, m/s.
    usual: `excess` at the end of the first lap, None before.
    drift: mean drift, m/s, as a complex number.
    since: start of the average, s, or None.
    time: of the newest estimate, s.
    """

    on: bool = False
    excess: float = 0.0
    usual: float | None = None
    drift: complex = 0j
    since: float | None = None
    time: float = 0.0

    @property
    def change(self) -> float:
        """Change of the airspeed's error since the first lap, m/s."""
        return 0.0 if self.usual is None else self.excess - self.usual


def watch_airspeed(
    alarm: AirspeedAlarm, estimate: RangeEstimate | None, orbit: Orbit
) -> AirspeedAlarm:
    """Return the alarm after an estimate. Without a trusted drift, it restarts."""
    motion = estimate.relative if estimate is not None else None
    if estimate is None or motion is None or not motion.trusted:
        return AirspeedAlarm()
    if alarm.since is None:
        return AirspeedAlarm(since=estimate.time, time=estimate.time)
    lap = 2 * pi * orbit.radius / orbit.speed
    step = max(estimate.time - alarm.time, 0.0)
    # In the first lap, average over the time since the start of the average.
    keep = exp(-step / min(max(estimate.time - alarm.since, 0.1), lap))
    drift = complex(motion.drift_x, motion.drift_y)
    along = (drift * rect(1.0, -motion.heading)).real
    excess = motion.airspeed / motion.scale - motion.airspeed - along
    excess += keep * (alarm.excess - excess)
    drift += keep * (alarm.drift - drift)
    usual = alarm.usual
    if usual is None and estimate.time - alarm.since > lap:
        usual = excess
    new = AirspeedAlarm(alarm.on, excess, usual, drift, alarm.since, estimate.time)
    # Tolerance of the change, m/s. In wind the average along the nose is not exactly 0, because the
    # vehicle flies longer against the wind than with it. The low-pass also leaves 1/(2 pi) of an
    # oscillation with the period of a lap.
    W = abs(drift)
    most = 0.12 * orbit.speed + W**2 / orbit.speed + W / (2 * pi)
    return new._replace(on=abs(new.change) > most)


class ClosingAlarm(NamedTuple):
    """Alarm for a vehicle that does not come nearer, for example in wind above its airspeed.

    on: True while raised.
    r: newest range, m.
    drift: wind minus target motion, m/s, or None while it is unknown.
    airspeed: m/s.
    """

    on: bool = False
    r: float = 0.0
    drift: float | None = None
    airspeed: float = 0.0


class ClosingMonitor:
    """Compares the range rate of a vehicle outside its circle with its speed."""

    def __init__(self) -> None:
        # 3.0: time constant of the low-pass on the range rate, s.
        self._range_rate = LowPass(3.0)
        self._time = inf
        # 25.0: time without coming nearer, s, for an alarm. On good emulated vehicles it was at
        # most 16 s: the turn toward the target, and an acquisition that begins in the wrong
        # direction.
        self._stays_away = Hysteresis(raise_after=25.0, clear_after=10.0)
        # 10.0: the same time, s, while the estimated drift exceeds the airspeed. On good
        # vehicles in gusts it was at most 6 s.
        self._blown_away = Hysteresis(raise_after=10.0, clear_after=10.0)
        self.alarm = ClosingAlarm()

    def update(self, estimate: RangeEstimate | None, orbit: Orbit) -> None:
        """Process an estimate. estimate: None while the vehicle is not engaged. A vehicle outside
        the circle must come nearer at 5 % of its speed at least."""
        if estimate is None or estimate.r < 1.2 * orbit.radius:
            self._range_rate.clear()
            self._stays_away.clear()
            self._blown_away.clear()
            self.alarm = ClosingAlarm()
            return
        rate = self._range_rate.update(estimate.r_dot, max(estimate.time - self._time, 0.0))
        self._time = estimate.time
        motion = estimate.relative
        drift = None if motion is None else motion.drift
        airspeed = orbit.speed if motion is None else motion.airspeed
        away = rate > -0.05 * orbit.speed
        stays_away = self._stays_away.update(away, estimate.time)
        blown = away and drift is not None and drift > airspeed
        blown_away = self._blown_away.update(blown, estimate.time)
        self.alarm = ClosingAlarm(stays_away or blown_away, estimate.r, drift, airspeed)


class LapAlarm(NamedTuple):
    """Alarm for ranges that contradict the turns of a vehicle that circles the target.

    newest: newest estimate, None while the vehicle is not engaged.
    turned: turn of the heading since the beginning of the lap, rad.
    path: path length through the air since the beginning of the lap, m.
    blown: integral of the squared drift over airspeed along this path, m.
    least, most: smallest and largest range since the beginning of the lap, m.
    by_ranges: radius of the newest complete lap by the ranges, m.
    by_turns: radius of the newest complete lap by airspeed and turns, m.
    on: True while raised.
    """

    newest: RangeEstimate | None = None
    turned: float = 0.0
    path: float = 0.0
    blown: float = 0.0
    least: float = inf
    most: float = 0.0
    by_ranges: float = 0.0
    by_turns: float = 0.0
    on: bool = False


def watch_lap(alarm: LapAlarm, estimate: RangeEstimate | None, tolerance: float) -> LapAlarm:
    """Return the alarm after an estimate.

    estimate: None while the vehicle is not engaged.
    tolerance: largest difference of the two radii, as a share of the radius.

    A range offset of the radio or an error of the height changes the flown radius. The ranges do
    not show this error, but the airspeed and the duration of a lap show it.
    """
    if estimate is None:
        return LapAlarm()
    motion = estimate.relative
    if motion is None:
        return alarm
    before = alarm.newest
    lap = LapAlarm(estimate, by_ranges=alarm.by_ranges, by_turns=alarm.by_turns, on=alarm.on)
    if before is None or before.relative is None or estimate.time - before.time > 5.0:
        return lap
    # Use the measured airspeed: the estimated airspeed scale adapts to wrong ranges.
    airspeed = motion.airspeed / motion.scale
    turned = alarm.turned + wrap(motion.heading - before.relative.heading)
    flown = airspeed * (estimate.time - before.time)
    path = alarm.path + flown
    # w: drift over airspeed. Its square is averaged over the lap: when the wind changes, most of
    # the lap was flown in the previous wind.
    w = min(motion.drift / airspeed, REACHABLE) if motion.trusted else 0.0
    blown = alarm.blown + w**2 * flown
    least = min(alarm.least, estimate.r)
    most = max(alarm.most, estimate.r)
    # If the range changes during a full turn, the vehicle does not circle the target.
    if most - least > 0.1 * least:
        return lap
    if abs(turned) < 2 * pi:
        return lap._replace(turned=turned, path=path, blown=blown, least=least, most=most)
    # In the drift w the mean duration of a lap is (1 - w^2/4)/(1 - w^2) times that in still air, up
    # to terms of fourth order.
    square = blown / path
    by_turns = path / (2 * pi) * (1 - square) / (1 - square / 4)
    if most - least > 0.1 * by_turns:
        return lap
    by_ranges = (most + least) / 2
    on = abs(by_turns / by_ranges - 1) > tolerance
    return lap._replace(by_ranges=by_ranges, by_turns=by_turns, on=on)
