"""What is known of the range to the target: ranges in, an estimate out, and when to step without a fresh one.

Slant ranges become horizontal with the height above the target, which the vehicle's own altitude tells. Read are
VFR_HUD.alt and, of HOME_POSITION, the altitude alone: its latitude, longitude and local position never are.
"""

from collections import deque
from collections.abc import Callable, Hashable
from math import pi, sqrt
from statistics import median

from circnav_mav.guidance.estimators.interface import Fused
from circnav_mav.guidance.estimators.table import ESTIMATORS
from circnav_mav.guidance.range_noise import NoiseCheck
from circnav_mav.guidance.types import SAME_TIME, RangeEstimate, RangeSample, RateSample
from circnav_mav.mav.clocks import nobody_tells
from circnav_mav.mav.codec import Message
from circnav_mav.mav.identity import RADIO_NAME
from circnav_mav.mav.own_motion import AIR_MAX_AGE, MOST_ALTITUDE
from circnav_mav.mav.ranging.interface import Reject
from circnav_mav.mav.ranging.reader import RangeRateReader, RangeReader
from circnav_mav.mav.session import Session
from circnav_mav.pilot.settings import HeightSettings, PilotSettings

FRESH = 0.6
"""Share of `stale` that a range's age must be below to steer again at once after ranges were stale."""
CALM = 1.0
"""Time, s, for which ranges must not have been stale to steer again otherwise: a radio whose ranges come at an age near
`stale` would else start and stop steering with each of them."""
WAIT = 0.25
"""Share of a tick for which a range that is expected about then is waited for. A radio of 9.98 Hz would else come just
after the second tick since its last range, always, and its every range be answered twice."""
AT_ONCE = 1e-5
"""A range expected within this time, s, of the tick would be here by now, or is lost."""
THINNED = 1 - WAIT
"""Least time between two ranges that the estimator takes, in ticks: ranges in between are merged. Each range that it
takes is answered with a setpoint, and costs 1 to 2 ms of the processor."""
REMEMBERED = 9
"""Gaps between ranges whose median is their period: odd, so that four late ones change nothing."""
MOST_MERGED = 1000
"""Ranges that are merged to one at most."""
MOST_AT_ONCE = 64
"""Ranges that one datagram of a slow link may hold."""
MOST_CLIMB = 20.0
"""Climb or sink rate, m/s, that none of our vehicles has: a quicker change is an altitude estimate that was reset."""
BUNCHED = 0.25
"""Least time, s, by which two altitudes count as apart: a link may deliver several at once."""
RETURNS = 3.0
"""Time, s, within which an altitude that jumped may come back little by little, as ArduPlane's does in turbulence."""

HEARD = frozenset({"VFR_HUD", "HOME_POSITION"})
"""Types of the messages that tell of the height."""


