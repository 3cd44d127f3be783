"""Giving a position back to an autopilot that has lost its own: MAV_CMD_EXTERNAL_POSITION_ESTIMATE every few seconds.

Never while the autopilot has an absolute position of any kind, or when nobody says whether it has; never again to an
autopilot that does not know the command, answers what nobody understands, or accepts and does nothing.
"""

from cmath import phase, rect
from dataclasses import dataclass, replace
from math import hypot
from typing import Any

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.extras.locate.export import position_estimate
from circnav_mav.extras.locate.place import Place, Plane
from circnav_mav.guidance.types import OwnMotion, RangeEstimate, RelativeMotion
from circnav_mav.mav.codec import Message
from circnav_mav.mav.commands import RESULT_NAMES

RECEIVERS = ("GPS_RAW_INT", "GPS2_RAW")
FIX_3D, SILENT = 3, 3.0
"""Their fix_type from which a position is one, and the silence, s, after which a word counts no more."""
FUSES = {
    "EKF_STATUS_REPORT": dialect.EKF_POS_HORIZ_ABS,
    "ESTIMATOR_STATUS": dialect.ESTIMATOR_PRED_POS_HORIZ_ABS,
}
"""The flag of each estimator's report that an absolute position is fused. ArduPilot's falls 10 s after the last one of
GPS, vision or beacons (NavEKF3's posTimeout), and a position that is given back does not raise it. PX4's absolute one
stays up in dead reckoning by airspeed; its predicted one is GNSS or an auxiliary position, and falls after 7 s."""
REPORTS = {
    "ardupilot": dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
    "px4": dialect.MAVLINK_MSG_ID_ESTIMATOR_STATUS,
}
"""Message ids, by firmware."""
LOST_FOR = 2.0
"""Time, s, that there must have been no position."""
ANSWER_PATIENCE, MOST_SILENT = 2.0, 3
"""Time, s, for an answer, and as long again until the next position, for it may come late; so many in a row without one
are enough."""
AFTER_FAILED = 10.0
"""Time, s, until the next try after FAILED: the autopilot has a position after all, or none to set anew."""
LOOK_AFTER, EFFECT, MOST_WITHOUT = 0.5, 30.0, 3
"""When, s, after an acceptance the reported position is looked at; how far, m, it may be from the one that was given;
so many in a row without effect are enough."""
LEAST_SIGMA, MOST_SIGMA = 1.0, 300.0
"""Standard deviation, m, that is told at least (PX4 resets hard below it); of a position that helps nobody any more: an
autopilot by itself was some km off."""
MOST_GIVEN = 10_000
"""Newest positions that are kept for handback.csv: 2.7 hours of one per second."""
PLACE_SIGMA = 15.0
"""Standard deviation of the beacon's place, m, above which no position is made from it; chosen."""
COMPASS_SIGMA = 0.03
"""What is not known of the compass, rad, where its bias was learnt; three times that where it was not."""
WIND_SIGMA, STRAYS = 0.3, 0.6
"""Error of the wind in dead reckoning, m/s, and with that of its gusts and of the airspeed."""
WIND_MEMORY, SCALE_MEMORY = 40.0, 300.0
"""Times, s, over which that wind is averaged, about a lap, and the scale of the airspeed, which hardly changes. The
drift of one moment has its gust and the slip of the nose, and .7 m/s of it put a plane 190 m off on its way home."""
WIND_CHANGED, CHANGED_FOR = 3.0, 10.0
"""By how much, m/s, and for how long, s, the drift must be another one to be another wind, and no gust."""
AGREE = 3.0
"""Standard deviations by which two ways of telling the place may differ."""
BIAS_MEMORY = 60.0
"""Time, s, over which the compass bias is learnt."""
RECKON_EVERY, LONGEST_STEP = 0.1, 1.0
"""Time, s, between two steps of dead reckoning; over a longer one nobody knows how the vehicle has turned."""


INTERVAL = 1.0
"""Time between two positions, s."""


