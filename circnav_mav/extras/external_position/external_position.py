"""External position: send MAV_CMD_EXTERNAL_POSITION_ESTIMATE once a second to an autopilot that has
lost its position.

No position is sent while the autopilot has an absolute position, or while its status is not
reported. Sending stops for the rest of the flight in four cases: no answer, command not supported,
unexpected answer, or positions that are accepted without effect.
"""

from cmath import phase, rect
from dataclasses import dataclass, replace
from math import hypot, nan
from typing import Any

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.extras.locate.gps_fix import GpsFix
from circnav_mav.extras.locate.place import Place, Plane
from circnav_mav.guidance.types import OwnMotion, RangeEstimate, RelativeMotion
from circnav_mav.mav.codec import Message
from circnav_mav.mav.commands import RESULT_NAMES
from circnav_mav.pilot.method import RECEIVERS

FUSES = {
    "EKF_STATUS_REPORT": dialect.EKF_POS_HORIZ_ABS,
    "ESTIMATOR_STATUS": dialect.ESTIMATOR_PRED_POS_HORIZ_ABS,
}
"""Flag of the estimator's report that marks a fused absolute position, by message.

ArduPilot clears its flag 10 s after the last GPS, vision or beacon measurement (NavEKF3's
posTimeout), and a handed-back position does not set it. PX4 keeps its flag of an absolute position
set in dead reckoning by airspeed. Therefore PX4's flag of a predicted position is used: it needs
GNSS or an auxiliary position, and is cleared after 7 s.
"""
REPORTS = {
    "ardupilot": dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
    "px4": dialect.MAVLINK_MSG_ID_ESTIMATOR_STATUS,
}
"""Message id of the estimator report, by firmware."""
ANSWER_PATIENCE = 2.0
"""Time to wait for the answer to a position, s. Without an answer, the next position is sent after
the same time again, because the answer may be late."""
MOST_SILENT = 3
"""Number of consecutive unanswered positions after which the external position stops."""
LOOK_AFTER = 0.5
"""Time from the acceptance of a position to the check of its effect, s."""
EFFECT = 30.0
"""Smallest distance from our estimate to the position that the autopilot reports, m, that shows a
position without effect. For an uncertain estimate, five standard deviations are used if they are
larger."""
MOST_WITHOUT = 3
"""Number of consecutive positions without effect after which the external position stops."""
LEAST_SIGMA = 1.0
"""Smallest standard deviation that is sent, m. With a smaller one, PX4 makes a hard reset."""
MOST_SIGMA = 300.0
"""Largest standard deviation with which a position is still sent, m. Without external position, the
autopilot's own position was several km off."""
MOST_GIVEN = 10_000
"""Number of newest positions kept for external_position.csv: 2.7 hours at 1 Hz."""
COMPASS_SIGMA = 0.03
"""Standard deviation of the estimated compass bias, rad. Before the bias is estimated, three times
this value is used."""
WIND_SIGMA = 0.3
"""Error of the wind in dead reckoning, standard deviation, m/s."""
STRAYS = 0.6
"""Error of the velocity in dead reckoning from wind, gusts and airspeed together, standard
deviation, m/s."""
WIND_MEMORY = 40.0
"""Averaging time of the wind, s: about a lap. The unfiltered drift contains gusts and sideslip: an
error of 0.7 m/s put a plane 190 m off on its way home."""
SCALE_MEMORY = 300.0
"""Averaging time of the airspeed scale, s. The scale hardly changes."""
WIND_CHANGED = 3.0
"""Smallest change of the drift, m/s, that is a new wind instead of a gust if it lasts for
CHANGED_FOR."""
CHANGED_FOR = 10.0
"""Smallest duration of a changed drift that is a new wind, s."""
AGREE = 3.0
"""Largest difference between two position estimates that agree, in standard deviations."""
RECKON_EVERY = 0.1
"""Shortest time between two steps of dead reckoning, s."""
LONGEST_STEP = 1.0
"""Longest step of dead reckoning over which the heading is still valid, s."""


@dataclass(frozen=True, slots=True)
class SentPosition:
    """Position sent to the autopilot.

    by: source of the position: "ranges" or "dead reckoning".
    answer: autopilot's answer.
    off: distance from our estimate to the position that the vehicle reported after acceptance, m.
    """

    time: float
    latitude: float
    longitude: float
    sigma: float
    by: str
    answer: str = "no answer"
    off: float | None = None