class RangeTracker:
    """Reads ranges and keeps the estimator. `fresh`: a range came in that no step has answered yet."""

    def __init__(
        self, settings: PilotSettings, session: Session, say_news: Callable[[str, Hashable, str], None]
    ) -> None:
        """say_news: tells ground stations something (kind, news, text), once for each change of the news."""
        self._session, self._say_news = session, say_news
        self._apart, self._stale = settings.ranging_apart, settings.timing.stale
        speed, max_turn_rate = settings.orbit.speed, settings.orbit.max_turn_rate
        self.noise = NoiseCheck.of_ranges(speed, max_turn_rate)
        self._needs_altitude = settings.height.needs_altitude
        self.height = Height(settings.height)
        slower = nobody_tells if self._apart else session.timesync.slower
        self.ranging = RangeReader(settings.ranging, self.noise, slower)
        self.rates = RangeRateReader(settings.ranging, self.ranging, NoiseCheck.of_rates(speed, max_turn_rate), speed)
        self.estimator = ESTIMATORS[settings.estimator](settings.estimation)
        self._thinning = Thinning(THINNED * settings.timing.tick)
        self.newest: RangeSample | None = None
        self.recent: deque[RangeSample] = deque(maxlen=MOST_AT_ONCE)
        """The newest ones that were taken."""
        self.newest_rate: RateSample | None = None
        self.fresh = False
        self.accepted = 0
        self._stale_at = float("-inf")

    def receive(self, message: Message, now: float, source: Hashable, *, stalled: bool, begun: bool) -> bool:
        """Take in what may be a range; tells whether the estimator took it. source: where it came from. stalled: we
        slept, its age is not known. begun: whether the vehicle was engaged: before, a slow link has its own bound, and
        is waited for."""
        height, identity = self.height.at(now), self._session.identity
        peer = None if self._apart else identity.peer
        if self.rates.carries(message):
            rate, before = self.rates.read(message, now, height=height, source=source), self.newest_rate
            apart = rate is None or before is None or rate.time - before.time >= self._thinning.period
            if rate is not None and not stalled and apart:
                self.newest_rate = rate
                self.estimator.observe_rate(rate)
            self._say_trouble()
            return False
        sample = self.ranging.read(
            message,
            now,
            height=height,
            strangers=() if self._apart else identity.strangers,
            one_way=self._session.timesync.one_way if begun and not self._apart else 0.0,
            source=source,
            vehicle=peer.source if peer else None,
        )
        if self.ranging.rival is not None and self.ranging.trusted is not None:
            identity.rivals.heard(RADIO_NAME, self.ranging.rival, self.ranging.trusted, now)
        if self.ranging.restarted:
            self.estimator.restamp()
            self._thinning.reset()
        choice = "" if self.ranging.sender_stays else self.ranging.sources.short_choice(now)
        self._say_news("range sources", choice or False, choice or "one range source")
        if self.ranging.stepped:
            self._session.announcer.say("clock", f"sensor clock stalled {self.ranging.stepped:.1f} s")
        self._say_trouble()
        if sample is None:
            return False
        if stalled:
            self.ranging.reject(Reject.STALLED)
            return False
        if height is None and self._needs_altitude:
            self.ranging.reject(Reject.NO_HEIGHT)
            return False
        self.rates.range_taken(sample)
        for kind, found in (("noise", self.noise.found), ("low noise", self.noise.lowered)):
            if found is not None:
                self._say_news(kind, True, "range noise {1:.2g} m, expected {0:.2g} m".format(*found))
        merged = self._thinning.take(sample)
        if merged is None:
            return False
        sample, count = merged
        if self.estimator.observe(sample) is Fused.GATED:
            self.ranging.reject(Reject.GATED, count)
            return False
        self.accepted += count
        self.newest, self.fresh = sample, True
        self.recent.append(sample)
        return True

    def _say_trouble(self) -> None:
        """Say what no longer counts, and that it counts again."""
        frozen, wrong = bool(self.noise.repeated), bool(self.rates.trouble)
        self._say_news("range trouble", frozen, f"range {'frozen, rejected' if frozen else 'counts again'}")
        self._say_news("range rate trouble", wrong, f"range rate {'wrong, dropped' if wrong else 'counts again'}")

    def measured_rate(self, now: float) -> float | None:
        """The newest range rate that counted, m/s; None where none counts now."""
        rate = self.newest_rate
        return None if rate is None or now - rate.time > self._stale + SAME_TIME else rate.r_dot

    def good(self, estimate: RangeEstimate | None, now: float, *, holding: bool) -> bool:
        """Whether an estimate of now may steer: ready, and of a range that is not stale. holding: whether steering was
        given up; then the range must be clearly fresh, or ranges must not have been stale for a while."""
        age = self.age(now)
        if age is None or age > self._stale + SAME_TIME:
            self._stale_at = now
            return False
        fresh = not holding or age <= FRESH * self._stale or now - self._stale_at > CALM
        return self.estimator.ready and estimate is not None and fresh and self.ranging.one_source(now)

    def age(self, now: float) -> float | None:
        """Seconds since the newest range was measured."""
        return None if self.newest is None else now - self.newest.time


class Thinning:
    """Merges ranges that come faster than the estimator and the vehicle need them. A range that comes a period after
    the last one passes unchanged and at once."""

    def __init__(self, period: float) -> None:
        """period: least time between two ranges that pass, s."""
        self.period = period
        self._passed_at = float("-inf")
        self._held: list[RangeSample] = []

    def reset(self) -> None:
        """Drop what is held: the sensor's clock is another one."""
        self._held, self._passed_at = [], float("-inf")

    def take(self, sample: RangeSample) -> tuple[RangeSample, int] | None:
        """Return the range to use now and how many it stands for; None while they are held.

        Periods are counted in the time of measurement: a link that delivers several ranges of a slow radio at once
        delays them, and does not make them one measurement.
        """
        self._held.append(sample)
        if 0 <= sample.time - self._passed_at < self.period - SAME_TIME and len(self._held) < MOST_MERGED:
            return None
        # what was held when the radio fell silent is of another moment
        held = [one for one in self._held if sample.time - one.time <= self.period]
        count, self._held, self._passed_at = len(self._held), [], sample.time
        if len(held) == 1:
            return sample, count
        # The median, so that an outlier, which the estimator's gate cannot see any more, does not move the others; and
        # halfway between first and last, because the range goes on changing meanwhile. A median of n scatters by
        # sqrt(pi/2n).
        first, r = held[0], median(one.r for one in held)
        sigma = median(one.sigma for one in held) * min(sqrt(pi / 2 / len(held)), 1.0)
        stamp, time = (first.stamp + sample.stamp) / 2, (first.time + sample.time) / 2
        return sample._replace(stamp=stamp, time=time, r=r, sigma=sigma), count