@dataclass(frozen=True, slots=True)
class HandBackSettings:
    """place: of the target, latitude and longitude in degrees, if the mission gives it."""

    place: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class Given:
    """A position that was given. by: ranges or dead reckoning. answer: in words. off: how far the position that the
    vehicle reported then was from it, m."""

    time: float
    latitude: float
    longitude: float
    sigma: float
    by: str
    answer: str = "no answer"
    off: float | None = None


@dataclass(frozen=True, slots=True)
class Where:
    """Our own idea of where the vehicle is: m on the plane, wind (m/s, east + j north), true over measured airspeed."""

    time: float
    east: float
    north: float
    sigma: float
    wind: complex
    scale: float
    by_ranges: bool


class Health:
    """What the autopilot says of its own position."""

    def __init__(self) -> None:
        self._said: dict[str, tuple[bool, float]] = {}

    def hear(self, message: Message, now: float) -> None:
        """A message of RECEIVERS or FUSES."""
        kind = message.get_type()
        good = message.fix_type >= FIX_3D if kind in RECEIVERS else bool(message.flags & FUSES[kind])
        self._said[kind] = good, now

    def has_fix(self, now: float) -> bool:
        """Whether a receiver has one."""
        fresh = self._fresh(now)
        return any(fresh.get(kind, False) for kind in RECEIVERS)

    def good(self, now: float) -> bool | None:
        """Whether there is a fix, or the estimator fuses a position of any other kind; None: receiver or estimator is
        not heard, and nobody says that there is none."""
        fresh = self._fresh(now)
        heard = RECEIVERS[0] in fresh and not FUSES.keys().isdisjoint(fresh)
        return True if any(fresh.values()) else False if heard else None

    def _fresh(self, now: float) -> dict[str, bool]:
        return {kind: good for kind, (good, at) in self._said.items() if now - at <= SILENT}


class Mean:
    """A running mean that forgets. memory: s."""

    def __init__(self, memory: float) -> None:
        self._memory, self._at = memory, float("-inf")
        self.value: complex = 0j
        self.over = 0.0
        """Time, s, that it is the mean of."""

    def learn(self, value: complex, now: float) -> None:
        """Take a value in; the first one counts at once."""
        dt = min(max(now - self._at, 0.0), 1.0)
        self._at = now
        self.over = min(self.over + dt, self._memory)
        self.value += dt / max(self.over, 1e-3) * (value - self.value)


class CompassBias(Mean):
    """Of bearings by compass less those by GPS, while there is GPS: a mean of unit vectors."""

    def __init__(self) -> None:
        super().__init__(BIAS_MEMORY)

    @property
    def bias(self) -> tuple[float, float]:
        """The bias, rad, counter-clockwise positive, and its standard deviation; 0 before it was learnt."""
        return (phase(self.value), COMPASS_SIGMA) if self.over > 10.0 else (0.0, 3 * COMPASS_SIGMA)


class Wind(Mean):
    """As the filter's drift tells it, m/s, east + j north: about a lap of it, and the new one after a change."""

    def __init__(self) -> None:
        super().__init__(WIND_MEMORY)
        self._other = Mean(WIND_MEMORY)

    def learn(self, value: complex, now: float) -> None:
        if abs(value - self.value) <= WIND_CHANGED:
            self._other = Mean(WIND_MEMORY)
        else:
            self._other.learn(value, now)
        super().learn(value, now)
        if self._other.over >= CHANGED_FOR:
            self.value, self.over = self._other.value, self._other.over
            self._other = Mean(WIND_MEMORY)