@dataclass(frozen=True, slots=True)
class PositionEstimate:
    """Estimated position of the vehicle.

    east, north: position on the plane, m.
    sigma: standard deviation of the position, m.
    wind: east + j north, m/s.
    scale: true over measured airspeed.
    by_ranges: True if ranges were used.
    """

    time: float
    east: float
    north: float
    sigma: float
    wind: complex
    scale: float
    by_ranges: bool


class Health(GpsFix):
    """Position status reported by the autopilot: fixes of its receivers, and the state of its
    estimator."""

    def on_message(self, message: Message, now: float) -> None:
        """Process a message of RECEIVERS or FUSES."""
        kind = message.get_type()
        if kind in FUSES:
            self._report(kind, bool(message.flags & FUSES[kind]), now)
        else:
            super().on_message(message, now)

    def good(self, now: float) -> bool | None:
        """True if a receiver has a fix or the estimator fuses an absolute position. False if both
        report none. None if a report is missing."""
        fresh = self._fresh(now)
        received = RECEIVERS[0] in fresh and not FUSES.keys().isdisjoint(fresh)
        return True if any(fresh.values()) else False if received else None


class RunningMean:
    """Running mean with exponential forgetting. memory: time constant, s."""

    def __init__(self, memory: float) -> None:
        self._memory = memory
        self._at = float("-inf")
        self.value: complex = 0j
        self.over = 0.0
        """Time span of the averaged values, at most the time constant, s."""

    def learn(self, value: complex, now: float) -> None:
        """Add a value. The first value sets the mean."""
        dt = min(max(now - self._at, 0.0), 1.0)
        self._at = now
        self.over = min(self.over + dt, self._memory)
        self.value += dt / max(self.over, 1e-3) * (value - self.value)


class CompassBias(RunningMean):
    """Mean difference between bearings by compass and bearings by GPS, as a unit vector. Updated
    while GPS is available."""

    def __init__(self) -> None:
        # 60.0: averaging time of the compass bias, s.
        super().__init__(60.0)

    @property
    def bias(self) -> tuple[float, float]:
        """Compass bias (bearing by compass minus bearing by GPS, counter-clockwise positive) and
        its standard deviation, rad.

        The bias is 0 until 10 s of GPS data were averaged.
        """
        return (phase(self.value), COMPASS_SIGMA) if self.over > 10.0 else (0.0, 3 * COMPASS_SIGMA)


class Wind(RunningMean):
    """Mean wind, m/s, east + j north, from the drift of the range filter. The mean restarts after a
    lasting change."""

    def __init__(self) -> None:
        super().__init__(WIND_MEMORY)
        self._other = RunningMean(WIND_MEMORY)

    def learn(self, value: complex, now: float) -> None:
        if abs(value - self.value) <= WIND_CHANGED:
            self._other = RunningMean(WIND_MEMORY)
        else:
            self._other.learn(value, now)
        super().learn(value, now)
        if self._other.over >= CHANGED_FOR:
            self.value = self._other.value
            self.over = self._other.over
            self._other = RunningMean(WIND_MEMORY)