class Height:
    """The height above the target. Before the engagement it is what the mission and the newest altitude say; from then
    on it changes with the altitude alone, and the last one holds when no altitude comes."""

    def __init__(self, settings: HeightSettings) -> None:
        self._settings = settings
        self._base = settings.above_target or 0.0
        self._zero = settings.target_altitude
        """The altitude at which the height is `_base`, None while it is not known."""
        self._altitude: float | None = None
        self._heard_at = float("-inf")
        self._engaged = False
        self.jumped = 0.0
        """The sum of the jumps of the altitude since the engagement, m, which do not count as height."""
        self._doubt: tuple[float, float, float] | None = None
        """When the altitude jumped lately, from where and how far."""

    def engage(self) -> None:
        """Guidance has the vehicle: home and height are now those of the flight."""
        self._engaged = True

    def hear(self, message: Message, altitude: float | None, now: float) -> bool:
        """Take in one message of the vehicle. altitude: what is believed of VFR_HUD, None: nothing. Tells whether the
        altitude has jumped."""
        above_home = self._settings.target_above_home
        if message.get_type() == "HOME_POSITION" and above_home is not None and not self._engaged:
            home = message.altitude / 1000
            self._zero = home + above_home if abs(home) <= MOST_ALTITUDE else self._zero
        if message.get_type() != "VFR_HUD" or altitude is None:
            return False
        before, waited = self._altitude, max(now - self._heard_at, BUNCHED)
        self._altitude, self._heard_at = altitude, now
        if not self._engaged:  # a home that is set late moves the altitude by hundreds of metres, and rightly so
            return False
        if self._zero is None:
            self._zero = altitude if self._settings.above_target is not None else None
            return False
        change = 0.0 if before is None else altitude - before
        if before is None or abs(change) <= MOST_CLIMB * waited:
            self._forgive(altitude, now)
            return False
        # the vehicle did not move, its zero did: a glitch that comes and goes leaves nothing behind
        began, origin, so_far = self._doubt or (now, before, 0.0)
        self._doubt = began, origin, so_far + change
        self._zero += change
        self.jumped += change
        return True

    def _forgive(self, altitude: float, now: float) -> None:
        """After an altitude that has come back little by little, the zero of before its jump."""
        if self._doubt is None or now - self._doubt[0] < RETURNS:
            return
        (_, origin, jump), self._doubt = self._doubt, None
        if self._zero is not None and abs(altitude - origin) <= MOST_CLIMB * BUNCHED:
            self._zero -= jump
            self.jumped -= jump

    def at(self, now: float) -> float | None:
        """The height now, m; None where it is not known, or the mission says nothing of it."""
        live = self._engaged or now - self._heard_at <= AIR_MAX_AGE
        if self._zero is None or self._altitude is None or not live:
            return self._settings.above_target
        return self._base + (self._altitude - self._zero)

    def why_unknown(self, now: float) -> str:
        """Why there is no height although the mission wants one, for people; empty where there is."""
        if not self._settings.needs_altitude or self.at(now) is not None:
            return ""
        if self._zero is None:
            return (
                "no home altitude (HOME_POSITION), from which orbit.target_above_home_m counts: set home, or give "
                "orbit.target_altitude_m or orbit.height_above_target_m instead"
            )
        return "no altitude (VFR_HUD.alt), without which the height above the target is not known"

    def trouble(self, now: float) -> str:
        """What is wrong with the height of the flight, for people; empty where nothing is."""
        height = self.at(now)
        if not self._engaged or height is None:
            return ""
        if now - self._heard_at > AIR_MAX_AGE:
            return f"ALTITUDE NOT HEARD: height above the target held at {height:.1f} m"
        if abs(self.jumped) > MOST_CLIMB * BUNCHED:
            return f"ALTITUDE JUMPED by {self.jumped:+.1f} m, not counted as height: compare the radius with the map"
        return ""


class TickScheduler:
    """Keeps when the next step without a fresh range is due: a tick after the last one, but not just before a range."""

    def __init__(self, tick: float) -> None:
        """tick: s."""
        self._tick = tick
        self._gaps: deque[float] = deque(maxlen=REMEMBERED)
        self._heard_at: float | None = None
        self.due = float("-inf")

    def heard(self, now: float) -> None:
        """A range came in."""
        if self._heard_at is not None:
            self._gaps.append(now - self._heard_at)
        self._heard_at = now

    def stepped(self, now: float) -> None:
        """The pilot took a step."""
        due = now + self._tick
        wait = WAIT * self._tick
        # by the usual time between two
        expected = due if self._heard_at is None or not self._gaps else self._heard_at + median(self._gaps)
        self.due = expected + wait if AT_ONCE < abs(due - expected) <= wait else due

    def at_once(self) -> None:
        """Something happened that cannot wait for a tick."""
        self.due = float("-inf")