class DeadReckoning:
    """The vehicle's place from the target's, the ranges and the compass; without ranges, from air path and wind."""

    def __init__(self) -> None:
        self.where: Where | None = None
        self.compass = CompassBias()
        self._wind, self._scale = Wind(), Mean(SCALE_MEMORY)
        self._air: complex = 0j
        """Velocity through the air, m/s, east + j north, as last known."""
        self._strayed = 0.0
        """Standard deviation, m, by which the wind has put it off since the filter was believed."""
        self._stepped_at = float("-inf")

    def step(self, now: float, own: OwnMotion | None, target: Place | None, estimate: RangeEstimate | None) -> None:
        """Take the filter's word, where ranges give one, or carry the place on. own: None where it is not heard.
        estimate: by ranges, None where there are none."""
        if now - self._stepped_at < RECKON_EVERY:
            return
        self._stepped_at = now
        flown = None if self.where is None else self._flown(now, self.where, own)
        if target is None or target.sigma > PLACE_SIGMA or estimate is None:
            self.where = flown
            return
        relative = estimate.relative
        if relative is not None and relative.trusted and self._believes(relative, target, flown):
            self._ranged(now, target, relative)
        elif flown is not None:
            self.where = _at_distance(estimate.r, target, flown)

    def _believes(self, relative: RelativeMotion, target: Place, flown: Where | None) -> bool:
        """Whether the filter knows better than the way flown. Straight away from the target ranges tell no bearing: the
        filter has that by the drift of its last moment. Where the two disagree by far, the wind is another one."""
        if flown is None or relative.sigma <= self._strayed:
            return True
        return abs(_from(target, flown) - self._way(relative)) > AGREE * relative.sigma

    def _way(self, relative: RelativeMotion) -> complex:
        return rect(1.0, -self.compass.bias[0]) * complex(relative.x, relative.y)

    def _ranged(self, now: float, target: Place, relative: RelativeMotion) -> None:
        bias, bias_sigma = self.compass.bias
        way = self._way(relative)
        drift = rect(1.0, -bias) * complex(relative.drift_x, relative.drift_y)
        sigma = hypot(target.sigma, relative.sigma, bias_sigma * abs(way))
        self._wind.learn(drift + complex(*target.velocity), now)
        self._scale.learn(relative.scale, now)
        self._air, self._strayed = rect(relative.airspeed, relative.heading - bias), relative.sigma
        wind, scale = self._wind.value, self._scale.value.real
        self.where = Where(now, target.east + way.real, target.north + way.imag, sigma, wind, scale, True)

    def _flown(self, now: float, before: Where, own: OwnMotion | None) -> Where:
        """On through the air; straight on where the vehicle is not heard, which may have turned anywhere since."""
        bias, bias_sigma = self.compass.bias
        dt = now - before.time
        if own is not None:
            self._air = rect(own.airspeed * before.scale, own.heading - bias)
        known = own is not None and dt <= LONGEST_STEP
        v, off = self._air + before.wind, hypot(WIND_SIGMA, (bias_sigma if known else 1.0) * abs(self._air))
        self._strayed += (STRAYS if known else off) * dt
        return replace(
            before, time=now, by_ranges=False, sigma=before.sigma + off * dt,
            east=before.east + v.real * dt, north=before.north + v.imag * dt,
        )  # fmt: skip


def _from(target: Place, here: Where) -> complex:
    return complex(here.east - target.east, here.north - target.north)


def _at_distance(r: float, target: Place, here: Where) -> Where:
    """Moved along the line of sight to where the ranges say, m; not where they cannot be right."""
    way = _from(target, here)
    if not 0 < abs(r - abs(way)) < AGREE * here.sigma or abs(way) < 1.0:
        return here
    way *= r / abs(way)
    return replace(here, east=target.east + way.real, north=target.north + way.imag, by_ranges=True)