class DeadReckoning:
    """Estimator of the vehicle's position. With ranges: from the target's place, the ranges and the
    compass. Without ranges: from airspeed, heading and wind."""

    def __init__(self) -> None:
        self.where: PositionEstimate | None = None
        self.compass = CompassBias()
        self._wind = Wind()
        self._scale = RunningMean(SCALE_MEMORY)
        self._air: complex = 0j
        """Newest known velocity through the air, m/s, east + j north."""
        self._strayed = 0.0
        """Standard deviation of the position error that dead reckoning has accumulated since the
        range filter was last used, m."""
        self._stepped_at = float("-inf")

    def step(
        self,
        now: float,
        own: OwnMotion | None,
        target: Place | None,
        estimate: RangeEstimate | None,
    ) -> None:
        """Use the range filter's position if it is accurate enough, else dead reckoning.

        now: run time, s.
        own: own motion, None if stale.
        target: place of the target, None if unknown.
        estimate: estimate of the range filter, None without fresh ranges.
        """
        if now - self._stepped_at < RECKON_EVERY:
            return
        self._stepped_at = now
        flown = None if self.where is None else self._flown(now, self.where, own)
        # 15.0: largest standard deviation of the target's place, m, with which the vehicle's
        # position is computed from this place and the ranges. With a larger one, dead reckoning
        # continues. Chosen.
        if target is None or target.sigma > 15.0 or estimate is None:
            self.where = flown
            return
        relative = estimate.relative
        if relative is not None and relative.trusted and self._accepts(relative, target, flown):
            self._ranged(now, target, relative)
        elif flown is not None:
            self.where = _at_distance(estimate.r, target, flown)

    def _accepts(
        self, relative: RelativeMotion, target: Place, flown: PositionEstimate | None
    ) -> bool:
        """True if the range filter's position is better than dead reckoning."""
        # On a straight flight away from the target, ranges give no bearing: the range filter then
        # extrapolates with the last drift. Prefer dead reckoning, unless both positions differ by
        # so much that the wind must have changed.
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
        self._air = rect(relative.airspeed, relative.heading - bias)
        self._strayed = relative.sigma
        wind = self._wind.value
        scale = self._scale.value.real
        self.where = PositionEstimate(
            now, target.east + way.real, target.north + way.imag, sigma, wind, scale, True
        )

    def _flown(
        self, now: float, before: PositionEstimate, own: OwnMotion | None
    ) -> PositionEstimate:
        """Return the position by dead reckoning. Without own motion, the flight is assumed
        straight, and the error large."""
        bias, bias_sigma = self.compass.bias
        dt = now - before.time
        if own is not None:
            self._air = rect(own.airspeed * before.scale, own.heading - bias)
        known = own is not None and dt <= LONGEST_STEP
        v = self._air + before.wind
        off = hypot(WIND_SIGMA, (bias_sigma if known else 1.0) * abs(self._air))
        self._strayed += (STRAYS if known else off) * dt
        return replace(
            before, time=now, by_ranges=False, sigma=before.sigma + off * dt,
            east=before.east + v.real * dt, north=before.north + v.imag * dt,
        )  # fmt: skip


def _from(target: Place, here: PositionEstimate) -> complex:
    return complex(here.east - target.east, here.north - target.north)


def _at_distance(r: float, target: Place, here: PositionEstimate) -> PositionEstimate:
    """Return the position, moved along the line through the target until its distance to the target
    is the measured range r (m). Return it unchanged if r is implausible."""
    way = _from(target, here)
    if not 0 < abs(r - abs(way)) < AGREE * here.sigma or abs(way) < 1.0:
        return here
    way *= r / abs(way)
    return replace(here, east=target.east + way.real, north=target.north + way.imag, by_ranges=True)


class ExternalPosition:
    """External position: decides when a position is sent, and when sending stops for the rest of
    the flight."""

    def __init__(self) -> None:
        self.given: list[SentPosition] = []
        """Newest positions sent, at most MOST_GIVEN."""
        self.sent = self.accepted = 0
        """Number of positions sent, and number accepted by the autopilot."""
        self.ended = "the position was not lost"
        """Human-readable reason why no position is sent."""
        self.over = False
        """True if the external position has stopped for the rest of the flight."""
        self._lost_since: float | None = None
        self._lacks = ""
        """Human-readable reason why no position is available."""
        self._due = 0.0
        self._waits = self._open = False
        """_waits: True while waiting for an answer. _open: True while an answer may still belong to
        the newest position."""
        self._silent = self._without = 0
        self._look_at: float | None = None

    @property
    def begun(self) -> bool:
        """True if the autopilot has lost its position and the external position has not stopped."""
        return self._lost_since is not None and not self.over

    @property
    def works(self) -> bool:
        """True while the external position has not failed."""
        return not self.over and not self._lacks

    @property
    def words(self) -> str:
        """Human-readable state, empty if the position is not lost."""
        if self.over or self._lost_since is None:
            return f"stopped: {self.ended}" if self.over else ""
        if self._lacks:
            return f"position lost, no replacement: {self._lacks}"
        if not self.given or self.given[-1].time < self._lost_since:
            return ""
        newest = self.given[-1]
        return (
            f"autopilot lost its position, sent it one from {newest.by}, ±{newest.sigma:.0f} m:"
            f" {newest.answer}"
        )

    def step(
        self,
        now: float,
        *,
        good: bool | None,
        where: PositionEstimate | None,
        plane: Plane,
        target: tuple[int, int],
    ) -> Message | None:
        """Return the command to send now, or None.

        good: True if the autopilot has a position, None if unknown.
        where: estimated position, None if unknown.
        target: system and component id of the autopilot.
        """
        # Treat an unknown status as a valid position: never send a position to an autopilot that
        # may still have its own.
        if good is None or good:
            self._pause(
                "the autopilot has a position again"
                if good
                else "GPS or EKF status is not received"
            )
            return None
        self._lost_since = now if self._lost_since is None else self._lost_since
        self._watch_answer(now)
        # 2.0: time for which the autopilot must lack a position before the first one is handed
        # back, s.
        if self.over or self._waits or now - self._lost_since < 2.0 or now < self._due:
            return None
        if where is None or where.sigma > MOST_SIGMA:
            self._lacks = (
                "the target's place is unknown"
                if where is None
                else "the last usable range is too old"
            )
            return None
        # 1.0: time between two handed-back positions, s.
        self._due = now + 1.0
        self._waits = True
        self._open = True
        self._look_at = None
        latitude, longitude = map(float, plane.to_degrees(where.east, where.north))
        sigma = max(where.sigma, LEAST_SIGMA)
        by = "ranges" if where.by_ranges else "dead reckoning"
        self.given.append(SentPosition(now, latitude, longitude, sigma, by))
        del self.given[:-MOST_GIVEN]
        self.sent += 1
        self.ended = "going on"
        self._lacks = ""
        return position_estimate(latitude, longitude, sigma, target, now, now - where.time)

    def _pause(self, why: str) -> None:
        """Send no position until the autopilot lacks one again. why: human-readable."""
        self._lost_since = None
        self._waits = False
        self._open = False
        self._lacks = ""
        if self.given and not self.over:
            self.ended = why

    def _watch_answer(self, now: float) -> None:
        """Stop waiting for an answer after a time. After several missing answers, stop sending."""
        if not self._waits or now - self.given[-1].time <= ANSWER_PATIENCE:
            return
        self._waits = False
        self._silent += 1
        self._due = max(self._due, now + ANSWER_PATIENCE)
        if self._silent >= MOST_SILENT:
            self._end("the autopilot does not answer")

    def answered(self, message: Message, us: tuple[int, int], now: float) -> None:
        """Process a COMMAND_ACK of the vehicle. us: own system and component id."""
        if message.command != dialect.MAV_CMD_EXTERNAL_POSITION_ESTIMATE or not self._open:
            return
        if message.target_system not in (0, us[0]) or message.target_component not in (0, us[1]):
            return
        answer = RESULT_NAMES.get(message.result, f"result {message.result}")
        self.given[-1] = replace(self.given[-1], answer=answer)
        if message.result == dialect.MAV_RESULT_IN_PROGRESS:
            return  # the final answer follows
        self._waits = False
        self._open = False
        self._silent = 0
        match message.result:
            case dialect.MAV_RESULT_ACCEPTED:
                self._look_at, self.accepted = now + LOOK_AFTER, self.accepted + 1
            case dialect.MAV_RESULT_FAILED | dialect.MAV_RESULT_TEMPORARILY_REJECTED:
                # 10.0: time until the next position after the answer FAILED or
                # TEMPORARILY_REJECTED, s. FAILED means that the autopilot has a position after all,
                # or has none that it could reset.
                self._due = max(self._due, now + 10.0)
            case _:
                self._end(f"the autopilot answered: {answer}")

    def reported(
        self, east: float, north: float, here: PositionEstimate | None, now: float
    ) -> None:
        """Process a position reported by the vehicle, m. After an acceptance, the reported position
        must be near our estimate `here`."""
        if self._look_at is None or here is None or now < self._look_at:
            return
        self._look_at = None
        off = hypot(east - here.east, north - here.north)
        self.given[-1] = replace(self.given[-1], off=off)
        self._without = self._without + 1 if off > max(EFFECT, 5 * here.sigma) else 0
        if self._without >= MOST_WITHOUT:
            self._end("positions are accepted, but have no effect")

    def plain(self) -> dict[str, Any]:
        """Return the fields for summary.json."""
        return {"sent": self.sent, "accepted": self.accepted, "ended": self.ended}

    def _end(self, why: str) -> None:
        self.over = True
        self.ended = why


def position_estimate(
    latitude: float, longitude: float, sigma: float, target: tuple[int, int], now: float, age: float
) -> Message:
    """Return MAV_CMD_EXTERNAL_POSITION_ESTIMATE. Its parameters are the time of sending (s), the
    age of the estimate (s) and the standard deviation (m). ArduPilot requires z = NaN and the frame
    GLOBAL."""
    return dialect.MAVLink_command_int_message(
        *target, dialect.MAV_FRAME_GLOBAL, dialect.MAV_CMD_EXTERNAL_POSITION_ESTIMATE, 0, 0,
        now % 10_000.0, age, sigma, 0.0, round(latitude * 1e7), round(longitude * 1e7), nan,
    )  # fmt: skip