class HandBack:
    """Decides when a position is given, and to whom never again."""

    def __init__(self, settings: HandBackSettings) -> None:
        self.settings = settings
        self.given: list[Given] = []
        """The newest positions, at most MOST_GIVEN."""
        self.sent = self.accepted = 0
        """Number of all positions given, and of those that the autopilot accepted."""
        self.ended = "the position was not lost"
        """Why nothing is given now, for people."""
        self.over = False
        """Whether nothing will be given any more."""
        self._lost_since: float | None = None
        self._lacks = ""
        """Why there is nothing to give now, for people."""
        self._due = 0.0
        self._waits = self._open = False
        """Whether an answer is waited for; whether one that comes would be that to the newest."""
        self._silent = self._without = 0
        self._look_at: float | None = None

    @property
    def begun(self) -> bool:
        """Whether the position is lost, and somebody is there who takes ours."""
        return self._lost_since is not None and not self.over

    @property
    def words(self) -> str:
        """What goes on, for people; empty where nothing does."""
        if self.over or self._lost_since is None:
            return f"stopped: {self.ended}" if self.over else ""
        if self._lacks:
            return f"position lost, none to give: {self._lacks}"
        if not self.given or self.given[-1].time < self._lost_since:
            return ""
        newest = self.given[-1]
        return f"position lost, given by {newest.by}, +-{newest.sigma:.0f} m, {newest.answer}"

    def step(
        self, now: float, *, good: bool | None, where: Where | None, plane: Plane, target: tuple[int, int]
    ) -> Message | None:
        """The command due now. good: whether the autopilot has a position; None: nobody says."""
        if good is None or good:
            self._lost_since, self._waits, self._open, self._lacks = None, False, False, ""
            if self.given and not self.over:
                self.ended = "the autopilot has a position again" if good else "GPS or EKF status is not heard"
            return None
        self._lost_since = now if self._lost_since is None else self._lost_since
        if self._waits and now - self.given[-1].time > ANSWER_PATIENCE:
            self._waits, self._silent, self._due = False, self._silent + 1, max(self._due, now + ANSWER_PATIENCE)
            if self._silent >= MOST_SILENT:
                self._end("the autopilot does not answer")
        if self.over or self._waits or now - self._lost_since < LOST_FOR or now < self._due:
            return None
        if where is None or where.sigma > MOST_SIGMA:
            self._lacks = "the target's place is not known" if where is None else "too long without ranges"
            return None
        self._due, self._waits, self._open, self._look_at = now + INTERVAL, True, True, None
        latitude, longitude = map(float, plane.to_degrees(where.east, where.north))
        sigma = max(where.sigma, LEAST_SIGMA)
        by = "ranges" if where.by_ranges else "dead reckoning"
        self.given.append(Given(now, latitude, longitude, sigma, by))
        del self.given[:-MOST_GIVEN]
        self.sent += 1
        self.ended, self._lacks = "going on", ""
        return position_estimate(latitude, longitude, sigma, target, now, now - where.time)

    def answered(self, message: Message, us: tuple[int, int], now: float) -> None:
        """A COMMAND_ACK of the vehicle."""
        if message.command != dialect.MAV_CMD_EXTERNAL_POSITION_ESTIMATE or not self._open:
            return
        if message.target_system not in (0, us[0]) or message.target_component not in (0, us[1]):
            return
        answer = RESULT_NAMES.get(message.result, f"result {message.result}")
        self.given[-1] = replace(self.given[-1], answer=answer)
        if message.result == dialect.MAV_RESULT_IN_PROGRESS:
            return  # the final one is to come
        self._waits, self._open, self._silent = False, False, 0
        match message.result:
            case dialect.MAV_RESULT_ACCEPTED:
                self._look_at, self.accepted = now + LOOK_AFTER, self.accepted + 1
            case dialect.MAV_RESULT_FAILED | dialect.MAV_RESULT_TEMPORARILY_REJECTED:
                self._due = max(self._due, now + AFTER_FAILED)
            case _:
                self._end(f"the autopilot answered: {answer}")

    def reported(self, east: float, north: float, here: Where | None, now: float) -> None:
        """A position that the vehicle reports: after an acceptance it must be about ours."""
        if self._look_at is None or here is None or now < self._look_at:
            return
        self._look_at = None
        off = hypot(east - here.east, north - here.north)
        self.given[-1] = replace(self.given[-1], off=off)
        self._without = self._without + 1 if off > max(EFFECT, 5 * here.sigma) else 0
        if self._without >= MOST_WITHOUT:
            self._end("positions are accepted, and have no effect")

    def plain(self) -> dict[str, Any]:
        """For the summary."""
        return {"sent": self.sent, "accepted": self.accepted, "ended": self.ended}

    def _end(self, why: str) -> None:
        self.over, self.ended = True, why
